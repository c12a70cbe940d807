/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the compiled-in transcendental functions: errors compared with the system's long double functions, special
 * values, and a hash of many results, which is the same on every system. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "base/rng.h"
#include "maths/maths.h"

enum { ARGUMENTS = 20000 };

/* 1 if the system's long double functions are exact enough for a comparison. Those of Windows' C libraries compute
 * in double. */
#ifdef _WIN32
enum { LONG_DOUBLE_IS_BETTER = 0 };
#else
enum { LONG_DOUBLE_IS_BETTER = LDBL_MANT_DIG > DBL_MANT_DIG };
#endif

typedef struct double_case {
  const char *name;
  double (*ours)(double);
  long double (*exact)(long double);
  double from, to; /* range of arguments */
  double most;     /* largest error in ulp */
} double_case;

typedef struct float_case {
  const char *name;
  float (*ours)(float);
  double (*exact)(double);
  float from, to;
  double most;
} float_case;

/* Uses the half-angle formula, as the acosl of some systems (mingw's) has larger errors than our function. */
static long double exact_acos(long double x) {
  return 2 * atan2l(sqrtl(1 - x), sqrtl(1 + x));
}

/* Largest error of powl in ulp of a double: mingw computes y log2(x) with 64 bits, ten of which hold the exponent. */
#ifdef _WIN32
static const double powl_error = 0.125;
#else
static const double powl_error = 0;
#endif

static const double_case double_cases[] = {
    {"exp", pags_exp, expl, -700, 700, 0.53},
    {"exp2", pags_exp2, exp2l, -1000, 1000, 0.53},
    {"expm1", pags_expm1, expm1l, -30, 30, 1},
    {"log", pags_log, logl, 1e-300, 1e3, 0.53},
    {"log near 1", pags_log, logl, 0.9, 1.1, 0.53},
    {"log2", pags_log2, log2l, 1e-300, 1e3, 0.56},
    {"log10", pags_log10, log10l, 1e-300, 1e3, 1},
    {"log1p", pags_log1p, log1pl, -0.9, 10, 1},
    {"sin", pags_sin, sinl, -10, 10, 1},
    {"sin far out", pags_sin, sinl, 1e5, 1e15, 1},
    {"cos", pags_cos, cosl, -10, 10, 1},
    {"cos far out", pags_cos, cosl, 1e5, 1e15, 1},
    {"tan", pags_tan, tanl, -1.5, 1.5, 1},
    {"acos", pags_acos, exact_acos, -1, 1, 1},
    {"atan", pags_atan, atanl, -20, 20, 1},
    {"erfc", pags_erfc, erfcl, -5, 5, 3},
};

static const float_case float_cases[] = {
    {"expf", pags_expf, exp, -87, 88, 0.51},    {"exp2f", pags_exp2f, exp2, -126, 127, 0.51},
    {"logf", pags_logf, log, 1e-30f, 10, 0.82}, {"log2f", pags_log2f, log2, 1e-30f, 10, 0.76},
    {"sinf", pags_sinf, sin, -20, 20, 0.56},    {"cosf", pags_cosf, cos, -20, 20, 0.56},
};

static const size_t double_count = sizeof double_cases / sizeof *double_cases;
static const size_t float_count = sizeof float_cases / sizeof *float_cases;

static double argument(int function, int i, double from, double to) {
  return from + (to - from) * pags_rng_uniform(7, (uint64_t)function, (uint64_t)i);
}

/* Returns the distance in units of the last place of the exact value, as a double or a float. */
static double ulps_of_double(double ours, long double exact) {
  const int exponent = ilogbl(exact) < DBL_MIN_EXP - 1 ? DBL_MIN_EXP - 1 : ilogbl(exact);
  return (double)fabsl(ldexpl((long double)ours - exact, DBL_MANT_DIG - 1 - exponent));
}

static double ulps_of_float(float ours, double exact) {
  const int exponent = ilogb(exact) < FLT_MIN_EXP - 1 ? FLT_MIN_EXP - 1 : ilogb(exact);
  return fabs(ldexp((double)ours - exact, FLT_MANT_DIG - 1 - exponent));
}

static void test_errors_in_double(void **state) {
  (void)state;
  if (!LONG_DOUBLE_IS_BETTER)
    skip();
  for (size_t f = 0; f < double_count; f++) {
    const double_case *c = &double_cases[f];
    double worst = 0;
    for (int i = 0; i < ARGUMENTS; i++) {
      const double x = argument((int)f, i, c->from, c->to);
      worst = fmax(worst, ulps_of_double(c->ours(x), c->exact((long double)x)));
    }
    print_message("%s: %.4f ulp\n", c->name, worst);
    assert_true(worst > 0.4 && worst < c->most);
  }
}

