#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""options_page.py [--check] PAGS: writes the options and fields of `pags train` into docs/command-line.md, between "<!-- generated: options"
and "<!-- end -->", from what the program PAGS prints. With --check it changes nothing, and fails if the page is out of date."""

import sys
from pathlib import Path

import help_text

PAGE = Path(__file__).resolve().parent.parent / "docs/command-line.md"
BEGIN, END = "<!-- generated: options -->\n", "<!-- end -->\n"


def table(heading, kind, entries):
    lines = [f"**{heading}**", "", f"| {kind} | does |", "|---|---|"]
    lines += ["| `{}` | {} |".format(left.replace("|", r"\|"), text.replace("|", r"\|")) for left, text in entries]
    return "\n".join(lines) + "\n\n"


def generated(program):
    text = "\n"
    for heading, entries in help_text.read(help_text.printed(program, "train", "--help"))[2][
        1:
    ]:  # the first section lists DATASET and --output
        text += table(heading, "option", entries)
    text += "The fields, in the groups of `pags_train_config`; `auto` is a value, too:\n\n"
    for heading, entries in help_text.read(help_text.printed(program, "train", "--fields"))[2]:
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
