# SPDX-License-Identifier: Apache-2.0
"""wheel.py WHEEL PAGS: installs the wheel for Linux on x86-64 into a fresh environment and runs it in an empty
folder. Its outputs, also those of the Python module, must have the same bits as those of the program PAGS, a build
of the same commit. PAGS_OLD_ROOT names the root folder of an older Debian, in which the installed program also runs
(as root).

The data set fox is read from PAGS_SHARED_DATA, or from ../shared/data next to the sources, if present."""

import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "scripts")]

import cross_report  # noqa: E402
import same_bits  # noqa: E402

SHARED = Path(os.environ.get("PAGS_SHARED_DATA") or ROOT.parent / "shared" / "data")
CLEAN = {"PATH": "/usr/bin:/bin", "LC_ALL": "C.UTF-8"}  # without variables of the build
# Runs the reference with an Embree for SSE2, like the wheel's. Debian's Embree uses the processor's fused multiply-add,
# which gives distances with other last bits.
SSE2 = """#define _GNU_SOURCE
#include <dlfcn.h>
void *rtcNewDevice(const char *configuration) {
  (void)configuration;
  return ((void *(*)(const char *))dlsym(RTLD_NEXT, "rtcNewDevice"))("threads=1,isa=sse2");
}
"""
DRAWN = """import hashlib, pags, sys
scene = pags.load(sys.argv[1])
picture = pags.render(scene, scene.views[0], outputs=("rgba", "depth"))
print(*(hashlib.sha256(memoryview(pixels).tobytes()).hexdigest() for pixels in (picture.rgba, picture.depth)))
"""


def run(*words, **more):
    return subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, timeout=1800, **{"env": CLEAN, **more}
    )


