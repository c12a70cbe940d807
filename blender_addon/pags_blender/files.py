# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes new files without replacing existing ones: links to existing files, or copies if links fail (FAT, network shares, Windows without the privilege)."""

import contextlib
import os
import secrets
import shutil

from .native import SceneError


def check_free(path):
    """Raises SceneError if the path exists, also as a broken link."""
    if os.path.lexists(path):
        raise SceneError(f"{path}: already exists and is not replaced; choose another folder")


def link_or_copy(source, target):
    """Creates `target` as a symbolic link to `source`, or as a copy."""
    source = os.path.abspath(source)
    if not os.path.isfile(source):
        raise SceneError(f"{source}: file not found")
    check_free(target)
    try:
        os.symlink(source, target)
        if os.path.exists(target) and os.path.samefile(source, target):
            return
        os.remove(target)  # the file system has stored the link as an ordinary file
    except (OSError, NotImplementedError):
        pass
    check_free(target)
    complete(target, lambda part: shutil.copyfile(source, part), f"can neither link nor copy {source}")


def complete(target, write, problem):
    """Calls `write` with a temporary name in the same folder and renames the file to `target` once complete."""
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


class NewFiles:
    """Context manager (`with NewFiles(folder) as new`) for files that belong together: on failure, all of them and their new folders are removed."""

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
        """Path for a new file of this name; creates missing folders."""
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
                raise SceneError(f"{folder}: can't create the folder: {error.strerror}") from error
            self.made.append(folder)
        return path

    def put(self, name, make):
        path = self.path(name)
        make(path)
        self.made.append(path)

    def link(self, source, name):
        self.put(name, lambda path: link_or_copy(source, path))

    def copy(self, source, name):
        copy = lambda part: shutil.copyfile(source, part)
        self.put(name, lambda path: complete(path, copy, f"can't copy {source}"))

    def write(self, name, text):
        def put(part):
            with open(part, "x", encoding="utf-8") as file:
                file.write(text)

        self.put(name, lambda path: complete(path, put, "can't write"))
