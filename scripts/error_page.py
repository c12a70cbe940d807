#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""error_page.py A.json B.json ...: prints the results of `pags-bench error --json` on several scenes as the two
tables of docs/lab/speed-and-error.md."""

import json
import sys


def amount(value):
    """Formats a count as pags-bench error does: 12345678 gives 12.3 M."""
    for size, unit in [(1e6, " M"), (1e4, " k")]:
        if value >= size:
            scaled = value / (1e6 if unit == " M" else 1e3)
            return f"{scaled:.{2 if scaled < 10 else 1 if scaled < 100 else 0}f}{unit}"
    return f"{value:.0f}" if value == int(value) else f"{value:.2f}" if value < 10 else f"{value:.1f}"


def error(value):
    return "0" if value == 0 else f"{value:.2g}" if value < 99.5 else f"{value:.0f}"


def counts(rows):
    """Formats the counts of an approximation as "what: exact -> used", the scenes separated by slashes; leaves out
    counts that the approximation changes in no scene."""
    parts = []
    for i, first in enumerate(rows[0]["counts"]):
        every = [
            row["counts"][i] for row in rows if len(row["counts"]) > i and row["counts"][i]["what"] == first["what"]
        ]
        pairs = [f"{amount(c['exact'])} -> {amount(c['used'])}" for c in every]
        pairs = [pair for pair in pairs if len(set(pair.split(" -> "))) > 1]
        if pairs:
            parts.append(f"{first['what']}: {pairs[0] if len(set(pairs)) == 1 else ' / '.join(pairs)}")
    return "; ".join(parts)


def table(head, lines):
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for line in lines:
        print("| " + " | ".join(line) + " |")


def main(paths):
    if not paths:
        sys.exit(__doc__)
    scenes = []
    for path in paths:
        with open(path, encoding="utf-8") as file:
            scenes.append(json.load(file))
    rows = [{row["name"]: row for row in scene["rows"]} for scene in scenes]
    names = [name for name in rows[0] if all(name in other for other in rows)]
    found = {name: [other[name] for other in rows] for name in names}
    titles = [scene["scene"] for scene in scenes]
    for scene in scenes:
        print(
            f"- {scene['scene']}: {scene['views']} views of {scene['width']}x{scene['height']}, {scene['threads']} thread(s)"
        )
    print()
    table(
        ["approximation", "against", "unit", *titles],
        [
            [n, f[0]["against"], f[0]["unit"], *[f"{error(r['max'])}, {error(r['mean'])}" for r in f]]
            for n, f in found.items()
        ],
    )
    print()
    gains = {n: f for n, f in found.items() if f[0]["gain"] is not None or counts(f)}
    table(
        ["approximation", "times as fast, of what", *titles, "work, exact -> used"],
        [
            [n, f[0]["gain_of"], *[f"{r['gain']:.2f}" if r["gain"] is not None else "" for r in f], counts(f)]
            for n, f in gains.items()
        ],
    )


if __name__ == "__main__":
    main(sys.argv[1:])
