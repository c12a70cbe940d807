#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the fuzz targets of a build with PAGS_FUZZ (docs/reliability.md) and prints a table of executions and
findings.

usage: fuzz.py [--minutes M] [--long-minutes M] [--corpus FOLDER] [--json FILE] BUILD [TARGET...]

Each target runs for M minutes of CPU time (default 1; --long-minutes for spz, spz_content, ply, checkpoint and
tfrecord) with its seeds, its dictionary and its corpus, which grows from run to run in FOLDER/TARGET (default
BUILD/corpus). Inputs that fail are kept in FOLDER/TARGET-findings. Exits with 1 if there is such an input.
"""

import argparse
import glob
import json
import os
import re
import resource
import subprocess
import sys
import tempfile

LONG = ("spz", "spz_content", "ply", "checkpoint", "tfrecord")
PICTURES = ("waymo_segment",)  # OpenImageIO's known leak is recognised by its stack, which needs the slow unwinder
ROUND = 60  # wall-clock seconds of one run of the fuzzer, after which the CPU time is checked


def targets_of(build):
    """Finds the fuzz targets of a build; returns a dict from target to program."""
    found = {}
    for program in sorted(glob.glob(os.path.join(build, "tests", "fuzz", "fuzz_*"))):
        if os.path.isfile(program) and os.access(program, os.X_OK):
            for name in subprocess.run([program, "--list"], capture_output=True, text=True, check=True).stdout.split():
                found[name] = program
    return found


def cpu_seconds():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def last_number(pattern, text, fallback=0):
    found = re.findall(pattern, text)
    return int(found[-1]) if found else fallback


def run_target(name, program, minutes, folder):
    corpus, findings, seeds = (os.path.join(folder, name + end) for end in ("", "-findings", "-seeds"))
    words = os.path.join(folder, name + ".dict")
    for path in (corpus, findings):
        os.makedirs(path, exist_ok=True)
    subprocess.run([program, f"--target={name}", f"--words={words}", f"--seeds={seeds}"], check=True)
    flags = [
        f"-dict={words}",
        f"-artifact_prefix={findings}/",
        "-timeout=20",
        "-rss_limit_mb=2048",
        "-malloc_limit_mb=600",
    ]
    flags += ["-max_len=65536", "-print_final_stats=1", "-verbosity=1"]
    known_leaks = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "tests", "lsan.supp")
    fast = int(name not in PICTURES)
    environment = dict(
        os.environ,
        ASAN_OPTIONS=f"allocator_may_return_null=1:detect_leaks=1:handle_abort=1:fast_unwind_on_malloc={fast}",
        LSAN_OPTIONS=f"suppressions={known_leaks}:print_suppressions=0",
        TMPDIR=scratch(),
    )
    row = {
        "target": name,
        "executions": 0,
        "coverage": 0,
        "features": 0,
        "corpus": 0,
        "findings": 0,
        "cpu_seconds": 0.0,
    }
    begin, budget = cpu_seconds(), 60 * minutes
    while row["cpu_seconds"] < budget:
        wall = max(5, min(ROUND, int(budget - row["cpu_seconds"])))
        command = [program, f"--target={name}", corpus, seeds, f"-max_total_time={wall}", *flags]
        log = subprocess.run(command, capture_output=True, text=True, errors="replace", env=environment).stderr
        row["executions"] += last_number(r"stat::number_of_executed_units: (\d+)", log) or last_number(r"#(\d+)\s", log)
        row["coverage"] = max(row["coverage"], last_number(r"cov: (\d+)", log))
        row["features"] = max(row["features"], last_number(r"ft: (\d+)", log))
        row["cpu_seconds"] = cpu_seconds() - begin
        if os.listdir(findings):
            print(log[-6000:], file=sys.stderr)
            break
    row["corpus"], row["findings"] = len(os.listdir(corpus)), len(os.listdir(findings))
    return row


def scratch():
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else tempfile.gettempdir()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build")
    parser.add_argument("targets", nargs="*")
    parser.add_argument("--minutes", type=float, default=1)
    parser.add_argument("--long-minutes", type=float)
    parser.add_argument("--corpus")
    parser.add_argument("--json")
    given = parser.parse_args()
    known = targets_of(given.build)
    unknown = [name for name in given.targets if name not in known]
    if unknown or not known:
        sys.exit(f"fuzz: {given.build}: no target {', '.join(unknown) or 'at all'}; there are: {' '.join(known)}")
    print("| target | executions | edges | features | corpus | CPU s | findings |\n|---|---|---|---|---|---|---|")
    rows = []
    for name in given.targets or known:
        minutes = given.long_minutes if name in LONG and given.long_minutes else given.minutes
        row = run_target(
            name, known[name], minutes, os.path.abspath(given.corpus or os.path.join(given.build, "corpus"))
        )
        rows.append(row)
        print(
            "| {target} | {executions} | {coverage} | {features} | {corpus} | {cpu_seconds:.0f} | {findings} |".format(
                **row
            ),
            flush=True,
        )
    if given.json:
        with open(given.json, "w") as file:
            json.dump(rows, file, indent=1)
    sys.exit(1 if any(row["findings"] for row in rows) else 0)


if __name__ == "__main__":
    main()
