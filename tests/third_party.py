#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""third_party.py BUILD [--complete] PRODUCT... [--tests PROGRAM...]: compares the table of libraries in
THIRD_PARTY.md with the linked libraries. These are the shared libraries that a binary names (NEEDED) and the static
libraries outside of the folder BUILD in its link line. Fails if a linked library isn't listed for the product. With
--complete, for a full build, it also fails if a listed library isn't linked."""

import os
import re
import subprocess
import sys

ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), ".."))


def read_table():
    """Reads THIRD_PARTY.md: returns {(linked file, product)} and {linked file: library}."""
    pairs, names = set(), {}
    with open(os.path.join(ROOT, "THIRD_PARTY.md"), encoding="utf-8") as file:
        for line in file:
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            files = re.findall(r"`(\S+\.(?:so|a))`", cells[3]) if len(cells) == 5 else []
            for name in files:
                names[name] = cells[0]
                pairs.update((name, product) for product in re.findall(r"[\w.-]+", cells[4]))
    return pairs, names


def needed(binary):
    output = subprocess.run(["readelf", "-d", binary], capture_output=True, text=True, check=True).stdout
    return {re.sub(r"\.so[.\w]*$", ".so", name) for name in re.findall(r"\(NEEDED\).*\[(.*)\]", output)}


def static_libraries(build, binary):
    """Returns the static libraries of a program's link line, which the build generator (make or Ninja) has stored."""
    name = os.path.relpath(os.path.realpath(binary), build)
    lines = []
    for base, _, files in os.walk(build):
        if "link.txt" in files:
            with open(os.path.join(base, "link.txt"), encoding="utf-8") as file:
                folder = os.path.dirname(os.path.dirname(base))
                lines += [
                    text
                    for text in file
                    if any(
                        os.path.normpath(os.path.join(folder, word)) == os.path.join(build, name)
                        for word in re.findall(r"-o (\S+)", text)
                    )
                ]
    if os.path.exists(os.path.join(build, "build.ninja")):
        with open(os.path.join(build, "build.ninja"), encoding="utf-8") as file:
            lines += re.findall(rf"^build {re.escape(name)}:.*?LINK_LIBRARIES = ([^\n]*)", file.read(), re.M | re.S)
    if not lines:
        sys.exit(f"third_party: {build} has no link line of {name}")
    return {
        os.path.basename(word)
        for text in lines
        for word in text.split()
        if word.endswith(".a") and os.path.isabs(word) and not word.startswith(build + os.sep)
    }


def main():
    arguments = sys.argv[1:]
    complete = "--complete" in arguments
    arguments = [argument for argument in arguments if argument != "--complete"]
    split = arguments.index("--tests") if "--tests" in arguments else len(arguments)
    build, products, tests = os.path.realpath(arguments[0]), arguments[1:split], arguments[split + 1 :]
    pairs, names = read_table()
    linked = {}  # (linked file, product) -> binary
    for binary in products + tests:
        product = "tests" if binary in tests else re.sub(r"\.so[.\d]*$", ".so", os.path.basename(binary))
        for name in needed(binary) | (static_libraries(build, binary) if binary in products else set()):
            if name != "libpags.so":
                linked.setdefault((name, product), binary)
    faults = [
        f"{binary}: links {name}, which THIRD_PARTY.md {f'lists ({names[name]}), but not for {product}' if name in names else 'does not list'}"
        for (name, product), binary in sorted(linked.items())
        if (name, product) not in pairs
    ]
    if complete:
        libraries = {(names[name], product) for name, product in linked if name in names}
        built = {product for _, product in linked} - {"tests"}
        faults += [
            f"THIRD_PARTY.md: {library} is listed for {product}, which does not link it"
            for library, product in sorted(
                {(names[name], product) for name, product in pairs if product in built} - libraries
            )
        ]
    print(
        "\n".join(
            faults
            + [
                f"third_party: {len(faults)} faults"
                if faults
                else f"third_party: {len({name for name, _ in linked})} libraries of {len(products) + len(tests)} binaries are listed"
            ]
        )
    )
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
