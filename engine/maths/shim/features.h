/* SPDX-License-Identifier: Apache-2.0 */
/* The system's <features.h>, where there is one, and what the files of musl/ use of musl's own. */
#if defined(__has_include_next)
#if __has_include_next(<features.h>)
#include_next <features.h>
#endif
#endif

#ifndef PAGS_MATHS_SHIM_FEATURES_H
#define PAGS_MATHS_SHIM_FEATURES_H

/* Names of our own for the tables. */
#define __exp_data pags_musl_exp_data
#define __exp2f_data pags_musl_exp2f_data
#define __log_data pags_musl_log_data
#define __log2_data pags_musl_log2_data
#define __log2f_data pags_musl_log2f_data
#define __logf_data pags_musl_logf_data
#define __pow_log_data pags_musl_pow_log_data
#define __powf_log2_data pags_musl_powf_log2_data

#ifdef _WIN32
#define hidden
#else
#define hidden __attribute__((visibility("hidden")))
#endif

#endif
