# SPDX-License-Identifier: Apache-2.0
"""Reads the steps, in order, and the commands of docs/blender-guide.md for tests."""

import os
import re

PATH = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "docs", "blender-guide.md")
# The action of a step: a key, an item of a menu or panel with a value, or words that gui_guide.py understands.
PART = re.compile(
    r"\*\*(?P<key>[^*]+)\*\*"
    r"|(?P<drawn>type `(?P<typed>[^`]+)`)"
    r"|\*(?P<path>[^*]+)\*(?: to `(?P<value>[^`]+)`)?"
    r"|(?P<words>\b(?:double-click|[Cc]lick|put the timeline|Put the timeline|[Tt]urn the view|[Mm]ove (?:it|the mouse)|[Ss]elect|[Nn]ame the|[Dd]elete|[Hh]ide both"
    r"|[Bb]uild|[Ll]ook through|turn it and)\b(?:[^.,;:*`]|`[^`]*`)*)"
)


def read():
    with open(PATH, encoding="utf-8") as file:
        return file.read()


def commands():
    """Returns the lines of the page's blocks of commands."""
    return [line for block in re.findall(r"^```\n(.*?)^```", read(), re.M | re.S) for line in block.splitlines()]


def actions():
    """Returns (section, number of the step, kind, text, value) of all actions in the page's order. A picture has
    kind "image" and its name; a step without an action has kind "nothing"."""
    found = []
    for section in re.split(r"^## ", re.sub(r"^```\n.*?^```", "", read(), flags=re.M | re.S), flags=re.M)[1:]:
        title, _, body = section.partition("\n")
        for step in re.finditer(
            r"^(\d+)\. (.*?)(?=^\d+\. |^$|\Z)|^!\[[^]]*\]\(images/blender-([\w-]+)\.png\)", body, re.M | re.S
        ):
            number, text, image = step.groups()
            if image:
                found.append((title, "", "image", image, None))
                continue
            parts = [part for part in map(part_of, PART.finditer(" ".join(text.split()))) if part]
            found += [(title, number, *part) for part in parts or [("nothing", text, None)]]
    return found


def part_of(match):
    if match["key"]:
        return "key", match["key"], None
    if match["drawn"]:
        return "type", match["typed"], None
    if match["path"]:
        return "press", match["path"], match["value"]
    words = match["words"].strip()
    return "words", words[0].lower() + words[1:], None


if __name__ == "__main__":
    for action in actions():
        print(action)
    print(*commands(), sep="\n")
