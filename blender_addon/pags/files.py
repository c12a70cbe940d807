# SPDX-License-Identifier: GPL-3.0-or-later
"""New files that never replace others: links to files that stay, or copies where links can't be made (FAT, network shares, Windows without the
privilege)."""

import contextlib
import os
import secrets
import shutil

from .native import SceneError


def check_free(path):
    """Raises where there is something already, a link that leads nowhere included."""
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
        os.remove(target)  # file systems that keep links as files of their own
    except (OSError, NotImplementedError):
        pass
    check_free(target)
    complete(target, lambda part: shutil.copyfile(source, part), f"neither a link to nor a copy of {source} can be made")


def complete(target, write, problem):
    """Has `write` make a file under another name beside `target`, and gives it that name when it is whole."""
    part = f"{target}.{secrets.token_hex(4)}.part"
    try:
        write(part)
        check_free(target)
        os.rename(part, target)
    except (OSError, RuntimeError) as error:
        raise SceneError(f"{target}: {problem}: {getattr(error, 'strerror', None) or error}") from error
    finally:
        with contextlib.suppress(OSError):
            os.remove(part)  # where it wasn't renamed


def write_bytes(path, data):
    with open(path, "xb") as file:
        file.write(data)


class NewFiles:
    """What is made for one folder. Where not all of it can be, what was made goes again: `with NewFiles(folder) as new`."""

    def __init__(self, folder):
        self.folder, self.made = folder, []

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        for path in reversed(self.made) if kind else ():
            try:
                os.rmdir(path) if os.path.isdir(path) and not os.path.islink(path) else os.remove(path)
            except OSError:
                pass  # a folder that somebody else has put something into
        return False

    def path(self, name):
        """Of a file of this name to be, in folders that are made where they are missing."""
        path = os.path.join(self.folder, name)
        check_free(path)
        missing, folder = [], os.path.dirname(path)
        while folder and not os.path.isdir(folder):
            missing.append(folder)
            folder = os.path.dirname(folder)
        for folder in reversed(missing):
            os.mkdir(folder)
            self.made.append(folder)
        return path

    def link(self, source, name):
        path = self.path(name)
        link_or_copy(source, path)
        self.made.append(path)

    def write(self, name, data):
        path = self.path(name)
        complete(path, lambda part: write_bytes(part, data), "can't be written")
        self.made.append(path)
