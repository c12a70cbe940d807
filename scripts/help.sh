#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# help.sh MAKEFILE: prints the targets of MAKEFILE with the text after ##, and the checks in scripts/check with their second comment line.
sed -n 's/^\([a-z%-]*\):.*## \(.*\)/\1 \2/p' "$1" | while read -r name text; do
  [ "$name" != all ] || name=
  printf '  make %-14s %s\n' "$(echo "$name" | sed 's/%/NAME/')" "$text"
done
printf '\nFurther checks:\n'
for script in "$(dirname "$0")"/check/*.sh; do
  name=$(basename "$script" .sh)
  [ "$name" = common ] || printf '  make check-%-18s %s\n' "$name" "$(sed -n '3s/^# //p' "$script")"
done
