#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Every reader under libFuzzer (clang): MINUTES=1 of processor time per target, LONG_MINUTES for five of them.
# TARGETS="NAME ..." chooses targets (docs/reliability.md).
. "${0%/*}/common.sh"
cmake --preset fuzz
cmake --build --preset fuzz --parallel "$jobs" --target fuzz_targets
minutes=${MINUTES:-1}
# shellcheck disable=SC2086 # a list of names
exec python3 scripts/fuzz.py --minutes "$minutes" --long-minutes "${LONG_MINUTES:-$minutes}" --json build-fuzz/fuzz.json build-fuzz ${TARGETS:-}
