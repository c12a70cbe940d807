/* SPDX-License-Identifier: Apache-2.0 */
/* Former name of photometric.h, kept for programs written for earlier versions; include that instead. */
#ifndef PAGS_LIGHT_H
#define PAGS_LIGHT_H

#include <pags/photometric.h>

#endif
