#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Splat files drawn by Babylon.js and Spark in Chromium, compared with pags (SCENE=FOLDER: another scene).
. "${0%/*}/common.sh"
build
exec python3 -B tests/outside/viewers.py "$pags" build/viewers ${SCENE:+"$scene"}
