#!/bin/sh
# Makes the Python environment of tools/segment, or brings it up to its requirements. Never fails: nothing else needs it.
set -u
cd "$(dirname "$0")/../tools/segment" || exit 1

if [ -x .venv/bin/python ] && cmp -s requirements.txt .venv/requirements.txt; then
  exit 0
fi
echo "setup: making tools/segment/.venv"
rm -f .venv/requirements.txt
if python3 -m venv .venv && .venv/bin/python -m pip install -q --disable-pip-version-check -r requirements.txt; then
  cp requirements.txt .venv/requirements.txt
else
  echo "setup: could not make tools/segment/.venv; going on without tools/segment and its tests"
fi
