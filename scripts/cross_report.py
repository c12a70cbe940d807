#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""cross_report.py FOLDER: prints a line for each program and library of a cross build: file, kind and processor, size, required system
libraries, and the oldest system that has them. Reads ELF, Mach-O and PE. Fails where it finds no file."""

import os
import re
import struct
import sys

PROCESSORS = {62: "x64", 183: "arm64", 0x01000007: "x64", 0x0100000C: "arm64", 0x8664: "x64", 0xAA64: "arm64"}


def text_at(data, at):
    return data[at : data.index(b"\0", at)].decode()


def elf(data):
    """Returns kind, processor, required libraries, and the highest required symbol version of each library."""
    (machine,) = struct.unpack_from("<H", data, 18)
    start, size, count = (*struct.unpack_from("<Q", data, 40), *struct.unpack_from("<HH", data, 58))
    sections = [struct.unpack_from("<IIQQQQIIQQ", data, start + i * size) for i in range(count)]
    needed, highest = [], {}
    for _, kind, _, _, offset, length, link, info, _, _ in sections:
        strings = sections[link][4] if link < count else 0
        if kind == 6:  # dynamic
            for tag, value in struct.iter_unpack("<QQ", data[offset : offset + length]):
                if tag == 1:
                    needed.append(text_at(data, strings + value))
        elif kind == 0x6FFFFFFE:  # versions needed
            at = offset
            for _ in range(info):
                _, parts, _, first, following = struct.unpack_from("<HHIII", data, at)
                part = at + first
                for _ in range(parts):
                    _, _, _, name, skip = struct.unpack_from("<IHHII", data, part)
                    found = re.fullmatch(r"([A-Z]+)_([\d.]+)", text_at(data, strings + name))
                    if found:
                        version = tuple(int(word) for word in found.group(2).split("."))
                        highest[found.group(1)] = max(highest.get(found.group(1), ()), version)
                    part += skip
                at += following
    floors = [f"{name} {'.'.join(map(str, version))}" for name, version in sorted(highest.items())]
    return "ELF", machine, needed, ", ".join(floors)


def macho(data):
    (machine,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<I", data, 16)
    needed, floor, signed, at = [], "", False, 32
    for _ in range(count):
        command, size = struct.unpack_from("<II", data, at)
        if command in (0x0C, 0x80000018, 0x8000001F):  # load a library; weakly; load and export it again
            needed.append(text_at(data, at + struct.unpack_from("<I", data, at + 8)[0]))
        elif command == 0x32:  # the system that it was built for
            (version,) = struct.unpack_from("<I", data, at + 12)
            floor = f"macOS {version >> 16}.{version >> 8 & 255}"
        elif command == 0x1D:
            signed = True
        at += size
    return "Mach-O", machine, needed, floor + (", signed" if signed else ", not signed")


def pe(data):
    (start,) = struct.unpack_from("<I", data, 60)
    machine, count = struct.unpack_from("<HH", data, start + 4)
    optional = start + 24
    major, minor = struct.unpack_from("<HH", data, optional + 48)
    (imports,) = struct.unpack_from("<I", data, optional + 112 + 8)
    sections = [
        struct.unpack_from("<IIII", data, optional + struct.unpack_from("<H", data, start + 20)[0] + 40 * i + 8)
        for i in range(count)
    ]

    def offset(address):
        return next(
            raw + address - virtual for _, virtual, length, raw in sections if virtual <= address < virtual + length
        )

    needed, at = [], offset(imports) if imports else None
    while at is not None:
        (name,) = struct.unpack_from("<I", data, at + 12)
        if not name:
            break
        needed.append(text_at(data, offset(name)))
        at += 20
    return "PE", machine, needed, f"Windows {major}.{minor}"


def main():
    folder, rows = sys.argv[1], []
    for base, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if name not in ("CMakeFiles", "tests", "addon")]
        for name in sorted(names):
            path = os.path.join(base, name)
            if os.path.islink(path) or name.endswith((".o", ".obj", ".a", ".lib", ".zip")):
                continue
            with open(path, "rb") as file:
                data = file.read()
            if data[:4] == b"\x7fELF":
                facts = elf(data)
            elif data[:4] == b"\xcf\xfa\xed\xfe":
                facts = macho(data)
            elif data[:2] == b"MZ":
                facts = pe(data)
            else:
                continue
            kind, machine, needed, floor = facts
            needed = list(
                dict.fromkeys(
                    "UCRT" if word.startswith("api-ms-win-crt-") else os.path.basename(word) for word in needed
                )
            )
            rows.append(
                f"{os.path.relpath(path, folder):24} {kind} {PROCESSORS.get(machine, machine)}, {len(data) / 1e6:.2f} MB; needs "
                f"{' '.join(needed) or 'no library'}; {floor or 'any version'}"
            )
    print("\n".join(rows) if rows else f"{folder}: no program or library is there")
    return 0 if rows else 1


if __name__ == "__main__":
    sys.exit(main())
