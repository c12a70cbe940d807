/* SPDX-License-Identifier: Apache-2.0 */
/* Transcendental functions that give the same bits on every system, compiler and processor.
 *
 * C libraries differ in the last bit of exp, pow, sin and the like, and one library differs between processors with and
 * without fused multiply-add. Where such a bit decides (whether a Gaussian is split, a learning rate, a camera),
 * results differ in everything that follows. So the functions are compiled in: the files in musl/ are those of
 * musl 1.2.3, as they are, which descend from FreeBSD's msun and from Arm's optimized-routines; they are plain C,
 * compiled without fused multiply-add. Errors are under 1 ulp, of atan2 and erfc under 3, of exp, exp2, log and pow in
 * double about 0.52 (tests/unit/maths/test_maths.c measures them).
 *
 * They take and return what C17's functions of these names (without pags_) do, domain errors and infinities included,
 * set no errno, need no state and may be called from any thread. Code of ours calls no other transcendental function of
 * <math.h>: the test `maths_symbols` checks what the built libraries ask of the system. sqrt, fabs, floor, ceil, rint,
 * fmod, fmin, fmax, ldexp and frexp are exact by their definition and stay the system's. */
#ifndef PAGS_MATHS_H
#define PAGS_MATHS_H

#ifdef __cplusplus
extern "C" {
#endif

double pags_exp(double x);
double pags_exp2(double x);
double pags_expm1(double x);
double pags_erfc(double x);
double pags_log(double x);
double pags_log2(double x);
double pags_log10(double x);
double pags_log1p(double x);
double pags_pow(double x, double y);
double pags_hypot(double x, double y);
double pags_sin(double x);
double pags_cos(double x);
double pags_tan(double x);
double pags_acos(double x);
double pags_atan(double x);
double pags_atan2(double y, double x);

float pags_expf(float x);
float pags_exp2f(float x);
float pags_logf(float x);
float pags_log2f(float x);
float pags_powf(float x, float y);
float pags_sinf(float x);
float pags_cosf(float x);

/* Exact, but not among the functions that every system's library has inlined or in one form. */
double pags_round(double x);              /* to the nearest integer, halves away from 0 */
float pags_nextafterf(float x, float to); /* the next float after x towards `to` */

#ifdef __cplusplus
}
#endif

#endif
