#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# format.sh: formats all C and C++ files, and the Python files that tests/format.py lists. tests/figures.py and tests/format.py check them.
set -u
cd "$(dirname "$0")/.." || exit 1
formatter=scripts/.venv/bin/clang-format
if [ ! -x "$formatter" ]; then
  echo "format: $formatter is missing; run make setup-min" >&2
  exit 1
fi
find . \( -path './.git' -o -path './build*' -o -name '.venv' -o -name node_modules -o -name musl \) -prune -o \
  -type f \( -name '*.[ch]' -o -name '*.inl' -o -name '*.cc' \) -print | sort | xargs "$formatter" -i
python3 -B tests/format.py --fix
