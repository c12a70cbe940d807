# SPDX-License-Identifier: GPL-3.0-or-later
"""The `pags` program, which makes exports and proxies: finds the one that the add-on's zip carries, says what it lacks and runs it."""

import os
import re
import shutil
import subprocess
import threading

import bpy

from . import native, system

# As the program prints it: "background: 40 %, 12 s left", or "view 3 of 12".
PROGRESS, EACH = re.compile(r"^(.*): +(\d+) %"), re.compile(r"^(\w+ (\d+) of (\d+))$")
_lacking = {}  # by path and time of the program: what `pags --help` says that its exports lack


def own():
    """Path of this system's program in the add-on's folder, which is there unless the zip was made without it."""
    return os.path.join(system.folder(), "bin", "pags.exe" if os.name == "nt" else "pags")


def command(context):
    """Path of the program to run: that of the preferences, else the add-on's own, else one on the PATH. Raises SceneError where there is none."""
    addon = context.preferences.addons.get(system.ADDON)  # None where a script registered the add-on by hand
    chosen = addon.preferences.program if addon else ""
    if chosen:
        path = os.path.abspath(bpy.path.abspath(chosen))
        if not os.path.isfile(path) or not os.access(path, os.X_OK):
            raise native.SceneError(f"{path}: is no program that can be run; name another in the add-on's preferences, or leave the field empty")
        return path
    if os.path.isfile(own()):
        return executable(own())
    found = shutil.which("pags")
    if found is None:
        raise native.SceneError("this add-on was built without the pags program, and there is none on the PATH: name one in the add-on's preferences")
    return found


def executable(path):
    """The path, once the file may be executed: Blender unpacks a zip without the files' modes."""
    if not os.access(path, os.X_OK):
        try:
            os.chmod(path, os.stat(path).st_mode | 0o555)
        except OSError as error:
            raise native.SceneError(f"{path}: can't be made executable: {error.strerror}; name another pags program in the add-on's preferences") from error
    return path


def absent(context):
    """Why there is no program that can be run: a sentence, or "" where there is one."""
    try:
        command(context)
    except native.SceneError as error:
        return str(error)
    return ""


def lacking(context):
    """Why there are no proxies, glTF and USD to be had: a sentence, or "" where the program makes them, or while that isn't known. Never waits,
    except without a window."""
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
        said = subprocess.run(words(key[0], "--help"), capture_output=True, stdin=subprocess.DEVNULL, timeout=60, **manner()).stdout
    except (OSError, subprocess.SubprocessError) as error:
        _lacking[key] = f"{key[0]}: can't be run: {error}"
        return
    found = re.search(r"^  export .*this build lacks (.*)$", said, re.MULTILINE)
    if found:
        _lacking[key] = f"this system's pags program lacks {found.group(1)}"


def words(*arguments):
    """The words of a command: UTF-8 whatever the locale says; Windows takes them as they are."""
    return list(arguments) if os.name == "nt" else [word.encode("utf-8", "surrogateescape") for word in arguments]


def manner():
    """Keyword arguments of every program that is started: text in UTF-8, and on Windows no console window."""
    return {"encoding": "utf-8", "errors": "replace", "creationflags": getattr(subprocess, "CREATE_NO_WINDOW", 0)}


def run(job, path, *arguments):
    """Runs a program to its end and passes its progress on; for a thread beside Blender's. Raises SceneError with its last line where it fails,
    Cancelled where the job was cancelled."""
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
        raise native.SceneError(said or f"{path} ended with the code {code} and said nothing")
