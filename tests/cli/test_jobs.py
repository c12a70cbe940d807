# SPDX-License-Identifier: Apache-2.0
"""Tests benchmarks/jobs.py: its table, resuming, stopping and jobs that fail. A stand-in for perf counts cache
misses."""

import json
import os
import signal
import subprocess
import sys
import time

import fixtures
from fixtures import SMALL, DataCase, files_below, read

SCRIPT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../benchmarks/jobs.py")
# The stand-in runs the command behind -- and writes the output of `perf stat -x ,` with COUNT cache misses.
PERF = """#!/bin/sh
while [ "$1" != -- ]; do [ "$1" = -o ] && out=$2; shift; done
shift
"$@"; code=$?
echo "# started" > "$out"; echo "COUNT,,cache-misses,1000,100.00,," >> "$out"
exit $code
"""


class Jobs(DataCase):
    def setUp(self):
        super().setUp()
        self.perf("<not supported>")

    def perf(self, count):
        path = self.write("bin/perf", PERF.replace("COUNT", count))
        os.chmod(path, 0o755)
        self.environment = {**os.environ, "PATH": f"{self.path('bin')}:{os.environ['PATH']}"}

    def command(self, rows, *more, steps=20):
        own = [
            sys.executable,
            "-B",
            SCRIPT,
            self.data,
            "-o",
            self.path("t"),
            "--pags",
            fixtures.PAGS,
            "-n",
            steps,
            "--rows",
            rows,
        ]
        return [str(word) for word in [*own, *more]]

    def run_script(self, rows, *more, code=0, small=SMALL, **options):
        command = self.command(rows, *more, *(["--", *small] if small else []), **options)
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, env=self.environment)
        self.assertEqual(done.returncode, code, f"{command}: {done.stdout}{done.stderr}")
        return done

    def refuses(self, rows, *more, words, **options):
        lines = self.run_script(rows, *more, code=1, **options).stderr.splitlines()
        self.assertTrue(lines[-1].startswith("jobs.py: "), lines)
        for word in words:
            self.assertIn(word, lines[-1])

    def measured(self):
        return [name for name in files_below(self.path("t.runs")) if "round" in name]

    def rows(self, page):
        lines = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("|") and " x " in line]
        return {line[0]: line[1:] for line in lines[1:]}

    def test_table_and_resuming(self):
        page = self.run_script("2x1,1x2", "--rounds", 2).stdout
        self.assertEqual(page.encode(), read(self.path("t.md")))
        self.assertEqual(
            self.measured(), ["1x2_round-1.json", "1x2_round-2.json", "2x1_round-1.json", "2x1_round-2.json"]
        )
        # The scenes are deleted; only measurements and settings are left.
        self.assertEqual(len(files_below(self.path("t.runs"))), 5)
        rows = self.rows(page)
        self.assertEqual(list(rows), ["2 x 1", "1 x 2"])
        for name, jobs in [("2 x 1", 2), ("1 x 2", 1)]:
            of = [json.loads(read(self.path("t.runs", f"{name.replace(' ', '')}_round-{n}.json"))) for n in (1, 2)]
            rates = [3600 * jobs / f["seconds"] for f in of]
            self.assertIn(f"{sum(rates) / 2:.1f} ({min(rates):.1f} to {max(rates):.1f})", rows[name])
            self.assertEqual(rows[name][-1], "not counted")
            for f in of:
                self.assertGreater(f["processor_seconds"], 0)
                self.assertGreater(f["peak_bytes"], 1e6)
                self.assertGreaterEqual(f["peak_bytes_sum"], 1.5 * f["peak_bytes"] if jobs == 2 else f["peak_bytes"])
        self.assertEqual(rows["1 x 2"][2], "1.00")
        self.assertIn("perf doesn't support the event cache-misses", page)

        # Existing rows aren't measured again; missing ones are.
        kept = {name: read(self.path("t.runs", name)) for name in self.measured()}
        os.unlink(self.path("t.runs", "2x1_round-2.json"))
        said = self.run_script("2x1,1x2", "--rounds", 2).stderr
        self.assertEqual(said.count("jobs an hour"), 1, said)
        again = {name: read(self.path("t.runs", name)) for name in self.measured()}
        self.assertEqual(sorted(name for name in kept if kept[name] != again[name]), ["2x1_round-2.json"])
        self.refuses("1x1", steps=21, words=["t.runs/settings.json", "another -o"])

    def test_cache_misses(self):
        self.perf("2000000000")
        page = self.run_script("2x1,1x1", "--rounds", 1).stdout
        self.assertEqual([row[-1] for row in self.rows(page).values()], ["128.0", "128.0"])
        self.assertNotIn("wasn't counted", page)

    def test_stopping(self):
        process = subprocess.Popen(
            self.command("2x1", steps=1000000),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=self.environment,
        )
        for line in process.stderr:  # waits until the first step is done
            if "step " in line:
                break
        process.send_signal(signal.SIGINT)
        begun = time.monotonic()
        said = process.communicate(timeout=120)[1]
        self.assertEqual(process.returncode, 3, said)
        self.assertIn("interrupted; the same command resumes", said)
        self.assertLess(time.monotonic() - begun, 60)
        self.assertEqual(files_below(self.path("t.runs")), ["settings.json"])

    def test_jobs_that_fail(self):
        # Options that pags refuses and unknown rows are reported before anything runs.
        self.refuses("1x1", small=["--nonsense"], words=["--nonsense"])
        self.assertFalse(os.path.exists(self.path("t.runs")))
        self.refuses("2x", words=["'2x'", "JOBSxTHREADS"])
        self.refuses("1x1,1x1", words=["'1x1'", "twice"])
        # One job fails while it runs: its message is printed, and the other job is stopped.
        shim = self.write(
            "shim",
            f"""#!/bin/sh
case "$*" in *scene-1*) echo "pags: the disk is full" >&2; exit 1;; esac
exec {fixtures.PAGS} "$@"
""",
        )
        os.chmod(shim, 0o755)
        self.refuses("2x1", "--pags", shim, steps=1000000, words=["job 2 of 2: the disk is full"])
        self.assertEqual(self.measured(), [])
        self.write("shim", "#!/bin/sh\ncase $* in *--check-options*) exit 0;; esac\nkill -9 $$\n")
        self.refuses("2x1", "--pags", shim, steps=1000000, words=["of 2: killed", "memory"])


if __name__ == "__main__":
    fixtures.main()
