#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# format.sh [--check]: formats every C and C++ file of the repository, or prints FILE:LINE of what is out of format and fails.
set -u
cd "$(dirname "$0")/.." || exit 1
formatter=scripts/.venv/bin/clang-format
if [ ! -x "$formatter" ]; then
  echo "format: $formatter is missing; run make setup" >&2
  exit 1
fi
case ${1-} in
  --check) set -- --dry-run --Werror ;;
  *) set -- -i ;;
esac
find . \( -path './.git' -o -path './build*' -o -name '.venv' -o -name node_modules \) -prune -o \
  -type f \( -name '*.[ch]' -o -name '*.inl' -o -name '*.cc' \) -print | sort | xargs "$formatter" "$@"
