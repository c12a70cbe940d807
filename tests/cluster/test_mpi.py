#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""test_mpi.py MPI_RANKS: tests the transport over MPI with one to three ranks under mpirun (mpi_ranks.c)."""

import os
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import mpirun


class Transport(unittest.TestCase):
    def test_checks(self):
        for ranks in (1, 2, 3):
            done = mpirun.run(ranks, [RANKS, "checks"])
            self.assertEqual(done.returncode, 0, done.stderr)

    def test_sizes_that_disagree(self):
        done = mpirun.run(2, [RANKS, "mismatch"])
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("rank 0: rank 1 of 2 sent 1000 bytes; expected 2000", done.stderr)

    def test_rank_that_leaves(self):
        done = mpirun.run(2, [RANKS, "leave"])
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("rank 0: rank 1 of 2 has ended before its work was done", done.stderr)

    def test_rank_that_fails(self):
        done = mpirun.run(2, [RANKS, "fail"], timeout=30)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("rank 1: no room", done.stderr)
        self.assertNotIn("rank 0: ", done.stderr)

    def test_rank_that_stops(self):
        done = mpirun.run(2, [RANKS, "stop"], PAGS_WATCHDOG="2")
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("rank 0: rank 1 of 2 has been silent for 2 s", done.stderr)


if __name__ == "__main__":
    RANKS = sys.argv.pop(1)
    unittest.main()
