# SPDX-License-Identifier: Apache-2.0
"""Tests pags-bench scaling of a scene and of a data set: tables and JSON. No time is checked."""

import json
import os

import fixtures
from fixtures import DataCase, ply_bytes, read, some_splats

LIMITS = ["serial", "few blocks", "longest block", "tail", "fork and join", "wake-ups", "cores", "memory"]


class Scaling(DataCase):
    def check_phase(self, phase):
        """Checks the properties of every prediction."""
        rows = phase["workers"]
        self.assertEqual([r["workers"] for r in rows], [1, 2, 4, 8, 16, 32, 64, 128, 256])
        self.assertTrue(phase["times"] > 0 and 0 < phase["critical_path_ms"] <= phase["ms_alone"])
        self.assertAlmostEqual(rows[0]["ms_least"], phase["ms_alone"])
        for row in rows:
            self.assertTrue(0 < row["ms_least"] and 0 < row["ms_most"])
            self.assertTrue(row["ms_least"] >= 0.999 * phase["critical_path_ms"], row)
            self.assertTrue(row["times_as_fast_most"] <= row["workers"] * 1.001, row)
            self.assertEqual(sorted(row["lost_ms"]), sorted(LIMITS))
            # A prediction's time is the worker's share of the work plus the losses.
            lost = sum(row["lost_ms"].values())
            self.assertAlmostEqual(
                lost + phase["ms_alone"] / row["workers"], row["ms_most"], delta=1e-3 + 1e-6 * row["ms_most"]
            )
        self.assertAlmostEqual(
            sum(s["ms_alone"] for s in phase["stages"]), phase["ms_alone"], delta=1e-6 + 1e-6 * phase["ms_alone"]
        )

    def check_heads(self, shown, phases):
        """Asserts that every table of predictions has the word 'predicted' in its head."""
        for phase in phases:
            self.assertIn(f"\n{phase}: predicted from ", shown)
        self.assertEqual(shown.count("predicted workers"), len(phases))
        self.assertEqual(shown.count("predicted by stage"), len(phases))

    def test_scene(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        curve = self.path("curve.json")
        done = self.succeeds("scaling", scene, "-n", 2, "-r", 2, "--json", self.path("a.json"), "--measure", curve)
        told, sent = json.loads(read(self.path("a.json"))), json.loads(read(curve))
        self.check_heads(done.stdout, ["frame"])
        (frame,) = told["predicted"]["phases"]
        self.assertEqual((frame["phase"], frame["times"]), ("frame", 4))
        self.check_phase(frame)
        names = [s["stage"] for s in frame["stages"]]
        for stage in ["cull", "project", "bin", "sort", "raster"]:
            self.assertIn(stage, names)
        self.assertEqual(told["measured"], sent["measured"])
        self.assertEqual([m["workers"] for m in sent["measured"]][0], 1)
        self.assertEqual(sent["measured"][-1]["workers"], sent["cores"])
        self.assertTrue(all(m["ms"] > 0 and m["phase"] == "frame" for m in sent["measured"]))
        self.assertTrue(sent["predicted"]["costs"]["read_gb_per_second"] > 0)
        self.assertNotIn(self.path(), read(curve).decode())

    def test_bandwidth_bounds(self):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        self.succeeds("scaling", scene, "-n", 1, "-r", 1, "--bandwidth", "0.0001", "--json", self.path("a.json"), "-q")
        (frame,) = json.loads(read(self.path("a.json")))["predicted"]["phases"]
        self.check_phase(frame)
        self.assertTrue(frame["workers"][-1]["lost_ms"]["memory"] > 0)
        self.assertTrue(frame["workers"][-1]["ms_most"] > frame["workers"][-1]["ms_least"])

    def test_dataset(self):
        data = self.data
        out = self.path("out")
        done = self.succeeds(
            *["scaling", data, "-o", out, "--iterations", 120, "--steps", 10, "-n", 2, "-r", 1],
            *["--json", self.path("d.json"), "--measure", self.path("curve.json")],
        )
        phases = {p["phase"]: p for p in json.loads(read(self.path("d.json")))["predicted"]["phases"]}
        for name in ["densify", "checkpoint", "scene", "step", "frame", "jobs"]:
            self.assertIn(name, phases)
            self.check_phase(phases[name])
        self.check_heads(done.stdout, phases)
        self.assertEqual(phases["step"]["times"], 10)
        self.assertEqual(phases["densify"]["times"], 1)
        for stage in ["loss", "raster backward", "project backward"]:
            self.assertIn(stage, [s["stage"] for s in phases["step"]["stages"]])
        measured = json.loads(read(self.path("curve.json")))["measured"]
        self.assertEqual({m["phase"] for m in measured}, {"step", "frame"})
        self.assertTrue(os.path.exists(os.path.join(out, "scene.json")))

    def test_wrong_usage(self):
        data = self.data
        self.fails(["scaling", data], "pass -o SCENE")
        self.fails(["scaling", data, "-o", self.path("o"), "--downscale", 0.5], "can't be enlarged")
        self.fails(["scaling", self.path("nothing")], "nothing")
        scene = self.write("a.ply", ply_bytes(some_splats()))
        self.fails(["scaling", scene, "--measure", self.path("none/c.json")], "none/c.json")
        self.fails(["scaling", scene, "--repetitions", 0], "repetitions", code=2)


if __name__ == "__main__":
    fixtures.main()
