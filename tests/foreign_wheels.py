# SPDX-License-Identifier: Apache-2.0
"""foreign_wheels.py PAGS WHEEL...: checks wheels for Linux on 64-bit ARM and for macOS, which this machine can't run
directly. Compares a wheel's name with its files: processor, oldest system, libraries, entry of the module. On macOS
it also checks the signature's hashes of the pages. The program for ARM runs under qemu and is compared with PAGS, a
build of the same commit whose kernels use fused multiply-add like NEON: twenty training steps and a picture must
have the same bits.

Mach-O, its export trie and its code signature are described in <mach-o/loader.h> and <kern/cs_blobs.h> of Apple's
XNU."""

import hashlib
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "scripts")]

import cross_report  # noqa: E402
import same_bits  # noqa: E402

ARM_ROOT = "/usr/aarch64-linux-gnu"  # Debian's libc6-arm64-cross
ADHOC, SHA256 = 2, 2  # a flag of the code directory, and a kind of hash


def uleb(data, at):
    """Returns an unsigned LEB128 number and the offset after it."""
    value = shift = 0
    while True:
        byte = data[at]
        value, shift, at = value | (byte & 127) << shift, shift + 7, at + 1
        if byte < 128:
            return value, at


def load_commands(data):
    at = 32
    for _ in range(struct.unpack_from("<I", data, 16)[0]):
        command, size = struct.unpack_from("<II", data, at)
        yield command, at
        at += size


def macho_exports(data):
    """Returns the names that a Mach-O file exports, from its trie."""
    names = set()
    for command, at in load_commands(data):
        if command in (
            0x80000033,
            0x80000022,
        ):  # a load command for the trie, or one for dyld's information that contains it
            start, size = struct.unpack_from("<II", data, at + (8 if command == 0x80000033 else 40))
            trie, nodes = data[start : start + size], [(0, b"")] if size else []
            while nodes:
                offset, name = nodes.pop()
                length, offset = uleb(trie, offset)
                if length:
                    names.add(name.decode())
                offset += length
                children, offset = trie[offset], offset + 1
                for _ in range(children):
                    end = trie.index(b"\0", offset)
                    child, after = uleb(trie, end + 1)
                    nodes.append((child, name + trie[offset:end]))
                    offset = after
    return names


def signature_faults(data):
    """Returns the faults of a Mach-O file's ad-hoc signature, one in each line."""
    blobs = [struct.unpack_from("<II", data, at + 8) for command, at in load_commands(data) if command == 0x1D]
    if not blobs:
        return ["not signed"]
    start, _ = blobs[0]
    magic, _, count = struct.unpack_from(">III", data, start)
    parts = dict(struct.unpack_from(">II", data, start + 12 + 8 * i) for i in range(count))
    directory = start + parts.get(0, 0)
    if magic != 0xFADE0CC0 or struct.unpack_from(">I", data, directory)[0] != 0xFADE0C02:
        return ["no code directory"]
    _, _, _, flags, hashes, _, _, pages, limit = struct.unpack_from(">9I", data, directory)
    size, kind, _, page = struct.unpack_from(">4B", data, directory + 36)
    faults = (
        []
        if flags & ADHOC and (kind, size) == (SHA256, 32)
        else [f"flags {flags:#x}, hashes of kind {kind} and {size} bytes"]
    )
    if limit != start or pages != -(-limit >> page):
        faults.append(f"{pages} pages up to {limit} of {start} bytes before the signature")
    for i in range(pages):
        found = hashlib.sha256(data[i << page : min(limit, i + 1 << page)]).digest()
        if found != data[directory + hashes + 32 * i : directory + hashes + 32 * (i + 1)]:
            faults.append(f"page {i} has another hash")
    return faults


def elf_exports(data):
    start, size, count = (*struct.unpack_from("<Q", data, 40), *struct.unpack_from("<HH", data, 58))
    sections = [struct.unpack_from("<IIQQQQIIQQ", data, start + i * size) for i in range(count)]
    names = set()
    for _, kind, _, _, offset, length, link, _, _, _ in sections:
        if kind == 11:  # names for the linker at run time
            names |= {
                cross_report.text_at(data, sections[link][4] + name)
                for name, _, _, section, _, _ in struct.iter_unpack("<IBBHQQ", data[offset : offset + length])
                if section
            }
    return names


