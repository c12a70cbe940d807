#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# scene.html in a headless Chromium, without a network, compared with pags render (SCENE=FOLDER: another scene).
. "${0%/*}/common.sh"
build
exec python3 -B tests/outside/scene_html.py "$pags" build/scene-html ${SCENE:+"$scene"}
