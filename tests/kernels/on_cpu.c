/* SPDX-License-Identifier: Apache-2.0 */
/* on_cpu NAME PROGRAM ARGS...: runs a program with PAGS_CPU=NAME, or exits with 77 (skipped) if this machine can't
 * run that kernel table. */
#include "simd/kernels.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

int main(int argc, char **argv) {
  if (argc < 3) {
    fprintf(stderr, "usage: on_cpu scalar|avx2|avx512|neon PROGRAM [ARGUMENT...]\n");
    return 2;
  }
  if (!pags_kernels_named(argv[1])) {
    printf("skipped: this machine or build has no %s kernels\n", argv[1]);
    return 77;
  }
  if (setenv("PAGS_CPU", argv[1], 1) == 0)
    execv(argv[2], argv + 2);
  perror(argv[2]);
  return 2;
}
