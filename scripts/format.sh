#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# format.sh: formats every C and C++ file of the repository. Whether they are in format is checked by tests/figures.py.
set -u
cd "$(dirname "$0")/.." || exit 1
formatter=scripts/.venv/bin/clang-format
if [ ! -x "$formatter" ]; then
  echo "format: $formatter is missing; run make setup" >&2
  exit 1
fi
find . \( -path './.git' -o -path './build*' -o -name '.venv' -o -name node_modules -o -name musl \) -prune -o \
  -type f \( -name '*.[ch]' -o -name '*.inl' -o -name '*.cc' \) -print | sort | xargs "$formatter" -i
