#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# pags view, train --view and pages of pags report in a headless Chromium; 10,000 hostile requests (2 minutes).
. "${0%/*}/common.sh"
build
for script in view report train_view; do
  python3 -B tests/outside/$script.py "$pags" build/view
done
exec env PAGS_VIEW_HOSTILE=10000 python3 -B tests/cli/test_view.py "$pags" Hostile
