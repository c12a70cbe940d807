# SPDX-License-Identifier: Apache-2.0
"""Predicts training on several machines from figures of one: benchmarks/cluster_model.py RENDER.json REPORT.json [options]

RENDER.json is written by `pags render SCENE --split train -o FOLDER --early-z off --json RENDER.json`, REPORT.json lies in the trained scene.
docs/lab/cluster-model.md has the model and its assumptions. All figures that it prints are predicted."""

import argparse
import json

SPLAT_BYTES = 48  # mean, conic, opacity, colour, depth, id: what blending needs of a Gaussian in one view
SUM_BYTES = 48  # the 12 sums that come back
LATENCY = 50e-6  # seconds of a message, two a view and rank
PARAMETER_FLOATS = 3  # a parameter and its two moments
RESERVE = 1.5  # of the arrays, for growth
OTHER_BYTES = 8 + 12 + 64 + 32 + 12 * (8 + 2 + 48)  # per Gaussian in view: statistics, reordering, splat, keys, pairs (engine/train/estimate.c)


def mean(frames, *keys):
    total = 0.0
    for frame in frames:
        for key in keys:
            frame = frame[key]
        total += frame
    return total / len(frames)


class Run:
    """What one machine did, per photograph."""

    def __init__(self, render, report, threads):
        frames = render["frames"]
        ms = report["ms_per_step"]
        self.gaussians = mean(frames, "gaussians")
        self.drawn = mean(frames, "binned")
        whole = mean(frames, "ms", "total")
        own = sum(mean(frames, "ms", key) for key in ("cull", "project", "shade")) / whole
        both = ms["forward"] + ms["backward"]
        # Owners' work on Gaussians, and the drawing rank's on pixels, in core seconds
        self.owner = own * both * threads / 1e3
        self.draw = ((1 - own) * both + ms["loss"]) * threads / 1e3


def step(run, nodes, cores, efficiency, batch, gigabits):
    """Seconds of a step: computing, and sending of the busiest rank where both directions are used at once."""
    speed = cores * efficiency
    views = -(-batch // nodes)  # of the rank that draws most
    compute = views * run.draw / speed + batch * run.owner / nodes / speed
    away = run.drawn * (1 - 1 / nodes)
    sent = away * (SPLAT_BYTES + SUM_BYTES) * batch / nodes
    send = sent / (gigabits * 1e9 / 8) + (2 * views * LATENCY if nodes > 1 else 0)
    return compute, send


def table(title, head, rows):
    print(f"\n{title} (predicted)\n")
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("render")
    parser.add_argument("report")
    parser.add_argument("--cores", type=int, default=32, metavar="N", help="cores of a machine [default 32]")
    parser.add_argument("--efficiency", type=float, default=0.7, metavar="E", help="of all cores of one machine [0..1; default 0.7]")
    parser.add_argument("--planes", type=int, default=23, metavar="N", help="numbers of a Gaussian [default 23: SH degree 1]")
    chosen = parser.parse_args()
    with open(chosen.render, encoding="utf-8") as file:
        render = json.load(file)
    with open(chosen.report, encoding="utf-8") as file:
        report = json.load(file)
    run = Run(render, report, report["threads"])
    bytes_a_view = run.drawn * (SPLAT_BYTES + SUM_BYTES)
    print(f"{run.gaussians:.0f} Gaussians, {run.drawn:.0f} drawn in a view; a view takes {run.owner + run.draw:.3f} core seconds, "
          f"{run.owner / (run.owner + run.draw):.0%} of them the owners'; {bytes_a_view / 1e6:.1f} MB a view if all are another rank's")

    rows = []
    for nodes in (1, 2, 4, 8, 16, 32, 64):
        batch, row = max(nodes, 4), [nodes, max(nodes, 4)]
        base = step(run, 1, chosen.cores, chosen.efficiency, batch, 10)[0]
        for gigabits in (10, 25, 100):
            compute, send = step(run, nodes, chosen.cores, chosen.efficiency, batch, gigabits)
            row.append(f"{1e3 * compute:.1f} / {1e3 * send:.1f} ms, {base / max(compute, send):.1f} x" if nodes > 1 else f"{1e3 * compute:.1f} ms")
        rows.append(row)
    table(f"A step on machines of {chosen.cores} cores: computing / sending, speed-up where they overlap",
          ["machines", "photographs a step", "10 Gb/s", "25 Gb/s", "100 Gb/s"], rows)

    rows = []
    for nodes in (2, 4, 8, 16, 32, 64):
        compute, _ = step(run, nodes, chosen.cores, chosen.efficiency, nodes, 10)
        rows.append([nodes, f"{run.drawn * (1 - 1 / nodes) * (SPLAT_BYTES + SUM_BYTES) * 8 / compute / 1e9:.0f}"])
    table("Break-even: the line at which sending takes as long as computing, a photograph a machine and step", ["machines", "Gb/s"], rows)

    held = chosen.planes * 4 * PARAMETER_FLOATS * RESERVE
    rows = [[nodes, f"{500e6 / nodes / 1e6:.0f}", f"{500e6 / nodes * held / 1e9:.0f}", f"{20 * run.drawn * OTHER_BYTES / nodes / 1e9 + 20 * run.drawn * 96 / 1e9:.1f}"]
            for nodes in (1, 4, 16, 64)]
    table("A city of 500 million Gaussians by ranks, a view of it drawing twenty times as many as these",
          ["machines", "million Gaussians each", "GB of parameters and moments each", "GB of a view each"], rows)


if __name__ == "__main__":
    main()
