#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Ranks of mpirun killed, stopped, out of memory, with a full disk, without a link; 1 to 4 ranks give the same bits.
. "${0%/*}/common.sh"
build all failing_malloc mpi_ranks
export PAGS_KILLS=10
python3 -B tests/cluster/test_ranks.py "$pags" Ranks.test_killed Ranks.test_stopped
python3 -B tests/cluster/test_failures.py "$pags" build/tests/cluster/libfailing_malloc.so
"$pags" synth street -q --overwrite -o build/check-cluster/street --size 192x108 --frames 12 --cameras 1 --no-shifts
exec python3 -B benchmarks/cluster_bits.py "$pags" build/check-cluster/street build/check-cluster --iterations 480 --set resolution_floor=32 \
  --max-gaussians 6000