static void test_errors_of_two_arguments(void **state) {
  (void)state;
  if (!LONG_DOUBLE_IS_BETTER)
    skip();
  double pow_worst = 0, atan2_worst = 0, hypot_worst = 0, powf_worst = 0;
  for (int i = 0; i < ARGUMENTS; i++) {
    const double x = argument(50, i, 1e-3, 50), y = argument(51, i, -60, 60), z = argument(52, i, -50, 50);
    pow_worst = fmax(pow_worst, ulps_of_double(pags_pow(x, y), powl((long double)x, (long double)y)));
    atan2_worst = fmax(atan2_worst, ulps_of_double(pags_atan2(y, z), atan2l((long double)y, (long double)z)));
    hypot_worst = fmax(hypot_worst, ulps_of_double(pags_hypot(y, z), hypotl((long double)y, (long double)z)));
    const float s = (float)x, t = (float)(0.25 * y);
    powf_worst = fmax(powf_worst, ulps_of_float(pags_powf(s, t), pow((double)s, (double)t)));
  }
  print_message("pow %.4f, atan2 %.4f, hypot %.4f, powf %.4f ulp\n", pow_worst, atan2_worst, hypot_worst, powf_worst);
  assert_true(pow_worst < 0.53 + powl_error && atan2_worst < 2 && hypot_worst < 1 && powf_worst < 0.83);
}

static void test_errors_in_float(void **state) {
  (void)state;
  for (size_t f = 0; f < float_count; f++) {
    const float_case *c = &float_cases[f];
    double worst = 0;
    for (int i = 0; i < ARGUMENTS; i++) {
      const float x = (float)argument(100 + (int)f, i, (double)c->from, (double)c->to);
      worst = fmax(worst, ulps_of_float(c->ours(x), c->exact((double)x)));
    }
    print_message("%s: %.4f ulp\n", c->name, worst);
    assert_true(worst > 0.4 && worst < c->most);
  }
}

static void test_special_values(void **state) {
  (void)state;
  const double inf = (double)INFINITY, nan = (double)NAN;
  assert_true(pags_exp(-inf) == 0 && pags_exp(inf) == inf && pags_exp(0) == 1 && pags_exp(1000) == inf);
  assert_true(pags_log(0) == -inf && isnan(pags_log(-1)) && pags_log(1) == 0 && pags_log(inf) == inf);
  assert_true(pags_pow(nan, 0) == 1 && pags_pow(2, 10) == 1024 && isnan(pags_pow(-8, 1.0 / 3)) &&
              pags_pow(0, -1) == inf);
  assert_true(isnan(pags_sin(inf)) && signbit(pags_sin(-0.0)) && pags_cos(0) == 1 && pags_tan(0) == 0);
  assert_true(pags_acos(1) == 0 && isnan(pags_acos(1.5)) && pags_atan2(0, -1) > 3 && pags_atan2(-0.0, -1) < -3);
  assert_true(pags_hypot(3, 4) == 5 && pags_hypot(inf, nan) == inf && pags_hypot(1e300, 1e300) < inf);
  assert_true(isnan(pags_exp(nan)) && isnan(pags_log(nan)) && isnan(pags_sin(nan)) && isnan(pags_atan2(nan, 1)));
  assert_true(pags_round(2.5) == 3 && pags_round(-2.5) == -3 && pags_round(0.49999999999999994) == 0);
  assert_true(pags_nextafterf(1, 2) == 1 + FLT_EPSILON && pags_nextafterf(1, 1) == 1);
  assert_true(pags_expf(200) == INFINITY && pags_expf(-200) == 0 && isnan(pags_logf(-1)) && pags_powf(2, 3) == 8);
}

/* FNV-1a hash over the bits of the results, which is the same for every system, compiler and processor. */
static uint64_t add_bits(uint64_t hash, uint64_t bits) {
  for (int i = 0; i < 8; i++)
    hash = (hash ^ (bits >> 8 * i & 255)) * 1099511628211U;
  return hash;
}

static uint64_t bits_of(double value) {
  uint64_t bits;
  memcpy(&bits, &value, sizeof bits);
  return bits;
}

static void test_bits_are_the_same_everywhere(void **state) {
  (void)state;
  uint64_t hash = 14695981039346656037U;
  for (int i = 0; i < ARGUMENTS; i++) {
    for (size_t f = 0; f < double_count; f++)
      hash =
          add_bits(hash, bits_of(double_cases[f].ours(argument((int)f, i, double_cases[f].from, double_cases[f].to))));
    for (size_t f = 0; f < float_count; f++)
      hash = add_bits(hash, bits_of((double)float_cases[f].ours((float)argument(
                                100 + (int)f, i, (double)float_cases[f].from, (double)float_cases[f].to))));
    const double x = argument(50, i, 1e-3, 50), y = argument(51, i, -60, 60);
    hash = add_bits(hash, bits_of(pags_pow(x, y)));
    hash = add_bits(hash, bits_of(pags_atan2(y, x)));
    hash = add_bits(hash, bits_of(pags_hypot(y, x)));
    hash = add_bits(hash, bits_of((double)pags_powf((float)x, (float)(0.25 * y))));
  }
  print_message("bits: 0x%016llx\n", (unsigned long long)hash);
  assert_true(hash == 0xf1a118e1984cb9b8U);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_errors_in_double),
                                     cmocka_unit_test(test_errors_of_two_arguments),
                                     cmocka_unit_test(test_errors_in_float), cmocka_unit_test(test_special_values),
                                     cmocka_unit_test(test_bits_are_the_same_everywhere)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
