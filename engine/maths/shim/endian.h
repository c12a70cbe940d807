/* SPDX-License-Identifier: Apache-2.0 */
/* The names of <endian.h> that the files of musl/ use, on systems without that header, too. */
#ifndef PAGS_MATHS_SHIM_ENDIAN_H
#define PAGS_MATHS_SHIM_ENDIAN_H

#define __LITTLE_ENDIAN __ORDER_LITTLE_ENDIAN__
#define __BIG_ENDIAN __ORDER_BIG_ENDIAN__
#define __BYTE_ORDER __BYTE_ORDER__

#include <features.h>

#include <math.h>

#endif
