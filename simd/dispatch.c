/* SPDX-License-Identifier: Apache-2.0 */
/* Chooses the kernel table at run time, by what the processor supports or by the environment variable PAGS_CPU. */
#include "kernels.h"

#include <stdlib.h>
#include <string.h>

const pags_kernels *pags_kernels_named(const char *name) {
  if (strcmp(name, "scalar") == 0)
    return &pags_kernels_scalar;
#if defined(PAGS_HAVE_X86)
  __builtin_cpu_init();
  if (strcmp(name, "avx2") == 0 && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
      __builtin_cpu_supports("bmi2"))
    return &pags_kernels_avx2;
  if (strcmp(name, "avx512") == 0 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl"))
    return &pags_kernels_avx512;
#elif defined(PAGS_HAVE_NEON)
  if (strcmp(name, "neon") == 0)
    return &pags_kernels_neon;
#endif
  return NULL;
}

const pags_kernels *pags_kernels_get(const char **why) {
  static const char *const best_first[] = {"avx512", "avx2", "neon", "scalar"};
  const char *const forced = getenv("PAGS_CPU");
  if (forced && *forced) {
    const pags_kernels *const table = pags_kernels_named(forced);
    if (!table && why)
      *why = "PAGS_CPU names kernels that this machine or build does not have (scalar, avx2, avx512, neon)";
    return table;
  }
  for (size_t i = 0; i < sizeof best_first / sizeof *best_first; i++) {
    const pags_kernels *const table = pags_kernels_named(best_first[i]);
    if (table)
      return table;
  }
  return &pags_kernels_scalar;
}
