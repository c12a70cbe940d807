/* SPDX-License-Identifier: Apache-2.0 */
#ifndef PAGS_CLI_VERSION_H
#define PAGS_CLI_VERSION_H

/* Prints version, commit, compiler, kernels and parts of this build. */
void pags_print_version(void);

#endif
