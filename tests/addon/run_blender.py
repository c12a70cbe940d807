# SPDX-License-Identifier: Apache-2.0
"""run_blender.py TEST.py PAGS ADDON.zip [BLENDER]: runs a test inside Blender with separate settings. BLENDER is a
Blender or a Python with the module bpy; a python.exe runs under wine. Without a Blender, or without a screen for a
test that needs one, prints the reason and exits with code 77."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading

HERE = os.path.dirname(os.path.abspath(__file__))


def skip(reason):
    print("skipped:", reason)
    sys.exit(77)


def window_size(test):
    """Returns the window size of the script's line `WINDOW = "800x560"`. Small windows help, since drawing is in
    software."""
    with open(os.path.join(HERE, test)) as file:
        size = re.search(r'^WINDOW = "(\d+)x(\d+)"', file.read(), re.MULTILINE)
    return list(size.groups()) if size else ["800", "560"]


def environment(folder):
    """Returns the environment without this Python's folders: Debian's Blender looks for its library next to the
    first python3 on PATH."""
    own = os.path.join(os.path.realpath(sys.base_prefix), "bin")
    rest = {key: value for key, value in os.environ.items() if key not in {"PYTHONHOME", "PYTHONPATH"}}
    places = [
        p for p in os.environ.get("PATH", "").split(os.pathsep) if os.path.realpath(p) != own or own == "/usr/bin"
    ]
    return {
        **rest,
        "PATH": os.pathsep.join(places),
        "BLENDER_USER_RESOURCES": folder,
        "BLENDER_USER_SCRIPTS": os.path.join(folder, "scripts"),
        "BLENDER_USER_CONFIG": os.path.join(folder, "config"),
        "BLENDER_USER_DATAFILES": os.path.join(folder, "datafiles"),
        "LIBGL_ALWAYS_SOFTWARE": "1",
        "PYTHONDONTWRITEBYTECODE": "1",
    }


def drive(path):
    """Returns the path in Windows form: wine shows the root folder as drive Z."""
    return "Z:" + os.path.abspath(path).replace("/", "\\")


def run(command, environment):
    """Returns exit code and output. Doesn't wait for other programs that the command started and that keep its
    output open, such as wine's."""
    running = subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
    )
    lines = []
    reader = threading.Thread(target=lambda: lines.extend(running.stdout), daemon=True)
    reader.start()
    code = running.wait()
    reader.join(5)
    return code, "".join(lines)


def main():
    test, pags, package = sys.argv[1:4]
    blender = shutil.which(sys.argv[4] if len(sys.argv) > 4 else "blender")
    if blender is None:
        skip("there is no Blender here (Debian: apt-get install blender)")
    window = os.path.basename(test).startswith("gui_")
    common = [
        "--factory-startup",
        "-noaudio",
        "--python-exit-code",
        "3",
        "-P",
        os.path.join(HERE, test),
        "--",
        pags,
        package,
    ]
    if window:
        for tool in ("xvfb-run", "import"):
            if shutil.which(tool) is None:
                skip(f"there is no {tool} here (Debian: apt-get install xvfb xauth imagemagick)")
        size = window_size(test)
        screen = ["xvfb-run", "-a", "-s", f"-screen 0 {size[0]}x{size[1]}x24 +extension GLX"]
        place = ["--no-window-focus", "--enable-event-simulate", "-p", "0", "0", *size]
        command = [*screen, blender, *place, *common]
    elif blender.endswith(".exe"):
        command = ["wine", blender, "-B", drive(os.path.join(HERE, test)), "--", drive(pags), drive(package)]
    elif os.path.basename(blender).startswith("python"):
        command = [blender, "-B", os.path.join(HERE, test), "--", pags, package]  # a Python with the module bpy
    else:
        command = [blender, "-b", *common]
    with tempfile.TemporaryDirectory(prefix="pags-blender-") as folder:
        for name in ("scripts", "config", "datafiles"):
            os.makedirs(os.path.join(folder, name, "addons") if name == "scripts" else os.path.join(folder, name))
        code, said = run(command, environment(drive(folder) if blender.endswith(".exe") else folder))
    print(said)
    if code == 0 and "all tests passed" not in said:
        print("Blender ended without the tests' last word")
        return 1
    return code


if __name__ == "__main__":
    sys.exit(main())
