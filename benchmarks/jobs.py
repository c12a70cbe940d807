#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Jobs an hour: trains one data set as several jobs of few threads at once and as one job of many, and compares how many trainings a machine
does in an hour, and the memory that they need (docs/pags-bench.md).

Each row, such as 4x1 (four jobs of one thread), is measured once a round; the rows take turns, every second round in reverse. A measurement
that was interrupted counts for nothing: it is made again, while finished ones are kept in TABLE.runs."""

import glob
import json
import math
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

from ablation import Failure, Interrupted, Parser, Progress, cpu_seconds, die_with_parent, duration, read_json, whole
from ablation_tables import markdown_table, write

LINE = 64  # bytes that a cache miss moves


def parse_rows(text):
    rows = []
    for word in text.split(","):
        found = re.fullmatch(r"([1-9]\d*)x([1-9]\d*)", word)
        if not found or int(found[1]) > 1024 or int(found[2]) > 256:
            raise Failure(f"row '{word}': expected JOBSxTHREADS, such as 4x1, at most 1024 jobs of 256 threads")
        if (row := (int(found[1]), int(found[2]))) in rows:
            raise Failure(f"row '{word}' is named twice")
        rows.append(row)
    return rows


def processors():
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def perf_refusal():
    """Why perf can't count cache misses here, in a few words; None if it can."""
    if not shutil.which("perf"):
        return "there is no program perf"
    with tempfile.NamedTemporaryFile("r") as file:
        done = subprocess.run(
            ["perf", "stat", "-x", ",", "-e", "cache-misses", "-o", file.name, "--", sys.executable, "-c", ""],
            capture_output=True,
            text=True,
        )
        if done.returncode:
            return f"perf says: {(done.stderr.strip().splitlines() or ['no message'])[0]}"
        return (
            None
            if misses_of(file.read()) is not None
            else "perf doesn't support the event cache-misses on this machine"
        )


def misses_of(text):
    """The count in what perf stat -x , wrote; None if it counted nothing."""
    for line in text.splitlines():
        fields = line.split(",")
        if len(fields) > 2 and fields[2].startswith("cache-misses"):
            return int(fields[0]) if fields[0].isdecimal() else None
    return None


class Jobs:
    """Several processes of pags at once. The first SIGINT or SIGTERM ends them all; a second SIGINT ends this program."""

    def __init__(self):
        self.children, self.interrupted = [], False
        for number in [signal.SIGINT, signal.SIGTERM]:
            signal.signal(number, self.on_signal)

    def on_signal(self, number, _):
        if self.interrupted and number == signal.SIGINT:
            os._exit(128 + number)
        self.interrupted = True
        self.stop()

    def stop(self):
        """Asks the processes, each with perf in a session of its own, to end."""
        for child in self.children:
            if child.returncode is None:  # not yet waited for, so that the number is still its own
                try:
                    os.killpg(child.pid, signal.SIGTERM)
                except ProcessLookupError:
                    pass

    def run(self, commands, folder, on_line):
        """Runs the commands at once and waits for all; the first one's lines go to on_line. Returns wall clock and processor seconds."""
        if self.interrupted:
            raise Interrupted
        before, begun = cpu_seconds(), time.monotonic()
        for i, command in enumerate(commands):
            with open(os.path.join(folder, f"{i}.err"), "w") as errors:
                self.children.append(
                    subprocess.Popen(
                        command,
                        stdout=subprocess.DEVNULL if i else subprocess.PIPE,
                        stderr=errors,
                        text=True,
                        start_new_session=True,
                        preexec_fn=die_with_parent,
                    )
                )
        if self.interrupted:
            self.stop()
        threading.Thread(
            target=lambda lines: [on_line(line.rstrip("\n")) for line in lines],
            args=[self.children[0].stdout],
            daemon=True,
        ).start()
        failed, numbers = None, {child.pid: i for i, child in enumerate(self.children)}
        while numbers:
            ended = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOWAIT).si_pid  # whichever ends first
            i = numbers.pop(ended)
            if self.children[i].wait() and failed is None and not self.interrupted:
                failed = i
                self.stop()  # the others' figures would be of another load
        seconds, codes = time.monotonic() - begun, [child.returncode for child in self.children]
        self.children = []
        if self.interrupted:
            raise Interrupted
        if failed is not None:
            with open(os.path.join(folder, f"{failed}.err"), errors="replace") as errors:
                said = errors.read().strip().splitlines()
            message = said[-1].removeprefix("pags: ") if said else "no message"
            if codes[failed] in (-signal.SIGKILL, 128 + signal.SIGKILL):  # by perf in the second way
                message = "killed, perhaps since memory was short: fewer jobs at once (--rows) need less"
            elif codes[failed] < 0:
                message = f"killed by signal {-codes[failed]}"
            raise Failure(f"job {failed + 1} of {len(commands)}: {message}")
        return seconds, cpu_seconds() - before


