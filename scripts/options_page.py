#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""options_page.py [--check] PAGS: writes the options and fields of `pags train` into docs/command-line.md, between "<!-- generated: options"
and "<!-- end -->", from what the program PAGS prints. With --check it changes nothing, and fails if the page is out of date."""

import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parent.parent / "docs/command-line.md"
BEGIN, END = "<!-- generated: options -->\n", "<!-- end -->\n"


def sections(program, option):
    """Parses a help text into sections, each (heading, [(left, text)]); lines that are indented further continue the
    entry above them."""
    printed = subprocess.run([program, "train", option], capture_output=True, text=True, check=True).stdout
    found = []
    for line in printed.split("\n"):
        entry = re.match(r"  (?:    )?(\S.*?)(?:  +(\S.*))?$", line)
        if re.match(r"\S", line):
            found.append((line, []))
        elif line.startswith(" " * 20) and found and found[-1][1]:
            found[-1][1][-1][1].append(line.strip())
        elif entry and found:
            found[-1][1].append((entry[1], [entry[2]] if entry[2] else []))
    return [(heading, [(left, " ".join(text)) for left, text in entries]) for heading, entries in found if entries]


def table(heading, kind, entries):
    lines = [f"**{heading}**", "", f"| {kind} | does |", "|---|---|"]
    lines += ["| `{}` | {} |".format(left.replace("|", r"\|"), text.replace("|", r"\|")) for left, text in entries]
    return "\n".join(lines) + "\n\n"


def generated(program):
    text = "\n"
    for heading, entries in sections(program, "--help")[1:]:  # the first section lists DATASET and --output
        text += table(heading, "option", entries)
    text += "The fields, in the groups of `pags_train_config`; `auto` is a value, too:\n\n"
    for heading, entries in sections(program, "--fields"):
        text += table(heading, "field", entries)
    return text


def main():
    check, program = "--check" in sys.argv, sys.argv[-1]
    if len(sys.argv) != 2 + check:
        sys.exit(__doc__)
    page = PAGE.read_text(encoding="utf-8")
    if BEGIN not in page or END not in page:
        sys.exit(f"{PAGE}: expected a line {BEGIN.strip()} and, below, a line {END.strip()}")
    before, rest = page.split(BEGIN, 1)
    new = before + BEGIN + generated(program) + END + rest.split(END, 1)[1]
    if not check:
        PAGE.write_text(new, encoding="utf-8")
    elif new != page:
        sys.exit(f"{PAGE}: the list of options isn't what {program} says; run make docs")


if __name__ == "__main__":
    main()
