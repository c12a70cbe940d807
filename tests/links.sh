#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# links.sh NM ORACLE BENCH PRODUCT...: fails if a product (an installed program or library) contains a function of the
# benchmarks or of the static library ORACLE, the double-precision renderer. The program BENCH contains such functions,
# which shows that this test finds them.
set -eu
nm=$1
oracle=$2
bench=$3
shift 3
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

symbols() {
  "$nm" "$1" | awk 'NF == 3 { print $3 }' | sort -u
}

"$nm" -g --defined-only "$oracle" | awk 'NF == 3 { print $3 }' | sort -u >"$work/oracle"
symbols "$bench" >"$work/bench"
{
  cat "$work/oracle"
  grep '^pags_bench_' "$work/bench" || true
} | sort -u >"$work/foreign"
seen=$(comm -12 "$work/oracle" "$work/bench" | wc -l)
if [ "$seen" -eq 0 ] || ! grep -q '^pags_bench_' "$work/foreign"; then
  echo "$bench: expected functions of $oracle and of the benchmarks in it, found none: is it stripped?"
  exit 1
fi

status=0
for product in "$@"; do
  symbols "$product" >"$work/product"
  if [ ! -s "$work/product" ]; then
    echo "$product: has no symbols, so what it links can't be seen"
    status=1
  fi
  comm -12 "$work/foreign" "$work/product" >"$work/found"
  if [ -s "$work/found" ]; then
    echo "$product: links $(wc -l <"$work/found") functions of the tests' double-precision renderer or of the benchmarks, such as $(head -n 1 "$work/found")"
    status=1
  fi
done
[ $status -ne 0 ] || echo "links: $# products have none of $(wc -l <"$work/foreign") functions"
exit $status
