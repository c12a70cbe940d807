#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# A reconstruction from end to end: makes a recording of a drive along a ray-traced street, trains on it, renders the drive
# and the same drive 2 m to the right, compares held-out views with their photographs, and exports proxies.
# OUT=FOLDER: results (default build/demo). ITERATIONS=N: training steps (default 3000).
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

step $pags synth street -o "$out/data"
step $pags train "$out/data" -o "$out/scene" --iterations "$iterations" --max-gaussians 250000 --json "$out/train.json"
step $pags render "$out/scene" --path ego -o "$out/drive"
step $pags render "$out/scene" --path ego --shift 2 -o "$out/drive_right"
step $pags eval "$out/scene" --shift --images "$out/compared" --split test --json "$out/eval.json"
step $pags info "$out/scene"
if $pags --version | grep -q '^with:.* proxies'; then # a build without proxies exports splats
  exported=proxies.glb
  set -- "proxies, glTF" "$out/proxies.glb" "their errors" "$out/export.json"
else
  exported=splats.spz
  set -- "splats, SPZ" "$out/splats.spz"
fi
step $pags export "$out/scene" "$out/$exported" --json "$out/export.json"

printf '\nResults of the demo:\n'
printf '  %-24s %s\n' "recording and truth" "$out/data" "trained scene" "$out/scene" "the drive" "$out/drive" \
  "two metres to the right" "$out/drive_right" "held-out views, truth" "$out/compared" "training's figures" "$out/train.json" \
  "quality, held-out views" "$out/eval.json" "$@"
python3 - "$out" <<'END'
import json, sys
train, scores, export = (json.load(open(f"{sys.argv[1]}/{name}.json")) for name in ("train", "eval", "export"))
test = scores["test"]
print(f"  {train['gaussians']} Gaussians after {train['iterations']} steps in {train['seconds']:.0f} s, "
      f"{train['iterations_per_second']:.0f} steps a second at the end")
lpips = f", LPIPS {test['lpips']:.4f} ({scores['lpips_network']})" if test["lpips"] is not None else ""
print(f"  held-out views: PSNR {test['psnr']:.2f} dB, SSIM {test['ssim']:.4f}{lpips}; critical pixels {test['psnr_critical']:.2f} dB, "
      f"moving pixels {test['psnr_moving']:.2f} dB")
for shift in scores["shift"]:
    print(f"  camera moved, {shift['name']}: PSNR {shift['psnr']:.2f} dB, SSIM {shift['ssim']:.4f}")
if "proxies" not in export:
    sys.exit()
critical = [proxy for proxy in export["proxies"] if proxy["critical"]]
off = sorted(proxy["error"]["proxy_to_gaussians"]["mean"] for proxy in critical if "proxy_to_gaussians" in proxy["error"])
print(f"  proxies of {len(critical)} cars, pedestrians and cyclists, {sum(proxy['watertight'] for proxy in critical)} of them closed, "
      f"and {len(export['proxies']) - len(critical)} of the static scene in {export['seconds']:.0f} s; "
      f"{off[len(off) // 2]:.3f} m off the Gaussians' surface (median of {len(off)})")
END

printf '\nLook at it:\n'
printf '  %-24s %s\n' "the report" "$(cd "$out" && pwd)/scene/report.html, in any browser" \
  "the scene in a browser" "$pags view $out/scene" \
  "the scene in Blender" "make addon, install build/pags-blender-*.zip, File > Import > PAGS scene: $out/scene"
