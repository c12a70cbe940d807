/* SPDX-License-Identifier: Apache-2.0 */
/* pags --version: the version alone in the first line, then the build, of which cmake/build_facts.cmake writes. */
#include "cli/version.h"

#include "simd/kernels.h"

#include <build_facts.h>
#include <pags/base.h>
#include <stdio.h>

void pags_print_version(void) {
  static const char *const names[] = {"avx512", "avx2", "neon", "scalar"};
  printf("pags %s\n", PAGS_VERSION_STRING);
  printf("commit:   %s\n", PAGS_BUILD_COMMIT);
  printf("compiler: %s\n", PAGS_BUILD_COMPILER);
  printf("kernels:  ");
  for (size_t i = 0; i < sizeof names / sizeof *names; i++)
    if (pags_kernels_named(names[i]))
      printf("%s ", names[i]);
  const char *why = NULL;
  const pags_kernels *const used = pags_kernels_get(&why);
  printf("run here; %s%s\n", used ? used->name : why, used ? " is used" : "");
  printf("with:    %s\nwithout: %s\n", PAGS_BUILD_WITH, PAGS_BUILD_WITHOUT);
}
