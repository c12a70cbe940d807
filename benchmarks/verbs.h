/* SPDX-License-Identifier: Apache-2.0 */
/* Benchmarks of pags-bench that parse their own options: each takes its arguments (without program and name) and
 * returns the exit code. */
#ifndef PAGS_BENCHMARKS_VERBS_H
#define PAGS_BENCHMARKS_VERBS_H

int pags_bench_curve(int argc, char **argv);
int pags_bench_render(int argc, char **argv);
int pags_bench_scale(int argc, char **argv);
int pags_bench_scaling(int argc, char **argv);
int pags_bench_proxies(int argc, char **argv);

#endif
