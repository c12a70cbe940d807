/* SPDX-License-Identifier: Apache-2.0 */
/* All kernels, and the table of pointers to them. This file is compiled once per instruction set
 * (simd/CMakeLists.txt). */
#include "kernels.h"
#include "vec.h"

/* The order matters: later files use functions of earlier ones. */
/* clang-format off */
#include "bin.inl"
#include "scan.inl"
#include "project.inl"
#include "shade.inl"
#include "raster.inl"
#include "sample.inl"
#include "raster_backward.inl"
#include "score.inl"
#include "weights.inl"
#include "project_backward.inl"
#include "ssim.inl"
#include "opacity.inl"
#include "light.inl"
#include "sky.inl"
#include "adam.inl"
/* clang-format on */

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
    .project = project,
    .shade = shade,
    .tile_boxes = tile_boxes,
    .bin_count = bin_count,
    .bin_fill = bin_fill,
    .raster = raster,
    .sample = sample,
    .raster_depth = raster_depth,
    .raster_backward = raster_backward,
    .raster_score = raster_score,
    .raster_weights = raster_weights,
    .sky_find = sky_find,
    .sky_blend = sky_blend,
    .sky_cells = sky_cells,
    .sky_adam = sky_adam,
    .project_backward = project_backward,
    .adam_replay = adam_replay,
    .adam_update = adam_update,
    .adam_check = adam_check,
    .adam_reach = adam_reach,
    .loss_rows = loss_rows,
    .opacity_row = opacity_row,
    .light_row = light_row,
    .light_back = light_back,
    .roofline = roofline,
};
