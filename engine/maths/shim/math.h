/* SPDX-License-Identifier: Apache-2.0 */
/* Stands in for the system's <math.h> while the files of musl/ are compiled, so that they can stay as they are:
 * declares what they use of it, and gives the functions that they define names of our own. */
#ifndef PAGS_MATHS_SHIM_MATH_H
#define PAGS_MATHS_SHIM_MATH_H

#include <features.h>
#include <float.h>

#if FLT_EVAL_METHOD != 0
#error "floats have to be computed as floats and doubles as doubles (on 32-bit x86: -msse2 -mfpmath=sse)"
#endif
typedef float float_t;
typedef double double_t;

#define M_PI_2 1.57079632679489661923
#define NAN __builtin_nanf("")
#define INFINITY __builtin_inff()
#define isnan(x) __builtin_isnan(x)
#define isinf(x) __builtin_isinf(x)
#define signbit(x) __builtin_signbit(x)
#define fabs(x) __builtin_fabs(x)
#define fabsf(x) __builtin_fabsf(x)
#define floor(x) __builtin_floor(x)
#define sqrt(x) __builtin_sqrt(x) /* IEEE 754 asks for the rounded root, so every system gives the same */

/* The functions that maths/maths.h declares. */
#define acos pags_acos
#define atan pags_atan
#define atan2 pags_atan2
#define cos pags_cos
#define cosf pags_cosf
#define erf pags_erf
#define erfc pags_erfc
#define exp pags_exp
#define exp2 pags_exp2
#define exp2f pags_exp2f
#define expf pags_expf
#define expm1 pags_expm1
#define hypot pags_hypot
#define log pags_log
#define log10 pags_log10
#define log1p pags_log1p
#define log2 pags_log2
#define log2f pags_log2f
#define logf pags_logf
#define nextafterf pags_nextafterf
#define pow pags_pow
#define powf pags_powf
#define round pags_round
#define sin pags_sin
#define sinf pags_sinf
#define tan pags_tan

/* What these share. */
#define scalbn pags_musl_scalbn
#define __cos pags_musl_cos
#define __cosdf pags_musl_cosdf
#define __sin pags_musl_sin
#define __sindf pags_musl_sindf
#define __tan pags_musl_tan
#define __rem_pio2 pags_musl_rem_pio2
#define __rem_pio2_large pags_musl_rem_pio2_large
#define __rem_pio2f pags_musl_rem_pio2f
#define __math_divzero pags_musl_divzero
#define __math_divzerof pags_musl_divzerof
#define __math_invalid pags_musl_invalid
#define __math_invalidf pags_musl_invalidf
#define __math_oflow pags_musl_oflow
#define __math_oflowf pags_musl_oflowf
#define __math_uflow pags_musl_uflow
#define __math_uflowf pags_musl_uflowf
#define __math_xflow pags_musl_xflow
#define __math_xflowf pags_musl_xflowf

#include "maths/maths.h"

double scalbn(double x, int n);

#endif
