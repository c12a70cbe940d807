# SPDX-License-Identifier: Apache-2.0
"""Inputs of every kind that people bring: what is ignored, guessed, clamped or left out is said once, in the JSON as well, and is an
error with --strict."""

import json
import os

import fixtures
from fixtures import Case, ply_bytes, read, run, some_splats


class Warnings(Case):
    """By a splat file two of whose quaternions are zero."""

    def setUp(self):
        super().setUp()
        rows = some_splats()
        for row in rows[:2]:
            row[13:17] = [0.0] * 4
        self.odd = self.write("odd.ply", ply_bytes(rows))
        self.good = self.write("good.ply", ply_bytes(some_splats()))
        self.line = f"{self.odd}: 2 all-zero quaternions taken as no rotation"

    def test_are_said_and_written(self):
        for verb in [["info", self.odd], ["export", self.odd, self.path("out.spz")]]:
            done = self.succeeds(*verb, "--json", self.path("out.json"))
            self.assertEqual(done.stdout.count(f"warning: {self.line}\n"), 1, done.stdout)
            self.assertEqual(json.loads(read(self.path("out.json")))["warnings"], [self.line])
        self.assertEqual(self.succeeds("info", self.odd, "--quiet").stdout, "")

    def test_are_errors_with_strict(self):
        for verb in [["info", self.odd], ["export", self.odd, self.path("out.spz")], ["render", self.odd, "-o", self.path("out")]]:
            done = run(*verb, "--strict")
            self.assertEqual(done.returncode, 1)
            self.assertIn(f"{self.line} (an error because of --strict)", done.stderr)
            self.assertFalse(os.path.exists(verb[-1]) and verb[-1] != self.odd)

    def test_good_files_give_none(self):
        done = self.succeeds("info", self.good, "--strict", "--json", "-")
        self.assertEqual(json.loads(done.stdout)["warnings"], [])


if __name__ == "__main__":
    fixtures.main()
