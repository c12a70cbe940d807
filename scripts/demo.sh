#!/bin/sh
# The main job from end to end, with no download: makes pictures of a small room by ray tracing, trains on them, renders an
# orbit, and compares with pictures that training never saw. OUT=FOLDER chooses where results go.
set -eu
cd "$(dirname "$0")/.."

pags=build/pags
out=${OUT:-build/demo}
iterations=${ITERATIONS:-3000}

rm -rf "$out"
mkdir -p "$out"

step() {
  printf '\n== %s\n' "$*"
  "$@"
}

step $pags synth room -o "$out/data"
step $pags train "$out/data" -o "$out/scene" --iterations "$iterations" --max-gaussians 60000 --json "$out/train.json"
step $pags render "$out/scene" --path orbit --frames 24 -o "$out/orbit" --format png
step $pags eval "$out/scene" --json "$out/eval.json"
step $pags info "$out/scene"

printf '\nResults of the demo:\n'
printf '  %-22s %s\n' "pictures and truth" "$out/data" "trained scene" "$out/scene" "rendered orbit" "$out/orbit" \
  "training's figures" "$out/train.json" "quality, held-out views" "$out/eval.json"
python3 - "$out" <<'END'
import json, sys
train, test = (json.load(open(f"{sys.argv[1]}/{name}.json")) for name in ("train", "eval"))
print(f"  {train['gaussians']} Gaussians after {train['iterations']} steps in {train['seconds']:.0f} s, "
      f"{train['iterations_per_second']:.0f} steps a second at the end; "
      f"held-out PSNR {test['test']['psnr']:.2f} dB, SSIM {test['test']['ssim']:.4f}")
END
