# SPDX-License-Identifier: Apache-2.0
"""In a build with PAGS_REPRODUCIBLE, every instruction set of this machine gives the same bits. A street is trained,
evaluated and rendered with each."""

import os

import fixtures
from fixtures import Case, files_below, ply_bytes, read, run, splat

SETS = ["scalar", "avx2", "avx512", "neon"]
TIMED = {"report.html", "report.json", "log.jsonl"}  # log.jsonl also holds the seconds per step


class SameBits(Case):
    def has(self, cpu):
        one = self.write("one.ply", ply_bytes([splat(0, 0, 0, [1, 1, 1])]))
        done = run(
            "render",
            one,
            "--path",
            "orbit",
            "-n",
            1,
            "-o",
            self.path("has-" + cpu),
            env={**os.environ, "PAGS_CPU": cpu},
        )
        self.assertTrue(done.returncode == 0 or "PAGS_CPU" in done.stderr, done.stderr)
        return done.returncode == 0

    def files_of(self, cpu):
        environment = {**os.environ, "PAGS_CPU": cpu}
        scene, pictures = self.path(cpu), self.path(cpu + "-pictures")
        self.succeeds("train", self.path("street"), "-o", scene, "-n", 150, "-q", env=environment)
        self.succeeds("render", scene, "--path", "ego", "-n", 3, "-o", pictures, "--channel", "depth", env=environment)
        self.succeeds(
            "render",
            scene,
            "--path",
            "ego",
            "-n",
            3,
            "-o",
            pictures + "2",
            "--early-z",
            "bounded=0.004",
            env=environment,
        )
        judged = self.succeeds("eval", scene, env=environment).stdout
        found = {
            name: read(os.path.join(scene, name))
            for name in files_below(scene)
            if name not in TIMED and not name.endswith(".pags")
        }
        for folder in [pictures, pictures + "2"]:
            found.update(
                {folder[len(pictures) :] + name: read(os.path.join(folder, name)) for name in files_below(folder)}
            )
        return found, judged

    def test_street(self):
        self.succeeds("synth", "street", "-o", self.path("street"), "--size", "160x90", "--frames", 8)
        here = [cpu for cpu in SETS if self.has(cpu)]
        print(" ".join(here))
        self.assertEqual(here[0], "scalar")
        (expected, judged), *others = [self.files_of(cpu) for cpu in here]
        for cpu, (found, said) in zip(here[1:], others):
            self.assertEqual(sorted(found), sorted(expected))
            differing = [name for name in found if found[name] != expected[name]]
            self.assertEqual(differing, [], f"{cpu} differs from scalar")
            self.assertEqual(said.replace(cpu, "scalar"), judged)


if __name__ == "__main__":
    fixtures.main()
