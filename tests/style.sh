#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# style.sh [CC [CXX]]: what can be said about the sources without running them. Prints each fault as FILE:LINE: what is
# wrong, and fails if there was one.
set -u
export LC_ALL=C
cd "$(dirname "$0")/.." || exit 1
cc=${1:-cc}
cxx=${2:-c++}

work=$(mktemp -d) || exit 1
trap 'rm -rf "$work"' EXIT
faults=$work/faults
: >"$faults"

find . \( -path './.git' -o -path './build*' -o -path '*/__pycache__' -o -name '.venv' -o -name node_modules \) -prune -o -type f \
  \( -name '*.[ch]' -o -name '*.inl' -o -name '*.cc' -o -name '*.py' -o -name '*.sh' -o -name '*.cmake' \
  -o -name CMakeLists.txt -o -name Makefile -o -name '*.json' -o -name '*.md' -o -path './.ci/run' \) -print |
  sed 's|^\./||' | sort >"$work/files"
grep -E '\.([ch]|inl|cc)$' "$work/files" >"$work/code"

# ---- Characters ----

# complain WHAT PATTERN [FILES]: every line that matches is a fault.
complain() {
  # The empty file makes grep name its file even where there is one only.
  xargs grep -nE "$2" /dev/null <"${3:-$work/files}" | cut -d: -f1,2 | sed "s|\$|: $1|" >>"$faults"
}
tab=$(printf '\t')
grep -v '^Makefile$' "$work/files" >"$work/untabbed"
complain "tab" "$tab" "$work/untabbed"
complain "blank at the end of the line" '[[:blank:]]$'
complain "carriage return" "$(printf '\r')"
complain "note of unfinished work" '\b(TODO|FIXME|XXX|HACK)\b' "$work/code"
complain "character outside of ASCII" '[^ -~]' "$work/code"

while read -r file; do
  [ -s "$file" ] && [ "$(tail -c 1 "$file" | wc -l)" -eq 0 ] && echo "$file: no newline at the end" >>"$faults"
done <"$work/files"

# ---- Format ----

sh scripts/format.sh --check 2>&1 | grep -E "error:|^format:" | sed -E 's/^([^:]*:[0-9]*):.*/\1: out of format; make format mends it/' | sed 's|^\./||' >>"$faults"

# ---- Which way includes go ----

# Lower numbers know nothing of higher ones; simd and threads know nothing of each other either.
layer() {
  case $1 in
    simd/*) echo 1 ;;
    threads/*) echo 1 ;;
    engine/base/* | engine/scene/* | engine/frame/* | engine/priority/*) echo 2 ;;
    engine/include/pags/base.h | engine/include/pags/camera.h | engine/include/pags/gaussians.h) echo 2 ;;
    engine/include/pags/scene.h | engine/include/pags/frame.h) echo 2 ;;
    engine/*) echo 3 ;;
    exporters/*) echo 4 ;;
    *) echo 5 ;;
  esac
}

# Where an include of `$2` in file $1 leads; nothing for files that aren't ours.
resolve() {
  for folder in "$(dirname "$1")" engine/include threads/include engine simd threads exporters cli tests benchmarks .; do
    if [ -f "$folder/$2" ]; then
      echo "$folder/$2" | sed 's|^\./||'
      return
    fi
  done
}

# shellcheck disable=SC2046 # no blanks in our file names
grep -nE '^[[:blank:]]*#[[:blank:]]*include[[:blank:]]*"' $(cat "$work/code") /dev/null |
  sed -E 's/^([^:]*):([0-9]*):[^"]*"([^"]*)".*/\1 \2 \3/' >"$work/includes"
while read -r file line name; do
  target=$(resolve "$file" "$name")
  if [ -z "$target" ]; then
    echo "$file:$line: includes \"$name\", which is nowhere" >>"$faults"
  elif [ "$(layer "$target")" -gt "$(layer "$file")" ]; then
    echo "$file:$line: ${file%/*} must not know of $target" >>"$faults"
  elif [ "$(layer "$file")" -eq 1 ] && [ "${file%%/*}" != "${target%%/*}" ]; then
    echo "$file:$line: ${file%%/*} and ${target%%/*} must not know of each other" >>"$faults"
  fi
done <"$work/includes"

# ---- Public headers compile alone, in both languages ----

for header in engine/include/pags/*.h threads/include/pags/*.h simd/kernels.h; do
  printf '#include "%s"\n' "${header##*/}" >"$work/alone.c"
  cp "$work/alone.c" "$work/alone.cc"
  folders="-I ${header%/*} -I engine/include -I threads/include"
  # shellcheck disable=SC2086 # several words
  $cc -std=c17 -Wall -Wextra -Wpedantic -Werror -fsyntax-only $folders "$work/alone.c" 2>"$work/messages" ||
    echo "$header: does not compile alone as C: $(grep -m1 error "$work/messages")" >>"$faults"
  case $header in
    simd/*) continue ;; # faces C only
  esac
  # shellcheck disable=SC2086
  $cxx -std=c++17 -Wall -Wextra -Wpedantic -Werror -fsyntax-only $folders "$work/alone.cc" 2>"$work/messages" ||
    echo "$header: does not compile alone as C++: $(grep -m1 error "$work/messages")" >>"$faults"
done

if [ -s "$faults" ]; then
  sort -t: -k1,1 -k2,2n "$faults"
  echo "style: $(wc -l <"$faults") faults"
  exit 1
fi
echo "style: $(wc -l <"$work/files") files, no fault"
