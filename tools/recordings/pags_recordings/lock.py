# SPDX-License-Identifier: Apache-2.0
"""Locks an output folder in the same way as the program (engine/base/lock.h): two processes never write to one folder at the same time.

The lock is a hidden file in the folder that the system keeps locked until the process ends, for any reason."""

import contextlib
import errno
import os
import socket
import sys
import time

from .errors import RecordingError

try:
    import fcntl
except ImportError:  # Windows
    import msvcrt

    fcntl = None

NAME = ".pags.lock"
TRIES, PAUSE = 5, 0.02  # a killed process takes some time to end
HELD = errno.EAGAIN, errno.EACCES
taken = {}  # locks of this process by folder; they may be nested


def contents(folder):
    """The names in a folder, except locks and what a process killed at its start has left; empty if the folder doesn't exist."""
    return (
        [name for name in os.listdir(folder) if not name.endswith(NAME) and name != "import.json.part"]
        if os.path.isdir(folder)
        else []
    )


def try_lock(file):
    if fcntl:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    else:
        os.lseek(file, 1 << 30, os.SEEK_SET)  # beyond the text, which others can read
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)


def is_at(file, path):
    try:
        return os.path.samestat(os.fstat(file), os.lstat(path))
    except OSError:
        return False


def read_holder(path):
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return "".join(c if c.isprintable() else "?" for c in file.readline(320).rstrip("\r\n"))
    except OSError:
        return ""


class FolderLock:
    """Creates the folder and locks it, until `release` or the end of a `with`. Locks of one process may be nested. `program`: name of the process in the
    lock's text."""

    def __init__(self, folder, program=None):
        self.folder, self.file = os.fspath(folder), None
        self.place = os.path.realpath(self.folder)
        self.made = self.missing()
        os.makedirs(self.folder, exist_ok=True)
        self.path = os.path.join(self.place, NAME)
        if not taken.get(self.place):
            try:
                self.take(program or os.path.basename(sys.argv[0]) or "python")
            except BaseException:
                self.remove_made()
                raise
        taken.setdefault(self.place, []).append(self)

    def missing(self):
        """The missing folders on the path, innermost first."""
        out, at = [], self.place
        while not os.path.isdir(at):
            out.append(at)
            at = os.path.dirname(at)
        return out

    def remove_made(self):
        with contextlib.suppress(OSError):
            for folder in self.made:
                os.rmdir(folder)

    def take(self, program):
        for _ in range(TRIES):
            try:
                file = os.open(self.path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
            except PermissionError:
                if not self.clear_away():
                    raise
                continue
            try:
                try_lock(file)
                if is_at(file, self.path) or not fcntl:
                    self.file = file
                    break
            except OSError as error:
                if error.errno not in HELD:
                    print(
                        f"warning: {self.folder}: the file system has no locks ({error.strerror}); two programs that write there at the same time would "
                        "damage each other's files",
                        file=sys.stderr,
                    )
                    os.close(file)
                    os.remove(self.path)
                    return
            os.close(file)
            time.sleep(PAUSE)
        else:
            holder = read_holder(self.path)
            raise RecordingError(
                f"{self.folder}: another process is writing there{': ' if holder else ''}{holder}; wait for its end, or choose another folder"
            )
        with contextlib.suppress(OSError):  # on a full disk the lock works without its text
            now = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime())
            os.ftruncate(file, 0)
            os.lseek(file, 0, os.SEEK_SET)
            os.write(file, f"{program}, process {os.getpid()} on {socket.gethostname()}, since {now} UTC\n".encode())

    def clear_away(self):
        """Removes the lock file left by another user's process; false if the folder is not writable. On Windows an open lock file can't be removed."""
        time.sleep(PAUSE)
        if not os.path.exists(self.path) or not fcntl:
            return os.path.exists(self.path)
        file = os.open(self.path, os.O_RDONLY)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.remove(self.path)
        except BlockingIOError:
            pass
        finally:
            os.close(file)
        return True

    def release(self):
        """Unlocks, and removes the folders that the lock has created if they are empty."""
        if self not in taken.get(self.place, []):
            return
        taken[self.place].remove(self)
        if self.file is not None:
            with contextlib.suppress(OSError):
                if fcntl and is_at(self.file, self.path):
                    os.remove(self.path)
            os.close(self.file)
            with contextlib.suppress(OSError):
                if not fcntl:
                    os.remove(self.path)
            self.file = None
        self.remove_made()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.release()
