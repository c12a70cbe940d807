#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# valgrind.sh PAGS [FOLDER]: the way of a data set through the program under valgrind: made, trained 30 steps, rendered, judged, exported,
# packed. Fails at the first reads of what was never written, accesses out of bounds or blocks that nothing points to any more. AVX2,
# since valgrind knows no AVX-512. FOLDER is written afresh and kept; without one a temporary folder is used and removed. Some minutes.
set -eu
[ $# -ge 1 ] || { echo "usage: valgrind.sh PAGS [FOLDER]" >&2; exit 2; }
command -v valgrind >/dev/null || { echo "skipped: valgrind isn't installed"; exit 77; }
pags=$1
here=$(cd "$(dirname "$0")" && pwd)
if [ $# -ge 2 ]; then
  work=$2
  rm -rf "$work"
  mkdir -p "$work"
else
  work=$(mktemp -d)
  trap 'rm -rf "$work"' EXIT
fi

# check NAME ARGUMENTS...: one run of the program.
check() {
  name=$1
  shift
  begin=$(date +%s)
  if PAGS_CPU=avx2 valgrind -q --error-exitcode=99 --leak-check=full --errors-for-leak-kinds=definite,indirect \
    --show-leak-kinds=definite,indirect --num-callers=24 --suppressions="$here/valgrind.supp" --log-file="$work/$name.valgrind" \
    "$pags" "$@" >"$work/$name.log" 2>&1; then
    echo "$name: no error, $(($(date +%s) - begin)) s"
  else
    code=$?
    echo "$name: exit code $code (99: valgrind's)"
    cat "$work/$name.valgrind" "$work/$name.log"
    exit 1
  fi
}

street=$work/street
scene=$work/scene
check synth synth street -o "$street" --size 64x48 --frames 4 --cameras 1 --samples 1 --objects 3 --lidar-points 300 --no-shifts -j 2
check train train "$street" -o "$scene" --iterations 30 --max-gaussians 1500 --checkpoint-every 20 --preview-every 20 -j 2
check resume train "$street" -o "$scene" --iterations 40 --max-gaussians 1500 --resume -j 2
check render render "$scene" --split train -o "$work/pictures" --early-z bounded -j 2
check eval eval "$scene" --dataset "$street" --json "$work/eval.json" -j 2
check info info "$scene"
check proxies export "$scene" "$work/proxies.glb"
check splats export "$scene" "$work/splats.spz"
check packed export "$scene" "$work/splats.pagsz"
check ply export "$scene" "$work/splats.ply"
check bench bench render "$work/splats.ply" -n 1 -r 1 --sizes 64x48 -j 2
echo "valgrind: nothing found"
