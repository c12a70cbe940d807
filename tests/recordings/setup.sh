#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes tests/recordings/.venv with the data sets' development kits, with which check_sources.py compares our importers.
set -eu
cd "$(dirname "$0")/../.."
sh scripts/venv.sh tests/recordings
tests/recordings/.venv/bin/python -m pip install -q --disable-pip-version-check --no-deps nuscenes-devkit==1.2.0 av2==0.3.6 kitti360Scripts==1.0.0 nvidia-ncore==19.8.3
