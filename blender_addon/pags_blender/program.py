# SPDX-License-Identifier: GPL-3.0-or-later
"""The `pags` program for exports and proxies: finds the one in the add-on's zip, reports what its build lacks, and runs it."""

import os
import re
import shutil
import subprocess
import threading

import bpy

from . import native, system

# Progress lines of the program: "background: 40 %, 12 s left", or "view 3 of 12".
PROGRESS, EACH = re.compile(r"^(.*): +(\d+) %"), re.compile(r"^(\w+ (\d+) of (\d+))$")
_lacking = {}  # by path and modification time of the program: what its `pags --help` reports as missing in export


def own():
    """Path of this system's program in the add-on's folder; it exists unless the zip was built without it."""
    return os.path.join(system.folder(), "bin", "pags.exe" if os.name == "nt" else "pags")


def command(context):
    """Path of the program: from the preferences, else the add-on's own, else from the PATH. Raises SceneError without one."""
    addon = context.preferences.addons.get(system.ADDON)  # None if a script registered the add-on without installing it
    chosen = addon.preferences.program if addon else ""
    if chosen:
        path = os.path.abspath(bpy.path.abspath(chosen))
        if not os.path.isfile(path) or not os.access(path, os.X_OK):
            raise native.SceneError(
                f"{path}: not an executable program; choose another in the add-on's preferences, or leave the field empty"
            )
        return path
    if os.path.isfile(own()):
        return executable(own())
    found = shutil.which("pags")
    if found is None:
        raise native.SceneError(
            "this add-on was built without the pags program, and none is on the PATH: set one in the add-on's preferences"
        )
    return found


def executable(path):
    """Makes the file executable and returns its path: Blender unpacks a zip without file modes."""
    if not os.access(path, os.X_OK):
        try:
            os.chmod(path, os.stat(path).st_mode | 0o555)
        except OSError as error:
            raise native.SceneError(
                f"{path}: can't make it executable: {error.strerror}; set another pags program in the add-on's preferences"
            ) from error
    return path


def absent(context):
    """Why no program can be run, as a sentence; "" if one can."""
    try:
        command(context)
    except native.SceneError as error:
        return str(error)
    return ""


def lacking(context):
    """Why the program can't make proxies, glTF and USD, as a sentence; "" if it can, or while unknown. Never waits, except without a window."""
    try:
        path = command(context)
        key = (path, os.stat(path).st_mtime_ns)
    except (native.SceneError, OSError) as error:
        return str(error)
    if key not in _lacking:
        _lacking[key] = ""
        thread = threading.Thread(target=ask, args=(key,), daemon=True)
        thread.start()
        if bpy.app.background:
            thread.join()
    return _lacking[key]


def ask(key):
    try:
        said = subprocess.run(
            words(key[0], "--help"), capture_output=True, stdin=subprocess.DEVNULL, timeout=60, **manner()
        ).stdout
    except (OSError, subprocess.SubprocessError) as error:
        _lacking[key] = f"{key[0]}: can't run it: {error}"
        return
    found = re.search(r"^  export .*this build lacks (.*)$", said, re.MULTILINE)
    if found:
        _lacking[key] = f"this system's pags program lacks {found.group(1)}"


def words(*arguments):
    """The arguments of a command: UTF-8 in any locale; unchanged on Windows."""
    return list(arguments) if os.name == "nt" else [word.encode("utf-8", "surrogateescape") for word in arguments]


def manner():
    """Keyword arguments for starting any program: text in UTF-8, and no console window on Windows."""
    return {"encoding": "utf-8", "errors": "replace", "creationflags": getattr(subprocess, "CREATE_NO_WINDOW", 0)}


def run(job, path, *arguments):
    """Runs a program to its end and forwards its progress; call it in a background thread. Raises SceneError with the program's last line if it fails,
    Cancelled if the job was cancelled."""
    running = subprocess.Popen(
        words(path, *arguments), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **manner()
    )
    last = ""
    job.tell(0, "")
    with running.stdout, job.ended_by(running.terminate):
        for line in running.stdout:
            last = line.strip() or last
            progress, each = PROGRESS.match(last), EACH.match(last)
            if progress:
                job.tell(int(progress.group(2)) / 100, progress.group(1))
            elif each:
                job.tell(int(each.group(2)) / max(1, int(each.group(3))), each.group(1))
    code = running.wait()
    job.check()
    if code != 0:
        said = re.sub(r"^pags( \w+)?: ", "", last)
        raise native.SceneError(said or f"{path} ended with code {code} and printed no message")
