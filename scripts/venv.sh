#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# venv.sh FOLDER: makes FOLDER/.venv from FOLDER/requirements.txt, or updates it when that file has changed. Fails if pip fails.
set -u
cd "$1" || exit 1

if [ -x .venv/bin/python ] && cmp -s requirements.txt .venv/requirements.txt; then
  exit 0
fi
echo "setup: making $1/.venv"
rm -f .venv/requirements.txt
python3 -m venv .venv && .venv/bin/python -m pip install -q --disable-pip-version-check -r requirements.txt || exit 1
cp requirements.txt .venv/requirements.txt