class Measurements:
    def __init__(self, given, rest):
        self.dataset, self.output = os.path.realpath(given.dataset), given.output.removesuffix(".md")
        self.folder, self.program, self.rounds = f"{self.output}.runs", os.path.realpath(given.pags), given.rounds
        self.rows = parse_rows(given.rows or ",".join(dict.fromkeys([f"{processors()}x1", f"1x{processors()}"])))
        self.train = ["--iterations", str(given.iterations), "--seed", str(given.seed), *rest]
        self.jobs, self.progress = Jobs(), Progress(None if given.quiet else sys.stderr)
        self.refusal = perf_refusal()
        self.found = {row: [] for row in self.rows}

    def check(self):
        """Lets pags check the options; compares what all rows share with the record in the folder, since other trainings can't be compared."""
        words = [self.program, "train", self.dataset, "-o", self.folder, *self.train, "--check-options"]
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode:
            raise Failure((done.stderr.strip().splitlines() or ["no message"])[-1].removeprefix("pags: "))
        path, settings = os.path.join(self.folder, "settings.json"), {"dataset": self.dataset, "train": self.train}
        os.makedirs(self.folder, exist_ok=True)
        if not os.path.exists(path):
            write(path, json.dumps(settings, indent=1) + "\n")
        elif read_json(path) != settings:
            raise Failure(
                f"{path}: says that the measurements there are of another data set or other options; expected the same, or another -o TABLE"
            )

    def path(self, row, number):
        return os.path.join(self.folder, f"{row[0]}x{row[1]}_round-{number + 1}.json")

    def measure(self, row, number, load):
        """Runs the jobs of a row and writes their figures; scenes are thrown away."""
        jobs, threads = row
        place, begun = f"round {number + 1} of {self.rounds}, {jobs} x {threads}", time.monotonic()

        def on_line(line):
            if line.startswith("step "):
                self.progress.say(f"{place}: {line}; {duration(time.monotonic() - begun)} so far", False)

        with tempfile.TemporaryDirectory(dir=self.folder, prefix="jobs-") as folder:
            commands = []
            for i in range(jobs):
                train = [
                    self.program,
                    "train",
                    self.dataset,
                    "-o",
                    f"{folder}/scene-{i}",
                    *self.train,
                    "--threads",
                    str(threads),
                ]
                train += ["--checkpoint-every", "0", "--preview-every", "0", "--json", f"{folder}/{i}.json"]
                count = ["perf", "stat", "-x", ",", "-e", "cache-misses", "-o", f"{folder}/{i}.perf", "--"]
                commands.append(train if self.refusal else count + train)
            seconds, processor = self.jobs.run(commands, folder, on_line)
            reports = [read_json(f"{folder}/{i}.json") for i in range(jobs)]
            misses = None
            if not self.refusal:
                counts = []
                for path in glob.glob(f"{folder}/*.perf"):
                    with open(path, encoding="utf-8") as file:
                        counts.append(misses_of(file.read()))
                misses = None if None in counts else sum(counts)
        peaks = [report["peak_rss_bytes"] for report in reports]
        figures = {
            "seconds": seconds,
            "processor_seconds": processor,
            "peak_bytes": max(peaks),
            "peak_bytes_sum": sum(peaks),
            "cache_misses": misses,
            "gaussians": sorted({report["gaussians"] for report in reports}),
            "processors": processors(),
            "machine": processor_name(),
            "load_before": load,
        }
        write(self.path(row, number), json.dumps(figures, indent=1) + "\n")
        self.progress.say(f"{place}: {seconds:.1f} s, {3600 * jobs / seconds:.1f} jobs an hour")

    def run(self):
        for number in range(self.rounds):
            for row in self.rows if number % 2 == 0 else reversed(self.rows):
                if not os.path.exists(self.path(row, number)):
                    self.measure(row, number, os.getloadavg()[0])
                self.found[row].append(read_json(self.path(row, number)))
        counts = {tuple(figures["gaussians"]) for of_row in self.found.values() for figures in of_row}
        if len(counts) != 1 or len(next(iter(counts))) != 1:
            raise Failure(
                f"{self.folder}: expected every job to end with the same Gaussians, found {sorted(counts)}: the measurements are of "
                "different programs, or this one is broken"
            )
        text = self.table()
        write(f"{self.output}.md", text)
        sys.stdout.write(text)

    def table(self):
        """The table as Markdown: means over rounds, and where there are several, from the smallest to the largest."""
        rows, first = [], self.found[self.rows[0]][0]
        rates = {row: mean([3600 * row[0] / f["seconds"] for f in found]) for row, found in self.found.items()}
        for row, found in self.found.items():
            jobs, threads = row
            misses = [f["cache_misses"] for f in found]
            traffic = "not counted" if None in misses else f"{LINE * 1e-9 * mean(misses) / jobs:.1f}"
            rows.append(
                [
                    f"{jobs} x {threads}",
                    span([f["seconds"] for f in found], 1),
                    span([3600 * jobs / f["seconds"] for f in found], 1),
                    f"{rates[row] / rates[self.rows[-1]]:.2f}",
                    f"{mean([f['processor_seconds'] for f in found]) / jobs:.1f}",
                    f"{1e-6 * max(f['peak_bytes'] for f in found):.0f}",
                    f"{1e-6 * max(f['peak_bytes_sum'] for f in found):.0f}",
                    traffic,
                ]
            )
        heads = [
            "jobs x threads",
            "wall s",
            "jobs an hour",
            f"against {self.rows[-1][0]} x {self.rows[-1][1]}",
            "processor s a job",
            "peak MB a job",
            "peak MB in all",
            "GB of cache misses a job",
        ]
        page = f"# Jobs an hour: {os.path.basename(self.dataset)}\n\n"
        page += f"`pags train {' '.join(self.train)}`, {first['gaussians'][0]} Gaussians at the end; {first['machine']}, {first['processors']} "
        page += f"processors for this process; {self.rounds} round{'s' if self.rounds > 1 else ''}, load before each measurement "
        page += f"{span([f['load_before'] for found in self.found.values() for f in found], 1)}. Wall: from the first job's start to the last one's end, "
        page += "reading and writing included. Memory that jobs share (the program, files) counts in each.\n\n"
        page += markdown_table(heads, rows)
        if self.refusal:
            page += f"\nMemory traffic wasn't counted: {self.refusal}.\n"
        else:
            page += (
                f"\nMemory traffic: cache misses as perf counts them, {LINE} bytes each; of which cache, and whether with what was fetched ahead, is "
                "the processor's (Intel: the last level; AMD: the second).\n"
            )
        return page


