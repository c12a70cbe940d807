#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains over lines of a given rate and compares with the model: benchmarks/cluster_rates.py -o FOLDER [options] PAGS DATASET [-- words of pags train]

Each rank runs in a network namespace of its own, with a line to a bridge that tc holds to the rate in both directions. Needs root, ip, tc and
Open MPI. docs/lab/cluster-model.md has the model, docs/lab/ranks-measured.md what was measured."""

import argparse
import json
import os
import stat
import subprocess
import sys

SPLAT_BYTES, SUM_BYTES = 56, 48
PREFIX, NET = "pags-rank", "10.53.0"


def shell(*words):
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(words)}: {done.stderr.strip()}")


def remove_lines(ranks):
    for rank in range(ranks):
        # The line first: the kernel removes what is in a namespace some time after the namespace
        subprocess.run(["ip", "link", "delete", f"{PREFIX}{rank}o"], capture_output=True)
        subprocess.run(["ip", "netns", "delete", f"{PREFIX}{rank}"], capture_output=True)
    subprocess.run(["ip", "link", "delete", PREFIX], capture_output=True)


def make_lines(ranks, gigabits):
    """A bridge, and for each rank a namespace with a line to it; gigabits 0: as fast as it can."""
    remove_lines(ranks)
    shell("ip", "link", "add", "name", PREFIX, "type", "bridge")
    shell("ip", "link", "set", PREFIX, "up")
    for rank in range(ranks):
        space, outer = f"{PREFIX}{rank}", f"{PREFIX}{rank}o"
        shell("ip", "netns", "add", space)
        shell("ip", "link", "add", outer, "type", "veth", "peer", "name", "line", "netns", space)
        shell("ip", "link", "set", outer, "master", PREFIX, "up")
        inside = ["ip", "netns", "exec", space]
        shell(*inside, "ip", "address", "add", f"{NET}.{rank + 1}/24", "dev", "line")
        shell(*inside, "ip", "link", "set", "line", "up")
        shell(*inside, "ip", "link", "set", "lo", "up")
        if gigabits:
            # What a rank sends, and what the bridge sends to it; a burst is what the line carries in a millisecond
            limit = ["root", "tbf", "rate", f"{gigabits}gbit", "burst", f"{max(int(gigabits * 125000), 131072)}", "latency", "50ms"]
            shell(*inside, "tc", "qdisc", "add", "dev", "line", *limit)
            shell("tc", "qdisc", "add", "dev", outer, *limit)


def write_agent(folder):
    """Stands for ssh: mpirun calls it with a host, here a rank's address, and a command."""
    path = os.path.join(folder, "agent.sh")
    with open(path, "w", encoding="ascii") as file:
        file.write(f'''#!/bin/sh
rank=$((${{1##*.}} - 1)); shift
exec ip netns exec {PREFIX}$rank unshare -u sh -c "hostname rank$rank; exec sh -c '$*'"
''')
    os.chmod(path, stat.S_IRWXU)
    return path


def train(command, folder, name, before=()):
    report = os.path.join(folder, f"{name}.json")
    done = subprocess.run([*before, *command, "-o", os.path.join(folder, name), "--overwrite", "--json", report], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{name}: {done.stderr.strip()}")
    with open(report, encoding="utf-8") as file:
        return json.load(file)


def step_ms(report):
    return sum(report["ms"][name] for name in ("wait", "forward", "loss", "backward", "density"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("pags")
    parser.add_argument("dataset")
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--ranks", type=int, default=2, metavar="N", help="of one thread each; no more than there are cores [default 2]")
    parser.add_argument("--batch", type=int, default=4, metavar="B")
    parser.add_argument("--steps", type=int, default=50, metavar="N", help="[default 50]")
    parser.add_argument("--rates", default="1,10", metavar="LIST", help="Gb/s [default 1,10]")
    parser.add_argument("more", nargs="*", help="further words of pags train, at the end, after --")
    chosen = parser.parse_args()
    folder, ranks, batch = os.path.abspath(chosen.output), chosen.ranks, chosen.batch
    os.makedirs(folder, exist_ok=True)
    agent = write_agent(folder)
    command = [os.path.abspath(chosen.pags), "train", os.path.abspath(chosen.dataset), "--batch", str(batch), "--iterations", str(batch * chosen.steps),
               "--set", "fourier=0", "--set", "densify_from=1000000", "--preview-every", "0", "--threads", "1", "-q", *chosen.more]
    hosts = ",".join(f"{NET}.{rank + 1}" for rank in range(ranks))
    mpirun = ["ip", "netns", "exec", f"{PREFIX}0", "unshare", "-u", "sh", "-c", 'hostname rank0; exec "$@"', "sh", "mpirun", "--allow-run-as-root",
              "--host", hosts, "-np", str(ranks), "--bind-to", "none", "--mca", "plm_rsh_agent", agent, "--mca", "orte_keep_fqdn_hostnames", "1",
              "--mca", "btl", "tcp,self", "--mca", "btl_tcp_if_include", f"{NET}.0/24", "--mca", "oob_tcp_if_include", f"{NET}.0/24"]
    alone = train(command, folder, "alone")
    print(f"one process: {step_ms(alone):.1f} ms a step, {alone['ms']['processor']:.1f} of the processor without photographs; {alone['gaussians']} Gaussians")
    print("| line, Gb/s | ms a step | steps a second | predicted | measured / predicted | MB a photograph | predicted | all ranks' processor / one process |")
    print("|---|---|---|---|---|---|---|---|")
    free = None
    for rate in [0, *(float(word) for word in chosen.rates.split(","))]:
        make_lines(ranks, rate)
        try:
            report = train(command, folder, f"rate-{rate:g}", mpirun)
        finally:
            remove_lines(ranks)
        each = report["each_rank"]
        views, splats = (sum(rank[name] for rank in each) for name in ("photographs", "splats"))
        there, back = (sum(rank[name] for rank in each) for name in ("bytes_there", "bytes_back"))
        model = (SPLAT_BYTES + SUM_BYTES) * splats / views * (1 - 1 / ranks)
        # The busiest rank of each step sends what others draw and receives its own, one round after the other
        sent = sum(rank["bytes_sent"] for rank in each) / ranks / chosen.steps
        computing = step_ms(report) if rate == 0 else free
        predicted = computing + (sent * 8 / (rate * 1e6) if rate else 0)
        free = computing
        took = step_ms(report)
        print(f"| {f'{rate:g}' if rate else 'none'} | {took:.1f} | {1e3 / took:.2f} | {1e3 / predicted:.2f} | {predicted / took:.2f} | "
              f"{(there + back) / views / 1e6:.3f} | {model / 1e6:.3f} | {sum(rank['processor_ms'] for rank in each) / alone['ms']['processor']:.2f} |", flush=True)


if __name__ == "__main__":
    main()
