#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Signals at random moments, processes that share a folder, and 200 ordinary runs in sequence (20 minutes).
. "${0%/*}/common.sh"
build
exec env PAGS_MOMENTS=10 PAGS_TOGETHER=50 PAGS_ORDINARY=200 python3 -B tests/faults/test_interrupts.py "$pags"