def mean(values):
    return math.fsum(values) / len(values)


def span(values, decimals):
    text = f"{mean(values):.{decimals}f}"
    return text if len(values) < 2 else f"{text} ({min(values):.{decimals}f} to {max(values):.{decimals}f})"


def processor_name():
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            return next(line.split(":", 1)[1].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def parse_arguments(words):
    own, rest = words, []
    if "--" in words:
        own, rest = words[: words.index("--")], words[words.index("--") + 1 :]
    built = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../build/pags")
    p = Parser(
        "jobs.py",
        allow_abbrev=False,
        description=__doc__.split("\n\n")[0],
        epilog="Ctrl-C stops; the same command resumes it. Options of pags train follow --, at the end.",
    )
    p.add_argument("dataset", metavar="DATASET", help="as for pags train")
    p.add_argument(
        "-o", "--output", metavar="TABLE", required=True, help="write TABLE.md; measurements are kept in TABLE.runs"
    )
    p.add_argument(
        "-n",
        "--iterations",
        type=whole(1),
        default=1000,
        metavar="N",
        help="steps of each training [default %(default)s]",
    )
    p.add_argument("--rows", metavar="JxT,...", help="J jobs of T threads each [default: of all T processors, Tx1,1xT]")
    p.add_argument(
        "--rounds",
        type=whole(1, 100),
        default=2,
        metavar="R",
        help="measure each row R times, by turns [default %(default)s]",
    )
    p.add_argument(
        "--seed", type=whole(0), default=0, metavar="N", help="of every job: all do the same work [default %(default)s]"
    )
    p.add_argument("-q", "--quiet", action="store_true", help="print the table and errors only")
    p.add_argument(
        "--pags", default=os.path.normpath(built), metavar="PROGRAM", help="the program pags [default build/pags]"
    )
    return p.parse_args(own), rest


def main():
    given, rest = parse_arguments(sys.argv[1:])
    measurements = None
    try:
        measurements = Measurements(given, rest)
        measurements.check()
        measurements.run()
        return 0
    except Interrupted:
        code, message = 3, "interrupted; the same command resumes from here"
    except (Failure, OSError) as error:
        code, message = (
            1,
            f"{error.filename}: {error.strerror}" if isinstance(error, OSError) and error.filename else error,
        )
    if measurements:
        measurements.progress.clear()
    print(f"jobs.py: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
