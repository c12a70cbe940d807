#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# All tests under the address, undefined-behaviour and thread sanitizers (hours; TESTS=REGEX runs some of them).
. "${0%/*}/common.sh"
for preset in ${PRESETS:-asan-ubsan tsan}; do
  cmake --preset "$preset"
  case ${TESTS:-} in
    '^unit'*) cmake --build --preset "$preset" --parallel "$jobs" --target quick_tests ;;
    *) cmake --build --preset "$preset" --parallel "$jobs" --target all tests ;;
  esac
  ctest --preset "$preset" -R "${TESTS:-.}"
done
