#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Photographs and a video without cameras, from COLMAP to a trained scene (apt-get install colmap ffmpeg; 5 minutes).
. "${0%/*}/common.sh"
build
exec python3 -B tests/recordings/check_photos.py "$pags"
