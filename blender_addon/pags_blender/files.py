# SPDX-License-Identifier: GPL-3.0-or-later
"""New files that never replace others: links to files that stay, or copies where links can't be made (FAT, network shares, Windows without the
privilege)."""

import contextlib
import os
import secrets
import shutil

from .native import SceneError


def check_free(path):
    """Raises SceneError when the path exists, also as a broken link."""
    if os.path.lexists(path):
        raise SceneError(f"{path}: is there already and is not replaced; choose a folder without it")


def link_or_copy(source, target):
    """Puts `source` at `target` as a symbolic link, or as a copy."""
    source = os.path.abspath(source)
    if not os.path.isfile(source):
        raise SceneError(f"{source}: there is no such file")
    check_free(target)
    try:
        os.symlink(source, target)
        if os.path.exists(target) and os.path.samefile(source, target):
            return
        os.remove(target)  # the file system has stored the link as an ordinary file
    except (OSError, NotImplementedError):
        pass
    check_free(target)
    complete(target, lambda part: shutil.copyfile(source, part), f"neither a link to nor a copy of {source} can be made")


def complete(target, write, problem):
    """Calls `write` with a temporary name beside `target` and renames the file to `target` once it is complete."""
    part = f"{target}.{secrets.token_hex(4)}.part"
    try:
        write(part)
        check_free(target)
        os.rename(part, target)
    except (OSError, RuntimeError) as error:
        raise SceneError(f"{target}: {problem}: {getattr(error, 'strerror', None) or error}") from error
    finally:
        with contextlib.suppress(OSError):
            os.remove(part)  # left by a failed write


def write_blocks(path, blocks):
    with open(path, "xb") as file:
        for block in blocks:
            file.write(block)


class NewFiles:
    """Context manager (`with NewFiles(folder) as new`) for files made together: if one fails, all of them, and the folders made for them, are removed again."""

    def __init__(self, folder):
        self.folder, self.made = folder, []

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        for path in reversed(self.made) if kind else ():
            try:
                os.rmdir(path) if os.path.isdir(path) and not os.path.islink(path) else os.remove(path)
            except OSError:
                pass  # not empty: another program has put a file there
        return False

    def path(self, name):
        """Path for a new file of this name; missing folders are created."""
        path = os.path.normpath(os.path.join(self.folder, name))  # scene files have '/' on Windows, too
        check_free(path)
        missing, folder = [], os.path.dirname(path)
        while folder and not os.path.isdir(folder):
            missing.append(folder)
            folder = os.path.dirname(folder)
        for folder in reversed(missing):
            try:
                os.mkdir(folder)
            except OSError as error:
                raise SceneError(f"{folder}: can't make the folder: {error.strerror}") from error
            self.made.append(folder)
        return path

    def link(self, source, name):
        path = self.path(name)
        link_or_copy(source, path)
        self.made.append(path)

    def copy(self, source, name):
        path = self.path(name)
        complete(path, lambda part: shutil.copyfile(source, part), f"{source} can't be copied")
        self.made.append(path)

    def write(self, name, blocks):
        """Writes blocks of bytes one after another."""
        path = self.path(name)
        complete(path, lambda part: write_blocks(part, blocks), "can't be written")
        self.made.append(path)
