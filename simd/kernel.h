/* SPDX-License-Identifier: Apache-2.0 */
/* Included by every kernel source: the vector types and the names of the kernels. The kernel NAME is the function
 * pags_ISA_NAME, which kernels.c enters in the table of that instruction set. */
#ifndef PAGS_SIMD_KERNEL_H
#define PAGS_SIMD_KERNEL_H

#include "kernels.h"
#include "vec.h"

#if defined(PAGS_ISA_AVX512)
#define KERNEL(name) pags_avx512_##name
#elif defined(PAGS_ISA_AVX2)
#define KERNEL(name) pags_avx2_##name
#elif defined(PAGS_ISA_NEON)
#define KERNEL(name) pags_neon_##name
#else
#define KERNEL(name) pags_scalar_##name
#endif

/* A kernel has the type of its pointer in the table. */
#define DECLARE(name) __typeof__(*((pags_kernels *)0)->name) KERNEL(name)
DECLARE(project);
DECLARE(shade);
DECLARE(tile_boxes);
DECLARE(bin_count);
DECLARE(bin_fill);
DECLARE(raster);
DECLARE(sample);
DECLARE(raster_depth);
DECLARE(raster_backward);
DECLARE(raster_score);
DECLARE(raster_weights);
DECLARE(sky_find);
DECLARE(sky_blend);
DECLARE(sky_cells);
DECLARE(sky_adam);
DECLARE(project_backward);
DECLARE(adam_replay);
DECLARE(adam_update);
DECLARE(adam_check);
DECLARE(adam_reach);
DECLARE(loss_rows);
DECLARE(opacity_row);
DECLARE(light_row);
DECLARE(light_back);
DECLARE(roofline);
#undef DECLARE

#endif
