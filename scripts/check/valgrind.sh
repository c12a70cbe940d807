#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# A street made, trained, rendered, evaluated and exported under valgrind (some minutes).
# valgrind.sh [PAGS [FOLDER]]: fails at the first read of uninitialised memory, access out of bounds or lost block. Uses AVX2, since valgrind
# does not support AVX-512. FOLDER is replaced and kept; the default is a temporary folder.
. "${0%/*}/common.sh"
command -v valgrind >/dev/null || { echo "skipped: valgrind isn't installed"; exit 77; }
if [ $# -ge 1 ]; then
  pags=$1
else
  build
fi
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
    --show-leak-kinds=definite,indirect --num-callers=24 --suppressions=tests/valgrind.supp --log-file="$work/$name.valgrind" \
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
