#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains a data set in one process and on 1 to 4 ranks of mpirun, and says whether the results have the same bits: scene, sky, log and checkpoint.
One more run of 4 ranks is killed after a checkpoint and gone on with on 2.

  cluster_bits.py PAGS DATASET FOLDER [--runs 1x1,2x1,3x1,4x1,1x2,2x2,4x2,4>2] [--iterations 1600] [options of pags train...]

A run RxT has R ranks of T threads; 4>2 is the one that is killed. FOLDER receives the scenes. The default is 400 steps of 4 photographs."""

import argparse
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "tests", "cluster"))
import mpirun  # noqa: E402
from rank_jobs import children_of, contents, wait_for  # noqa: E402


def payload(folder):
    """Hash of all files but reports, which have times; and how often Gaussians were split, and pruned by score."""
    files = {name: data for name, data in contents(folder).items() if not name.startswith("report.")}
    hashed = hashlib.sha256()
    for name in sorted(files):
        hashed.update(name.encode() + b"\0" + hashlib.sha256(files[name]).digest())
    log = [json.loads(line) for line in files["log.jsonl"].decode().splitlines()]
    return (
        hashed.hexdigest()[:16],
        len(files),
        sum("split" in line for line in log),
        sum("pruned_by_score" in line for line in log),
    )


def run(command, ranks):
    done = (
        mpirun.run(ranks, command, timeout=None) if ranks else subprocess.run(command, capture_output=True, text=True)
    )
    if done.returncode:
        sys.exit(f"{' '.join(command)}: {done.stderr}")


def kill(command, folder):
    """Kills one of 4 ranks a little after the first checkpoint."""
    process = mpirun.start(4, command)
    path = os.path.join(folder, "checkpoint.pags")
    wait_for(
        lambda: process.poll() is not None or (os.path.exists(path) and open(path, "rb").read(1) == b"{"), seconds=36000
    )
    time.sleep(random.uniform(0, 2))
    rank = random.randrange(4)
    ranks = children_of(process.pid)
    if len(ranks) != 4:
        sys.exit("the run was over before it could be killed: give it more --iterations")
    os.kill(ranks[rank], signal.SIGKILL)
    _, err = process.communicate()
    said = [line for line in err.split("\n") if "signal 9" in line]
    if not process.returncode or not said:
        sys.exit(f"4 ranks, one killed: code {process.returncode}: {err}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pags")
    parser.add_argument("dataset")
    parser.add_argument("folder")
    parser.add_argument("--runs", default="1x1,2x1,3x1,4x1,1x2,2x2,4x2,4>2")
    parser.add_argument("--iterations", type=int, default=1600)
    arguments, options = parser.parse_known_args()
    os.makedirs(arguments.folder, exist_ok=True)

    def command(name, threads, *more):
        return [
            arguments.pags,
            "train",
            arguments.dataset,
            "-o",
            os.path.join(arguments.folder, name),
            "--iterations",
            str(arguments.iterations),
            "--batch",
            "4",
            "--log-every",
            "10",
            "--preview-every",
            "0",
            "--threads",
            str(threads),
            "-q",
            *options,
            *more,
        ]

    print(
        f"{arguments.dataset}, {arguments.iterations} photographs, 4 a step {' '.join(options)}\nranks threads seconds payload           files splits prunes"
    )
    first, different = None, 0
    for name in ["one", *arguments.runs.split(",")]:
        since, folder = time.monotonic(), os.path.join(arguments.folder, name.replace(">", "-"))
        if name == "one":
            label = "-     1"
            run(command("one", 1, "--overwrite"), 0)
        elif ">" in name:
            label = "4>2   1"
            every = ["--checkpoint-every", str(max(arguments.iterations // 32, 1))]
            kill(command(os.path.basename(folder), 1, "--overwrite", *every), folder)
            run(command(os.path.basename(folder), 1, "--resume", *every), 2)
        else:
            ranks, threads = map(int, name.split("x"))
            label = f"{ranks:<5d} {threads}"
            run(command(name, threads, "--overwrite"), ranks)
        found = payload(folder)
        first = first or found
        different += found != first
        print(
            f"{label:<13s} {time.monotonic() - since:7.0f} {found[0]}  {found[1]:5d} {found[2]:6d} {found[3]:6d}{'' if found == first else '   DIFFERENT'}",
            flush=True,
        )
    if not (first[2] and first[3]):
        sys.exit("nothing was split, or nothing pruned by score: this shows little")
    print("all the same" if not different else f"{different} runs differ")
    sys.exit(different > 0)


if __name__ == "__main__":
    main()