class Wheel(unittest.TestCase):
    wheel, reference = Path(), Path()

    @classmethod
    def setUpClass(cls):
        cls.folder = Path(tempfile.mkdtemp(prefix="pags-wheel-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder, True)
        shutil.copy(cls.wheel, cls.folder)
        for words in [
            (sys.executable, "-m", "venv", "fresh"),
            ("fresh/bin/pip", "install", "-q", "--no-index", "--disable-pip-version-check", cls.wheel.name),
        ]:
            done = run(*words, cwd=cls.folder)
            if done.returncode:
                raise AssertionError(f"{' '.join(words)}: {done.stderr}")
        cls.program = cls.folder / "fresh/bin/pags"
        (cls.folder / "sse2.c").write_text(SSE2)
        subprocess.run(["cc", "-shared", "-fPIC", "sse2.c", "-o", "sse2.so", "-ldl"], cwd=cls.folder, check=True)

    def succeeds(self, *words, **more):
        done = run(*words, **more)
        self.assertEqual(done.returncode, 0, f"{' '.join(map(str, words))}: {done.stderr}")
        return done.stdout

    def same(self, name, *words):
        """Runs both programs on {out}, a separate folder for each: build/NAME is the reference's, wheel/NAME that of
        the installed program."""
        for side, program in [("build", self.reference), ("wheel", self.program)]:
            folder = self.folder / side
            (folder / name if words[0] == "export" else folder).mkdir(parents=True, exist_ok=True)
            self.succeeds(
                program,
                *(str(word).replace("{out}", str(folder)) for word in words),
                env={**CLEAN, **({"LD_PRELOAD": str(self.folder / "sse2.so")} if side == "build" else {})},
            )
        found = same_bits.compare_folders(self.folder / "build" / name, self.folder / "wheel" / name)
        self.assertEqual(found, [], " ".join(map(str, words)))

    def test_it_has_every_part(self):
        lines = self.succeeds(self.program, "--version").splitlines()
        self.assertEqual(lines[0], "pags " + self.wheel.name.split("-")[1])
        parts = next(line for line in lines if line.startswith("with:")).split()[1:]
        self.assertLessEqual({"synth", "import", "SOG", "proxies"}, set(parts))

    def test_it_asks_for_an_old_system(self):
        for path in [self.program, *self.folder.glob("fresh/lib/python3*/site-packages/pags.abi3.so")]:
            _, _, needed, floor = cross_report.elf(path.read_bytes())
            self.assertLessEqual(
                set(needed),
                {f"lib{name}.so.{n}" for name, n in [("c", 6), ("m", 6), ("pthread", 0), ("dl", 2), ("rt", 1)]}
                | {"ld-linux-x86-64.so.2"},
            )
            self.assertRegex(floor, r"^GLIBC 2\.(\d|1[0-7])$")

    def test_auditwheel(self):
        tool = shutil.which("auditwheel")
        if not tool:
            self.skipTest("no auditwheel on the PATH")
        said = " ".join(self.succeeds(tool, "show", self.folder / self.wheel.name, env=os.environ).split())
        self.assertIn('is consistent with the following platform tag: "manylinux_2_17_x86_64"', said)

    def test_a_street(self):
        self.same("street", "synth", "street", "-o", "{out}/street", "--frames", 4, "--size", "96x64", "-q")
        self.same("scene", "train", self.folder / "build/street", "-o", "{out}/scene", "-n", 60, "-q")
        scene = self.folder / "build/scene"
        self.same("pictures", "render", scene, "-o", "{out}/pictures", "--path", "ego", "-q")
        for proxy in ["mesh", "hull", "cage", "box"]:
            self.same(
                proxy,
                "export",
                scene,
                "{out}/" + proxy + "/proxies.glb",
                "--proxy",
                proxy,
                *[] if proxy == "mesh" else ["--no-background"],
                "-q",
            )
        for name in ["scene.spz", "scene.ply", "scene.usda", "scene.sog"]:
            self.same("files-" + name, "export", scene, "{out}/files-" + name + "/" + name, "-q")
        drawn = [
            self.succeeds(python, "-c", DRAWN, scene, cwd=self.folder, env=environment)
            for python, environment in [
                (self.folder / "fresh/bin/python", CLEAN),
                (sys.executable, {**CLEAN, "PYTHONPATH": self.reference.parent / "python"}),
            ]
        ]
        self.assertEqual(drawn[0], drawn[1])

    def test_a_capture(self):
        if not (SHARED / "fox").is_dir():
            self.skipTest(f"there is no capture {SHARED / 'fox'} (PAGS_SHARED_DATA says where it is)")
        self.same("fox", "train", SHARED / "fox", "-o", "{out}/fox", "-n", 200, "-q")
        scene = self.folder / "build/fox"
        self.same("fox-pictures", "render", scene, "-o", "{out}/fox-pictures", "-n", 3, "-q")
        self.same("fox-proxies", "export", scene, "{out}/fox-proxies/proxies.glb", "-q")

    def test_an_older_system(self):
        old = os.environ.get("PAGS_OLD_ROOT")
        if not old:
            self.skipTest("PAGS_OLD_ROOT names no older system")
        shutil.copy(self.program, old)
        self.addCleanup(os.remove, f"{old}/pags")
        work = Path(tempfile.mkdtemp(prefix="pags-wheel-", dir=f"{old}/tmp"))
        self.addCleanup(shutil.rmtree, work, True)
        inside = f"/tmp/{work.name}"
        for words in [
            ("synth", "street", "-o", inside + "/street", "--frames", 4, "--size", "96x64"),
            ("train", inside + "/street", "-o", inside + "/scene", "-n", 20),
            ("export", inside + "/scene", inside + "/proxies.glb"),
        ]:
            self.succeeds("/usr/sbin/chroot", old, "/pags", *words, "-q")
        self.assertEqual((work / "proxies.glb").read_bytes()[:4], b"glTF")


def main():
    if len(sys.argv) < 3:
        sys.exit("usage: wheel.py WHEEL PAGS [TEST...]")
    Wheel.wheel, Wheel.reference = (Path(sys.argv.pop(1)).resolve() for _ in range(2))
    for path in [Wheel.wheel, Wheel.reference]:
        if not path.exists():
            sys.exit(f"wheel.py: {path} isn't there: make, and make packages TARGETS=linux-x64-glibc2.17, build it")
    unittest.main(verbosity=2)


if __name__ == "__main__":
    main()
