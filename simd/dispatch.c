/* SPDX-License-Identifier: Apache-2.0 */
/* Chooses the kernel table at run time, by what the processor supports or by the environment variable PAGS_CPU. */
#include "kernels.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#if defined(PAGS_HAVE_X86)
#include <cpuid.h>

/* ---- The processor's features ---- */

/* Bits of cpuid (Intel's Software Developer's Manual, volume 2A). __builtin_cpu_supports is not used: some
 * compilers' runtime libraries report it wrongly. */
enum {
  LEAF1_ECX = 1 << 12 | 1 << 23 | 1 << 27 | 1 << 28 | 1 << 29, /* FMA, POPCNT, OSXSAVE, AVX, F16C */
  LEAF7_EBX = 1 << 3 | 1 << 5 | 1 << 8,                        /* BMI1, AVX2, BMI2 */
  LEAF7_EBX_512 = 1 << 16 | 1 << 17 | 1 << 30,                 /* AVX-512 F, DQ, BW */
  SAVED = 0x06,                                                /* the system saves the registers of SSE and AVX */
  SAVED_512 = 0xe6                                             /* and those of AVX-512 */
};
static const unsigned leaf7_ebx_vl = 1u << 31; /* AVX-512 VL */

static bool has_avx2(bool with_avx512) {
  unsigned a, b, c, d;
  if (!__get_cpuid(1, &a, &b, &c, &d) || (c & LEAF1_ECX) != LEAF1_ECX)
    return false;
  unsigned low, high; /* the registers that the system saves for each thread (XCR0) */
  __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
  const unsigned saved = with_avx512 ? SAVED_512 : SAVED,
                 wanted = LEAF7_EBX | (with_avx512 ? LEAF7_EBX_512 | leaf7_ebx_vl : 0);
  return (low & saved) == saved && __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & wanted) == wanted;
}
#endif

/* ---- The table ---- */

const pags_kernels *pags_kernels_named(const char *name) {
  if (strcmp(name, "scalar") == 0)
    return &pags_kernels_scalar;
#if defined(PAGS_HAVE_X86)
  if (strcmp(name, "avx2") == 0 && has_avx2(false))
    return &pags_kernels_avx2;
  if (strcmp(name, "avx512") == 0 && has_avx2(true))
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
