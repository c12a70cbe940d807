# SPDX-License-Identifier: Apache-2.0
"""Parses the output of `pags VERB --help`, the source of pages of the manual, man pages and completions."""

import re
import subprocess


def printed(program, *arguments):
    return subprocess.run([program, *arguments], capture_output=True, text=True, encoding="utf-8", check=True).stdout


def read(text):
    """Splits a help text into its usage, its other paragraphs, and its sections, each (heading, [(left, text)]). `left` holds the words that
    users type: names and the placeholder of the value. Lines that are indented further continue the entry above them."""
    usage, paragraphs, sections = "", [], []
    for block in text.strip("\n").split("\n\n"):
        heading, entries = [], []
        for line in block.split("\n"):
            entry = re.match(r"  (?:    )?(\S.*?)(?:  +(\S.*))?$", line)
            if re.match(r"\S", line):
                heading.append(line)
            elif line.startswith(" " * 20) and entries:
                entries[-1][1].append(line.strip())
            elif entry:
                entries.append((entry[1], [entry[2]] if entry[2] else []))
        if entries:
            sections.append((" ".join(heading), [(left, " ".join(words)) for left, words in entries]))
        elif block.startswith("usage: "):
            usage = " ".join(heading)[len("usage: ") :]
        else:
            paragraphs.append(" ".join(heading))
    return usage, paragraphs, sections


def verbs(program):
    """The verbs of this build, {name: summary}; those that it lacks are left out."""
    rows = re.findall(r"^  (\w+) +(.*)$", printed(program, "--help"), re.M)
    lacking = [
        name for name, _ in rows if subprocess.run([program, name, "--help"], capture_output=True).returncode != 0
    ]
    return {name: summary.split("; this build lacks")[0] for name, summary in rows if name not in lacking}


def names(left):
    """The names and the placeholder of an entry: ("-j, --threads N") gives (["-j", "--threads"], "N"); a placeholder alone, ([], "SCENE")."""
    match = re.match(r"((?:-\S+?)(?:, (?:-\S+))*)(?: (.*))?$", left)
    return (match[1].split(", "), match[2] or "") if match else ([], left)
