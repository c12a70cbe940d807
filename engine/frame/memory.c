/* SPDX-License-Identifier: Apache-2.0 */
/* The memory of a pags_frame: an arena that the stages allocate from and that is reset when the next frame begins,
 * and the planes of the picture. From the third frame of the same kind on, no heap call is made. */
#include <stdlib.h>

#include "frame/owners.h"
#include "frame/stages.h"
#include "port/port.h"

pags_result pags_frame_create(pags_tasks *tasks, pags_frame **out) {
  *out = NULL;
  const char *why = "";
  const pags_kernels *const kernels = pags_kernels_get(&why);
  if (!kernels)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s", why);
  PAGS_AUTO(pags_frame_destroy_auto) pags_frame *frame = calloc(1, sizeof *frame);
  PAGS_CHECK_MEMORY(frame, "a frame");
  *frame = (pags_frame){.tasks = tasks, .arena = pags_arena_create(), .kernels = kernels};
  PAGS_CHECK_MEMORY(frame->arena, "a frame");
  *out = pags_take(&frame);
  return PAGS_OK;
}

void pags_frame_destroy(pags_frame *frame) {
  if (!frame)
    return;
  pags_arena_destroy(frame->arena);
  pags_port_aligned_free(frame->planes);
  pags_port_aligned_free(frame->lens_rays);
  free(frame);
}

pags_result pags_frame_alloc(pags_frame *frame, void *array, int64_t count, size_t size, const char *what) {
  void *const block = pags_arena_alloc(frame->arena, (size_t)(count > 0 ? count : 1), size);
  PAGS_CHECK_MEMORY(block, "the %s of a frame (%lld x %zu bytes)", what, (long long)count, size);
  memcpy(array, &block, sizeof block);
  return PAGS_OK;
}

pags_result pags_frame_for(pags_frame *frame, int64_t count, int64_t grain, pags_block_fn *fn, void *context) {
  if (pags_parallel_for(frame->tasks, count, grain, fn, context))
    return PAGS_OK;
  return pags_fail(PAGS_CANCELLED, "cancelled");
}

const pags_frame_stats *pags_frame_stats_get(const pags_frame *frame) {
  return &frame->stats;
}

uint64_t pags_frame_heap_calls(const pags_frame *frame) {
  return pags_arena_heap_calls(frame->arena) + frame->plane_calls;
}

size_t pags_frame_bytes(const pags_frame *frame) {
  return pags_arena_high_water(frame->arena) + (size_t)frame->plane_capacity * PLANE_COUNT * sizeof(float) +
         (frame->lens_rays ? 3 * sizeof(float) * (size_t)frame->plane_size : 0);
}