class Wheels(unittest.TestCase):
    wheels, reference = [], Path()

    def files(self, platform):
        """Returns path, program and module of each wheel whose file name contains the platform."""
        found = []
        for path in self.wheels:
            if platform in path.name:
                with zipfile.ZipFile(path) as wheel:
                    program = next(name for name in wheel.namelist() if name.endswith(".data/scripts/pags"))
                    found.append((path, wheel.read(program), wheel.read("pags.abi3.so")))
        if not found:
            self.skipTest(f"no wheel for {platform} was named")
        return found

    def test_macos(self):
        for path, program, module in self.files("macosx"):
            major, minor, processor = re.search(r"macosx_(\d+)_(\d+)_(arm64|x86_64)\.whl", path.name).groups()
            for data in (program, module):
                kind, machine, needed, floor = cross_report.macho(data)
                self.assertEqual(
                    (kind, cross_report.PROCESSORS[machine]), ("Mach-O", processor.replace("x86_64", "x64"))
                )
                self.assertEqual(needed, ["/usr/lib/libSystem.B.dylib"])
                self.assertEqual(floor.split(",")[0], f"macOS {major}.{minor}")
                local = next(
                    struct.unpack_from("<I", data, at + 12)[0] for command, at in load_commands(data) if command == 0xB
                )
                self.assertLess(
                    local, 500, "names that no one asks for: the linker's -x takes most of them away (cmake/zig.cmake)"
                )
                if processor == "arm64":
                    self.assertEqual(signature_faults(data), [])
            self.assertIn("_PyInit_pags", macho_exports(module))

    def test_arm64(self):
        for _, program, module in self.files("manylinux_2_17_aarch64"):
            for data in (program, module):
                kind, machine, needed, floor = cross_report.elf(data)
                self.assertEqual((kind, cross_report.PROCESSORS[machine]), ("ELF", "arm64"))
                self.assertLessEqual(
                    set(needed),
                    {f"lib{name}.so.{n}" for name, n in [("c", 6), ("m", 6), ("pthread", 0), ("dl", 2), ("rt", 1)]}
                    | {"ld-linux-aarch64.so.1"},
                )
                self.assertRegex(floor, r"^GLIBC 2\.(\d|1[0-7])$")
            self.assertIn("PyInit_pags", elf_exports(module))

    def test_arm64_trains(self):
        if not shutil.which("qemu-aarch64") or not os.path.isdir(ARM_ROOT):
            self.skipTest("no qemu-aarch64 or no C library for it (Debian: qemu-user libc6-arm64-cross)")
        for path, _, _ in self.files("manylinux_2_17_aarch64"):
            folder = Path(tempfile.mkdtemp(prefix="pags-wheels-"))
            self.addCleanup(shutil.rmtree, folder, True)
            # pip accepts a wheel for another processor only with --platform, into a folder.
            self.succeeds(
                sys.executable,
                "-m",
                "pip",
                "install",
                "-q",
                "--no-index",
                "--no-deps",
                "--disable-pip-version-check",
                "--only-binary",
                ":all:",
                "--platform",
                "manylinux_2_17_aarch64",
                "--target",
                folder / "installed",
                path,
            )
            arm = ["qemu-aarch64", "-L", ARM_ROOT, folder / "installed/bin/pags"]
            said = self.succeeds(*arm, "--version")
            self.assertRegex(said, r"Linux aarch64\nkernels:  neon scalar run here; neon is used")
            self.succeeds(
                self.reference, "synth", "street", "-o", folder / "street", "--frames", 4, "--size", "96x64", "-q"
            )
            parts = re.search(r"^with: +(.*)$", said, re.M)[1].split()
            for side, program in [("here", [self.reference]), ("arm", arm)]:
                (folder / side).mkdir()
                self.succeeds(*program, "train", folder / "street", "-o", folder / side / "scene", "-n", 20, "-q")
                self.succeeds(
                    *program, "render", folder / "here/scene", "-o", folder / side / "pictures", "-n", 2, "-q"
                )
                self.succeeds(*program, "export", folder / "here/scene", folder / side / "scene.spz", "-q")
            self.assertEqual(same_bits.compare_folders(folder / "here", folder / "arm"), [])
            if "proxies" in parts:  # rays of NEON's kernels differ from AVX2's in the last bits (docs/porting.md)
                self.succeeds(
                    *arm, "synth", "street", "-o", folder / "arm/street", "--frames", 2, "--size", "48x32", "-q"
                )
                self.succeeds(*arm, "export", folder / "here/scene", folder / "arm/proxies.glb", "-q")
                self.assertEqual((folder / "arm/proxies.glb").read_bytes()[:4], b"glTF")

    def succeeds(self, *words):
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=3600)
        self.assertEqual(done.returncode, 0, f"{' '.join(map(str, words))}: {done.stderr}")
        return done.stdout


def main():
    if len(sys.argv) < 2:
        sys.exit("usage: foreign_wheels.py PAGS [WHEEL...]")
    Wheels.reference, *Wheels.wheels = (Path(word).resolve() for word in sys.argv[1:])
    for path in [Wheels.reference, *Wheels.wheels]:
        if not path.exists():
            sys.exit(f"foreign_wheels.py: {path} isn't there: make, and make packages TARGETS=..., build it")
    unittest.main(argv=sys.argv[:1], verbosity=2)


if __name__ == "__main__":
    main()
