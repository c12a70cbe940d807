#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Unit tests and a short training for 64-bit ARM, under an emulator, compared with x86-64 bit by bit.
# Builds program and unit tests without fused multiply-add, runs the tests, and trains and renders a tiny street. The same build for this
# machine must give the same bits: with plain C on both machines, and with NEON compared with AVX2 or AVX-512.
. "${0%/*}/common.sh"
for tool in qemu-aarch64 aarch64-linux-gnu-gcc; do # the second brings the C library that the tests load
  if ! command -v $tool >/dev/null; then
    echo "check-arm64: no $tool (Debian: qemu-user gcc-aarch64-linux-gnu libc6-dev-arm64-cross)" >&2
    exit 1
  fi
done
build="build-cross/linux-arm64-reproducible"

PAGS_BUILD=$build JOBS=$jobs sh scripts/cross.sh linux-arm64 -DPAGS_TESTS=ON -DPAGS_REPRODUCIBLE=ON
cmake --build $build --parallel "$jobs" --target tests
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
