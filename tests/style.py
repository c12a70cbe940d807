#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""style.py [CC [CXX]]: checks the sources without running them. Prints each fault as FILE:LINE: fault, and fails
if there is one. Format, circles of files and the length of functions are tests/figures.py's.

- Characters: no tabs, no blanks at the end of a line, a newline at the end of a file; C and C++ in ASCII, without notes of unfinished work.
- Includes, quoted or <pags/...>, name a file of the repository and go one way: KNOWS lists the folders from which a folder may include. A
  public header belongs to the folder that implements it (HEADERS).
- Every C or C++ file that a comment names exists in the repository.
- Public headers compile alone, as C17 and as C++17."""

import concurrent.futures
import os
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), ".."))
SKIPPED = re.compile(r"^(build.*|\.git|\.venv|node_modules|__pycache__|musl)$")  # musl: third-party code
TEXT = re.compile(r"\.([ch]|inl|cc|py|sh|cmake|json|md)$|(^|/)(CMakeLists\.txt|Makefile)$|^\.ci/run$")
CODE = re.compile(r"\.([ch]|inl|cc)$")

# ---- Which folder may include from which ----
CORE = [
    "engine/port",
    "threads",
    "simd",
    "engine/maths",
    "engine/base",
    "engine/scene",
    "engine/frame",
]  # folders linked into libpags.so and the Python module
DATA = ["engine/image", "engine/dataset"]
ENGINE = (
    CORE
    + DATA
    + ["engine/import", "engine/init", "engine/train", "engine/eval", "engine/synth", "engine/blocks", "engine/cluster"]
)
CLI = ["cli/" + name for name in ("common", "draw", "measure", "view", "html_report", "scene_html", "verbs")]

# A folder -> the folders, with their subfolders, from which it may include, besides its own files.
KNOWS = {
    "engine/port": [],
    "threads": ["engine/port"],
    "simd": [],
    "engine/maths": [],
    "engine/base": ["engine/port", "threads", "engine/maths"],
    "engine/scene": ["engine/port", "threads", "engine/maths", "engine/base"],
    "engine/frame": CORE,
    "engine/image": ["engine/port", "threads", "engine/maths", "engine/base"],
    "engine/dataset": ["engine/port", "threads", "engine/maths", "engine/base", "engine/scene", "engine/image"],
    "engine/import": ["engine/port", "threads", "engine/maths", "engine/base", "engine/scene"] + DATA,
    "engine/init": ["engine/port", "threads", "engine/maths", "engine/base", "engine/scene"] + DATA,
    "engine/cluster": ["engine/port", "threads", "engine/maths", "engine/base"],
    "engine/train": CORE + DATA + ["engine/init", "engine/cluster"],
    "engine/blocks": ["engine/port", "threads", "engine/maths", "engine/base", "engine/scene"] + DATA,
    "engine/eval": ["engine/port", "threads", "engine/maths", "engine/base", "engine/image"],
    "engine/synth": ["engine/port", "threads", "engine/maths", "engine/base", "engine/scene"] + DATA,
    "exporters/proxy": CORE + DATA,
    "exporters/format": CORE + DATA + ["exporters/proxy"],
    "cli": ENGINE + ["exporters"] + CLI,
    "cli/common": ENGINE,
    "cli/draw": ENGINE + ["cli/common"],
    "cli/measure": ENGINE + ["cli/common", "cli/draw"],
    "cli/view": ENGINE + ["cli/common", "cli/draw"],
    "cli/html_report": ENGINE + ["cli/common", "cli/draw", "cli/measure"],
    "cli/scene_html": ENGINE + ["exporters", "cli/common", "cli/draw"],
    "cli/verbs": ENGINE + ["exporters"] + [folder for folder in CLI if folder != "cli/verbs"],
    "blender_addon": CORE + ["engine/dataset"],  # the rules of the driving layout
    "benchmarks": ENGINE + ["exporters", "cli", "tests/reference"],
    "examples": ENGINE + ["exporters"],
    "tests/reference": CORE + ["engine/train"],
    "tests": ENGINE + ["exporters", "cli", "blender_addon", "benchmarks", "tests/reference"],
}

# Only one folder calls functions that differ between systems; POSIX threads are the same everywhere. Tests use
# tests/system.h; examples are written as users would write them.
PORT = "engine/port"
SYSTEM_HEADERS = re.compile(
    r"^(unistd|fcntl|dirent|dlfcn|sched|signal|poll|termios|pwd|glob|libgen|langinfo|malloc|xlocale|windows|io|direct|process"
    r"|sys/\w+|mach/\w+|arpa/\w+|netinet/\w+|linux/\w+|asm/\w+)\.h$"
)
SYSTEM_CALLS = re.compile(
    r"\b(fopen|freopen|fdopen|fileno|isatty|rename|remove|unlink|rmdir|mkdir|stat|lstat|fstat|access|opendir|readdir|realpath|readlink"
    r"|mkstemp|mmap|munmap|fsync|fseeko|ftello|aligned_alloc|posix_memalign|clock_gettime|nanosleep|usleep|sysconf|getrusage|getrlimit"
    r"|setenv|unsetenv|putenv|strdup|strndup|strtok_r|getline|open_memstream|fmemopen|newlocale|uselocale|strtod_l|sigaction|signal"
    r"|pthread_sigmask|pthread_condattr_setclock|pthread_cond_timedwait|fork|waitpid|popen|dlopen|dlsym)\("
)

LIMITS = "reads limits of control groups from files below /proc and /sys, which are named in ASCII"
SYSTEM_EXCEPTIONS = {
    "engine/image/oiio.cc": "OpenImageIO's own open and close",
    "threads/limits.c": LIMITS,
}

# The folder that implements a public header.
HEADERS = {
    "engine/base": ["base"],
    "engine/scene": [
        "camera",
        "clusters",
        "gaussians",
        "lens",
        "light",
        "photometric",
        "object",
        "packed",
        "place",
        "scene",
        "sky",
    ],
    "engine/frame": ["compose", "deadline", "frame", "passes", "pick"],
    "engine/image": ["image"],
    "engine/dataset": ["dataset"],
    "engine/import": ["import"],
    "engine/blocks": ["blocks"],
    "engine/train": ["train"],
    "engine/eval": ["eval"],
    "engine/synth": ["synth"],
    "threads": ["tasks"],
    "exporters/proxy": ["export"],
}
OWNER = {name: folder for folder, names in HEADERS.items() for name in names}

# Includes that break the rule, with the reason. An entry that is no longer needed is a fault.
CONFIGURATION = "reads the configuration of a run, a struct; calls nothing of training"
EXCEPTIONS = {
    ("engine/init/driving_points.h", "engine/include/pags/train.h"): CONFIGURATION,
    ("engine/init/from_points.h", "engine/include/pags/train.h"): CONFIGURATION,
}

faults = []
needed = set()  # entries of EXCEPTIONS that are used


def fault(path, line, text):
    faults.append((path, line, text))


def read(path):
    with open(os.path.join(ROOT, path), encoding="utf-8", errors="replace", newline="") as file:
        return file.read()


def find_files():
    for base, folders, names in os.walk(ROOT):
        folders[:] = sorted(folder for folder in folders if not SKIPPED.match(folder))
        for name in sorted(names):
            path = os.path.relpath(os.path.join(base, name), ROOT)
            if TEXT.search(path):
                yield path


# ---- Characters ----
def check_characters(path, text):
    rules = [("blank at the end of the line", r"[ \t]$"), ("carriage return", r"\r")]
    if not path.endswith("Makefile"):
        rules.append(("tab", r"\t"))
    if CODE.search(path):
        rules += [
            ("note of unfinished work", r"\b(TODO|FIXME|XXX|HACK)\b"),
            ("character outside of ASCII", r"[^\n -~]"),
        ]
    for what, pattern in rules:
        for match in re.finditer(pattern, text, re.M):
            fault(path, text.count("\n", 0, match.start()) + 1, what)
    if text and not text.endswith("\n"):
        fault(path, text.count("\n") + 1, "no newline at the end")


# ---- Comments name files that exist ----
def check_comments(path, text, names):
    for comment in re.finditer(r"/\*.*?\*/|//[^\n]*", text, re.S):
        for match in re.finditer(r"(?<!<)\b[a-z]\w*\.(?:c|h|cc|inl)\b(?!\w)", comment.group(0)):
            if match.group(0) not in names:
                fault(
                    path,
                    text.count("\n", 0, comment.start() + match.start()) + 1,
                    f"names {match.group(0)}, which is nowhere",
                )


# ---- System headers and calls ----
def check_system(path, text):
    if path.startswith((PORT + "/", "tests/", "examples/")) or room_of(path) is None or path in SYSTEM_EXCEPTIONS:
        return
    for match in re.finditer(r"^[ \t]*#[ \t]*include[ \t]*<([^>\n]+)>", text, re.M):
        if SYSTEM_HEADERS.match(match.group(1)):
            fault(
                path, text.count("\n", 0, match.start()) + 1, f"includes <{match.group(1)}>, which belongs into {PORT}"
            )
    code = re.sub(
        r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\])*\"", lambda m: re.sub(r"[^\n]", " ", m.group(0)), text, flags=re.S
    )
    for match in SYSTEM_CALLS.finditer(code):
        fault(path, code.count("\n", 0, match.start()) + 1, f"calls {match.group(1)}, which belongs into {PORT}")


# ---- The direction of includes ----
def room_of(path):
    """Returns the folder of KNOWS that `path` belongs to, or None."""
    header = re.fullmatch(r".*include/pags/(\w+)\.h", path)
    if header:
        return OWNER.get(header.group(1))
    return max((folder for folder in KNOWS if path.startswith(folder + "/")), key=len, default=None)


def resolve(path, name, files):
    """Returns the file that an include of `name` in `path` finds, or None."""
    for folder in [
        os.path.dirname(path),
        "engine/include",
        "threads/include",
        "exporters/include",
        ".",
        "engine",
        "tests",
    ]:
        target = os.path.normpath(os.path.join(folder, name))
        if target in files:
            return target
    return None


def check_includes(path, text, files):
    room = room_of(path)
    if room is None:
        fault(path, 1, "belongs to no folder that KNOWS or HEADERS of tests/style.py name")
        return
    for match in re.finditer(r'^[ \t]*#[ \t]*include[ \t]*(?:"([^"\n]+)"|<(pags/[^>\n]+)>)', text, re.M):
        line, name = text.count("\n", 0, match.start()) + 1, match.group(1) or match.group(2)
        target = resolve(path, name, files)
        other = target and room_of(target)
        if target is None:
            fault(path, line, f"includes {name}, which is nowhere")
        elif other != room and not any(f"{other}/".startswith(f"{known}/") for known in KNOWS[room]):
            if (path, target) in EXCEPTIONS:
                needed.add((path, target))
            else:
                fault(path, line, f"{room} must not know of {target}, which is {other}'s")


# ---- Public headers compile alone, in both languages ----
def compile_alone(header, compiler, standard, suffix):
    with tempfile.TemporaryDirectory() as work:
        source = os.path.join(work, f"alone.{suffix}")
        with open(source, "w", encoding="ascii") as file:
            file.write(f'#include "{os.path.join(ROOT, header)}"\n')
        folders = [
            f"-I{os.path.join(ROOT, folder)}" for folder in ("engine/include", "threads/include", "exporters/include")
        ]
        done = subprocess.run(
            [
                compiler,
                f"-std={standard}",
                "-Wall",
                "-Wextra",
                "-Wpedantic",
                "-Werror",
                "-fsyntax-only",
                *folders,
                source,
            ],
            capture_output=True,
            text=True,
        )
    if done.returncode != 0:
        error = next((line for line in done.stderr.split("\n") if "error" in line), done.stderr)
        return header, f"does not compile alone as {standard}: {error}"
    return None


def check_headers(files, cc, cxx):
    public = [path for path in files if re.search(r"include/pags/\w+\.h$", path)]
    jobs = [(header, cc, "c17", "c") for header in public + ["simd/kernels.h"]]
    if shutil.which(cxx):
        jobs += [(header, cxx, "c++17", "cc") for header in public]
    else:
        print(f"style: no {cxx}; public headers are not checked as C++17")
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for found in pool.map(lambda job: compile_alone(*job), jobs):
            if found:
                fault(found[0], 1, found[1])


def main():
    files = list(find_files())
    known, names = set(files), {os.path.basename(path) for path in files}
    for path in files:
        text = read(path)
        check_characters(path, text)
        if CODE.search(path):
            check_includes(path, text, known)
            check_comments(path, text, names)
            check_system(path, text)
    for path, target in EXCEPTIONS.keys() - needed:
        fault("tests/style.py", 1, f"the exception that {path} may include {target} is no longer needed")
    check_headers(files, *(sys.argv[1:3] + ["cc", "c++"][len(sys.argv) - 1 :]))
    for path, line, text in sorted(faults):
        print(f"{path}:{line}: {text}")
    print(f"style: {len(faults)} faults" if faults else f"style: {len(files)} files, no fault")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
