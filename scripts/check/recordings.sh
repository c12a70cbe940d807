#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Imported recordings compared with the Python packages of their sources; damaged files and tables (5 minutes).
. "${0%/*}/common.sh"
build
sh tests/recordings/setup.sh
python=tests/recordings/.venv/bin/python
for script in sources blind damage; do
  $python -B tests/recordings/check_$script.py "$pags"
done
for table in pickle parquet feather; do
  $python -B tests/recordings/fuzz_tables.py $table 60
done
exec env TOOL_PYTHON=own $python -B tests/recordings/test_ncore.py "$pags"
