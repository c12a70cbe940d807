/* SPDX-License-Identifier: Apache-2.0 */
/* The table of kernels of one instruction set. */
#include "kernel.h"

#if defined(PAGS_ISA_AVX512)
const pags_kernels pags_kernels_avx512 = {
    .name = "avx512",
#elif defined(PAGS_ISA_AVX2)
const pags_kernels pags_kernels_avx2 = {
    .name = "avx2",
#elif defined(PAGS_ISA_NEON)
const pags_kernels pags_kernels_neon = {
    .name = "neon",
#else
const pags_kernels pags_kernels_scalar = {
    .name = "scalar",
#endif
#if defined(PAGS_FUSED) && (defined(PAGS_ISA_AVX512) || defined(PAGS_ISA_AVX2) || defined(PAGS_ISA_NEON))
    .fuses = true,
#endif
    .project = KERNEL(project),
    .shade = KERNEL(shade),
    .tile_boxes = KERNEL(tile_boxes),
    .bin_count = KERNEL(bin_count),
    .bin_fill = KERNEL(bin_fill),
    .raster = KERNEL(raster),
    .sample = KERNEL(sample),
    .raster_depth = KERNEL(raster_depth),
    .raster_backward = KERNEL(raster_backward),
    .raster_score = KERNEL(raster_score),
    .raster_weights = KERNEL(raster_weights),
    .sky_find = KERNEL(sky_find),
    .sky_blend = KERNEL(sky_blend),
    .sky_cells = KERNEL(sky_cells),
    .sky_adam = KERNEL(sky_adam),
    .project_backward = KERNEL(project_backward),
    .adam_replay = KERNEL(adam_replay),
    .adam_update = KERNEL(adam_update),
    .adam_check = KERNEL(adam_check),
    .adam_reach = KERNEL(adam_reach),
    .loss_rows = KERNEL(loss_rows),
    .opacity_row = KERNEL(opacity_row),
    .light_row = KERNEL(light_row),
    .light_back = KERNEL(light_back),
    .roofline = KERNEL(roofline),
};
