#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# many_cores.sh BINARIES DATA OUT: times training, frames, densify, prune and checkpoint on 1, 2, 4, 8, ... cores of this machine and compares
# them with the predictions of `pags-bench scaling`. Builds nothing, needs no network.
#
#   BINARIES  folder with pags and pags-bench (build-cross/linux-x64-glibc2.17/bin or build/); a subfolder lib/ is searched for shared libraries
#   DATA      a data set for pags train
#   OUT       folder for the results: many_cores.json, table.txt, and the scenes that were trained; overwritten
#
# STEPS=N changes the length of each training (default 1,000 steps). Each run is pinned to the first N cores by taskset. Scenes of all runs are
# compared byte by byte: they must not depend on the number of threads. Takes about five minutes with the default on 16 cores.
set -eu
[ $# = 3 ] || { echo "usage: many_cores.sh BINARIES DATA OUT" >&2; exit 2; }
binaries=$1 data=$2 out=$3
steps=${STEPS:-1000}
for program in "$binaries/pags" "$binaries/pags-bench"; do
  [ -x "$program" ] || { echo "many_cores: $program: no such program; build it with 'make' or 'make cross TARGET=linux-x64-glibc2.17'" >&2; exit 1; }
done
for tool in taskset python3; do
  command -v $tool >/dev/null || { echo "many_cores: $tool is not installed (Debian: util-linux, python3)" >&2; exit 1; }
done
[ ! -d "$binaries/lib" ] || export LD_LIBRARY_PATH="$binaries/lib"
mkdir -p "$out"

cores=$(nproc)
counts=
n=1
while [ $n -lt "$cores" ]; do counts="$counts $n"; n=$((n * 2)); done
counts="$counts $cores"

for n in $counts; do
  echo "many_cores: $n of $cores cores" >&2
  pinned="taskset -c 0-$((n - 1))"
  rm -rf "$out/scene-$n"
  $pinned "$binaries/pags" train "$data" -o "$out/scene-$n" --iterations "$steps" --set sh_loss=0 --preview-every 0 --threads "$n" --quiet
  $pinned "$binaries/pags-bench" render "$out/scene-$n" --frames 12 --sizes 960x540,1920x1080 --modes off,lossless --threads "$n" --quiet \
    --json "$out/frames-$n.json"
  cmp "$out/scene-1/background.ply" "$out/scene-$n/background.ply"
done
echo "many_cores: predictions" >&2
"$binaries/pags-bench" scaling "$data" -o "$out/scaling" --iterations "$steps" --quiet --measure "$out/curve.json" --json "$out/predicted.json"

# shellcheck disable=SC2086 # a list of numbers
python3 - "$out" "$steps" $counts <<'END' | tee "$out/table.txt"
import json, os, platform, sys

out, steps, counts = sys.argv[1], int(sys.argv[2]), [int(n) for n in sys.argv[3:]]
read = lambda name: json.load(open(os.path.join(out, name)))
processor = next((line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), platform.machine())
rows = []
for n in counts:
    report = read(f"scene-{n}/report.json")
    row = {"cores": n, "training_seconds": report["seconds"], "gaussians": report["gaussians"], "peak_bytes": report["peak_rss_bytes"]}
    row.update({f"{stage}_ms_per_step": ms for stage, ms in report["ms_per_step"].items()})
    for size in read(f"frames-{n}.json")["sizes"]:
        for mode in size["modes"]:
            row[f"frame_ms_{mode['mode']}_{size['width']}x{size['height']}"] = mode["ms"]["frame"]["median"]
    rows.append(row)
curve = read("curve.json")
result = {"processor": processor, "cores": counts[-1], "kernels": curve["kernels"], "version": curve["version"], "steps": steps, "rows": rows,
          "measured_and_predicted": curve["measured"], "costs": read("predicted.json")["predicted"].get("costs")}
json.dump(result, open(os.path.join(out, "many_cores.json"), "w"), indent=1)

print(f"{processor}, {counts[-1]} cores, {curve['kernels']} kernels; {steps} steps, {rows[-1]['gaussians']} Gaussians; same scene on every number of cores\n")
print("| " + " | ".join(["times as fast as one core"] + [str(n) for n in counts]) + " |")
print("|---" * (len(counts) + 1) + "|")
for key, value in rows[0].items():
    if key.endswith(("seconds", "_ms_per_step")) or key.startswith("frame_ms"):
        print("| " + " | ".join([f"{key} ({value:.4g})"] + [f"{value / row[key]:.2f}" if row[key] else "-" for row in rows]) + " |")
print("\n| phase | cores | measured ms | predicted ms | measured / predicted |\n|---|---|---|---|---|")
for m in curve["measured"]:
    least, most, ms = m["predicted_ms_least"], m["predicted_ms_most"], m["ms"]
    error = ms / most if ms > most else ms / least if ms < least else 1
    print(f"| {m['phase']} | {m['workers']} | {ms:.2f} | {least:.2f} to {most:.2f} | {error:.2f} |")
END
