#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""docs.py: checks the documentation. Prints each fault as FILE:LINE: fault, and fails if there is one.

- A page of the manual, docs/*.md, and CONTRIBUTING.md have at most 1,500 words each. Text between "<!-- generated" and
  "<!-- end -->" is not counted.
- Every link to a file of the repository, and every #heading of such a link, exists. Every docs/....md that a source names exists as well.
- A program that a page shows below "<!-- file: PATH -->" is that file.
- Every name pags_... and every C file on a page of the manual exists in the sources.
- Each row of the tables of docs/paper.md names files that exist, options or fields that the manual of the command line
  lists (of a program in Python: words that it has), whether they are the default, and a linked page with a figure.
  Its figures stand on the linked page.
- Figures that stand on several pages (SHARED) agree.
- Links lead from docs/index.md to every page of the manual, and from docs/lab/index.md to every page of the notebook."""

import os
import re
import sys

from style import find_files

MOST_WORDS = 1500
ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), ".."))
faults = []


def fault(path, line, text):
    faults.append(f"{path}:{line}: {text}")


def read(path):
    with open(os.path.join(ROOT, path), encoding="utf-8") as file:
        return file.read()


def anchors(text):
    """Returns the URL fragments of a page's headings, as GitHub makes them."""
    heads = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def check_length(path, text):
    words = len(re.sub(r"<!-- generated.*?<!-- end -->", "", text, flags=re.S).split())
    if words > MOST_WORDS:
        fault(path, 1, f"{words} words, a page of the manual has at most {MOST_WORDS}: measurements belong to docs/lab")


def check_links(path, text):
    """Checks a page's links; returns the files that it links to."""
    targets = set()
    for number, line in enumerate(text.split("\n"), 1):
        for link in re.findall(r"\]\(([^)\s]+)\)", line):
            if re.match(r"[a-z]+:", link):
                continue
            file, _, fragment = link.partition("#")
            target = os.path.normpath(os.path.join(os.path.dirname(path), file)) if file else path
            if not os.path.exists(os.path.join(ROOT, target)):
                fault(path, number, f"links to {link}, which is not there")
            elif fragment and target.endswith(".md") and fragment not in anchors(read(target)):
                fault(path, number, f"links to {link}, but {target} has no such heading")
            targets.add(target)
    return targets


def check_listings(path, text):
    """Checks that a page shows the file PATH, without its SPDX line, after `<!-- file: PATH -->`."""
    for match in re.finditer(r"^<!-- file: (\S+) -->\n```\w*\n(.*?)^```$", text, re.M | re.S):
        line = text.count("\n", 0, match.start()) + 1
        if not os.path.exists(os.path.join(ROOT, match.group(1))):
            fault(path, line, f"shows {match.group(1)}, which is not there")
        elif (
            match.group(2).strip()
            != re.sub(r"^.*SPDX-License-Identifier.*\n", "", read(match.group(1)), flags=re.M).strip()
        ):
            fault(path, line, f"shows another text than {match.group(1)} has")


def check_sources():
    """Checks the paths of pages that sources name; returns all names pags_... in the sources, and the sources' file names."""
    names = set()
    for path in find_files():
        names.add(os.path.basename(path))
        if path.endswith((".md", ".json")):
            continue
        text = read(path)
        names.update(re.findall(r"\bpags_\w+", text))
        for number, line in enumerate(text.split("\n"), 1):
            for page in re.findall(r"\bdocs/[\w/-]+\.md", line):
                if not os.path.exists(os.path.join(ROOT, page)):
                    fault(path, number, f"names {page}, which is not there")
    return names


def check_names(path, text, names):
    for number, line in enumerate(text.split("\n"), 1):
        for name in re.findall(r"(?<!\w)pags_[a-z0-9_]+(?!\w|\.\w)|(?<![\w<])[a-z][a-z0-9_]*\.(?:c|h|cc|inl)\b", line):
            if name not in names:
                fault(path, number, f"names {name}, which no source has")


def check_paper(path, text):
    """Checks the tables of docs/paper.md, whose rows are a claim, files, options, default, difference, figure."""
    known = read("docs/command-line.md")
    options = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", known)) | set(re.findall(r"^\| `(\w+)` \|", known, re.M))
    rows = 0
    for number, line in enumerate(text.split("\n"), 1):
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("|") else []
        if not cells or cells[0] == "paper" or set(line) <= set("|-"):
            continue
        rows += 1
        if len(cells) != 6 or not all(cells):
            fault(path, number, f"expected six cells with content, found {len(cells)}")
            continue
        files, names = re.findall(r"`([^`]+)`", cells[1]), re.findall(r"`([^`]+)`", cells[2])
        missing = [file for file in files if not os.path.isfile(os.path.join(ROOT, file))]
        programs = "".join(read(file) for file in files if file.endswith(".py") and file not in missing)
        for file in missing:
            fault(path, number, f"names the file {file}, which is not there")
        for name in names:
            if name not in options and f'"{name}"' not in programs:
                fault(
                    path,
                    number,
                    f"names {name}, which is no option of pags, no field of its training, and no word of {files}",
                )
        if not files or not names:
            fault(path, number, "expected a file and an option, each in backquotes")
        if cells[3] not in ("yes", "changed", "preset paper", "on request"):
            fault(path, number, f"expected yes, changed, preset paper or on request as its default, found {cells[3]}")
        if not re.search(r"\d", re.sub(r"\(.*?\)", "", cells[5])) or not re.search(r"\]\([\w/-]+\.md", cells[5]):
            fault(path, number, "expected a figure, and a link to the page that it is from")
    if rows < 25:
        fault(
            path,
            1,
            f"{rows} rows, expected at least 25: one for each equation, loss, schedule, table and figure of the paper",
        )


# Figures that stand on several pages: where each is found. Values may be rounded, but must agree then.
SHARED = {
    "PandaSet 002, default, PSNR": {
        "docs/compare.md": r"has ([\d.]+) dB PSNR on held-out\s+views\s+of\s+PandaSet\s+002",
        "docs/paper.md": r"full size: ([\d.]+) dB",
        "docs/lab/published.md": r"12,000, default, \d+ s \| ([\d.]+) \|",
    },
    "PandaSet 002, default, seconds": {
        "docs/compare.md": r"(\d+) s\s+on\s+two\s+threads",
        "docs/paper.md": r"default (\d+) s and 28",
        "docs/lab/published.md": r"12,000, default, (\d+) s",
    },
    "PandaSet 002, plain, PSNR": {
        "docs/paper.md": r"plain \d+ s and ([\d.]+)",
        "docs/lab/published.md": r"`plain` 751 s \| ([\d.]+)",
        "docs/lab/fewer-pairs.md": r"pandaset-002 full \d+ s, ([\d.]+) dB",
    },
    "demo, PSNR": {
        "README.md": r"([\d.]+) dB PSNR on held-out photographs",
        "docs/lab/newcomer.md": r"held out ([\d.]+) dB",
    },
    "demo, critical PSNR": {
        "README.md": r"([\d.]+) dB on vehicles and people",
        "docs/lab/newcomer.md": r"critical ([\d.]+) dB",
    },
    "demo, peak MB": {"README.md": r"(\d+) MB peak", "docs/lab/newcomer.md": r"peak (\d+) MB"},
    "SplatAD, PSNR": {
        "docs/compare.md": r"([\d.]+) dB \(SplatAD",
        "docs/lab/published.md": r"SplatAD, novel views .*?\*\*([\d.]+)\*\*",
    },
    "OmniRe, PSNR": {
        "docs/compare.md": r"([\d.]+) dB \(OmniRe",
        "docs/lab/published.md": r"OmniRe, novel views .*? ([\d.]+) \| 0\.780",
    },
    "gsplat, PSNR": {
        "docs/compare.md": r"([\d.]+) dB \(gsplat",
        "docs/lab/published.md": r"same with LiDAR .*?\*\*([\d.]+)\*\*",
    },
    "Street Gaussians, PSNR": {
        "docs/compare.md": r"to ([\d.]+) dB \(Street",
        "docs/lab/published.md": r"Street Gaussians, own table .*? ([\d.]+) \| 0\.938",
    },
}


def check_shared(texts):
    for what, places in SHARED.items():
        values = {}
        for path, pattern in places.items():
            found = re.search(pattern, texts[path])
            if found:
                values[path] = found[1]
            else:
                fault(path, 1, f"{what}: not found; if it moved, change SHARED in tests/docs.py")
        decimals = min((len(value.partition(".")[2]) for value in values.values()), default=0)
        for path, value in values.items():
            off = {other: v for other, v in values.items() if abs(float(v) - float(value)) > 0.5001 * 10**-decimals}
            for other in off:
                fault(path, 1, f"{what}: {value}, but {off[other]} in {other}")


def check_figures(texts):
    """Checks that the figures of docs/paper.md's tables stand on the pages that the same cell links to."""
    count = 0
    for number, line in enumerate(texts["docs/paper.md"].split("\n"), 1):
        cell = line.strip("|").split("|")[-1] if line.startswith("|") else ""
        links = {f"docs/{name}" for name in re.findall(r"\]\(([\w/-]+\.md)", cell)}
        for figure in re.findall(r"(?<![\w.,])(?:\d{1,3}(?:,\d{3})+|\d+\.\d+)(?!\w)", re.sub(r"\(.*?\)", "", cell)):
            count += 1
            if links and not any(figure in texts.get(page, "") for page in links):
                fault("docs/paper.md", number, f"{figure} is not in {', '.join(sorted(links))}")
    if count < 50:
        fault("docs/paper.md", 1, f"{count} figures in its tables, expected at least 50")


def main():
    pages = sorted(f"docs/{name}" for name in os.listdir(os.path.join(ROOT, "docs")) if name.endswith(".md"))
    notes = sorted(f"docs/lab/{name}" for name in os.listdir(os.path.join(ROOT, "docs/lab")) if name.endswith(".md"))
    texts = {path: read(path) for path in [*pages, *notes, "README.md", "CONTRIBUTING.md", "THIRD_PARTY.md"]}
    links = {path: check_links(path, text) for path, text in texts.items()}
    for path in [*pages, "CONTRIBUTING.md"]:
        check_length(path, texts[path])
    for path, text in texts.items():
        check_listings(path, text)
    check_paper("docs/paper.md", texts["docs/paper.md"])
    check_figures(texts)
    check_shared(texts)
    for index, of in [("docs/index.md", pages), ("docs/lab/index.md", notes)]:
        for path in of:
            if path != index and path not in links[index]:
                fault(path, 1, f"{index} doesn't link to it")
    names = check_sources()
    for path in [*pages, "README.md", "CONTRIBUTING.md"]:
        check_names(path, texts[path], names)
    print("\n".join(faults) if faults else f"docs: {len(texts)} pages, no fault")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
