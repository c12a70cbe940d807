#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# arm64.sh SOURCE BUILD [CMAKE OPTION...]: cross-compiles the kernels and their tests for 64-bit ARM and runs them under
# qemu. Exits with 77 (skipped) if tools for it are missing.
set -eu
source=$1
build=$2
shift 2

for tool in aarch64-linux-gnu-gcc qemu-aarch64; do
  if ! command -v $tool >/dev/null; then
    echo "skipped: no $tool (Debian: gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user)"
    exit 77
  fi
done

cmake -S "$source" -B "$build" -DCMAKE_BUILD_TYPE=Release -DCMAKE_TOOLCHAIN_FILE="$source/cmake/arm64.cmake" \
  -DPAGS_KERNELS_ONLY=ON "$@"
cmake --build "$build" --parallel "$(nproc)"
cd "$build"
exec ctest --output-on-failure --no-tests=error
