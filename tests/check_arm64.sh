#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# check_arm64.sh: the engine on 64-bit ARM, under qemu. Builds program and unit tests for it without fused multiply-add, runs the tests, and
# trains and renders a tiny street beside the same build for this machine, which has to give the same bits: with plain C on both, and with
# NEON beside AVX2 or AVX-512.
set -eu
cd "$(dirname "$0")/.."
for tool in qemu-aarch64 aarch64-linux-gnu-gcc; do # the second brings the C library that the tests load
  if ! command -v $tool >/dev/null; then
    echo "check-arm64: no $tool (Debian: qemu-user gcc-aarch64-linux-gnu libc6-dev-arm64-cross)" >&2
    exit 1
  fi
done
jobs=${JOBS:-$(nproc)}
build=build-cross/linux-arm64-reproducible

PAGS_BUILD=$build JOBS=$jobs sh scripts/cross.sh linux-arm64 -DPAGS_TESTS=ON -DPAGS_REPRODUCIBLE=ON
ctest --test-dir $build --output-on-failure --no-tests=error --parallel "$jobs" --exclude-regex '^(style|figures|docs|tools|outside)(\.|$)'

# The program as a script that starts it under the emulator; same_bits.py knows a program by the hash of its file.
mkdir -p $build/emulated
cat >$build/emulated/pags <<END
#!/bin/sh
# $(sha256sum $build/pags | cut -d' ' -f1)
exec qemu-aarch64 -L /usr/aarch64-linux-gnu '$PWD/$build/pags' "\$@"
END
chmod +x $build/emulated/pags
cmake --preset reproducible -DPAGS_TESTS=OFF
cmake --build --preset reproducible --parallel "$jobs" --target pags
exec python3 tests/same_bits.py --reference-build build-reproducible/pags --program $build/emulated/pags --only '^(train|render) street, tiny'
