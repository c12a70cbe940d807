#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# All tests under the address, undefined-behaviour and thread sanitizers (hours; TESTS=quick: those of make quick).
# TESTS=REGEX runs the tests that match; PRESETS="asan-ubsan tsan" chooses the sanitizers.
. "${0%/*}/common.sh"
for preset in ${PRESETS:-asan-ubsan tsan}; do
  cmake --preset "$preset"
  if [ "${TESTS:-}" = quick ]; then
    cmake --build --preset "$preset" --parallel "$jobs" --target quick_tests
    ctest --preset "$preset" --parallel "$jobs" -L quick
  else
    cmake --build --preset "$preset" --parallel "$jobs" --target all tests
    ctest --preset "$preset" -R "${TESTS:-.}"
  fi
done
