#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""format.py [--fix]: checks Python by ruff (format and rules of ruff.toml), shell scripts by shellcheck, and the width
of Markdown. Prints each fault as FILE:LINE: fault, and fails if there is one; --fix formats the Python code first.
tests/figures.py checks C. If ruff or shellcheck is missing (make setup-min installs them into scripts/.venv), the test
prints a line about it and skips that check."""

import os
import re
import shutil
import subprocess
import sys

ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), ".."))
SKIPPED = re.compile(r"^(build.*|\.git|\.venv|node_modules|__pycache__|musl)$")
MOST_COLUMNS = 120


def find(pattern):
    """Yields the paths of the repository that match the pattern, relative to its root."""
    for base, folders, names in os.walk(ROOT):
        folders[:] = sorted(folder for folder in folders if not SKIPPED.match(folder))
        for name in sorted(names):
            path = os.path.relpath(os.path.join(base, name), ROOT)
            if re.search(pattern, path):
                yield path


def tool(name):
    own = os.path.join(ROOT, "scripts", ".venv", "bin", name)
    found = own if os.path.exists(own) else shutil.which(name)
    if not found:
        print(f"format: no {name}; make setup-min installs it into scripts/.venv")
    return found


def run(*command):
    """Returns the lines that a checker prints if it finds faults."""
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode == 0:
        return []
    return [line for line in (done.stdout + done.stderr).splitlines() if line.strip()] or [f"{command[0]} fails"]


def check_python(fix):
    files = list(find(r"\.py$"))
    ruff = tool("ruff")
    if not ruff:
        return []
    if fix:
        subprocess.run([ruff, "format", "-q", *files], cwd=ROOT, check=True)
    out_of_format = run(ruff, "format", "--check", "--output-format", "concise", *files)
    return out_of_format + run(ruff, "check", "-q", "--output-format", "concise", *files)


def check_shell():
    checker = tool("shellcheck")
    if not checker:
        return []
    files = [".ci/run", *find(r"\.sh$")]
    return run(checker, "-x", "-P", "SCRIPTDIR", "-e", "SC2012,SC2015,SC2016,SC2119,SC2120", "-f", "gcc", *files)


def check_markdown():
    """Returns lines of more than MOST_COLUMNS characters, except in code, tables, pictures and generated parts, and lines
    with a word or link of this length."""
    faults = []
    for path in find(r"\.md$"):
        code = generated = False
        with open(os.path.join(ROOT, path), encoding="utf-8") as file:
            for number, line in enumerate(file, 1):
                line = line.rstrip("\n")
                code ^= line.lstrip().startswith("```")
                generated = line.startswith("<!-- generated") or (generated and line != "<!-- end -->")
                if code or generated or len(line) <= MOST_COLUMNS or re.match(r"\s*(\||<|!?\[[^\]]+\][:(])", line):
                    continue
                if " " in line[:MOST_COLUMNS].strip():
                    faults.append(f"{path}:{number}: {len(line)} characters, more than {MOST_COLUMNS}")
    return faults


def main():
    faults = check_python("--fix" in sys.argv[1:]) + check_shell() + check_markdown()
    print("\n".join(faults + [f"format: {len(faults)} faults" if faults else "format: no fault"]))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
