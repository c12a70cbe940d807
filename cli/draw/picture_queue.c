/* SPDX-License-Identifier: Apache-2.0 */
/* The queue of picture.h: copies pictures into slots and writes all slots in parallel when they are full. */
#include "cli/draw/picture.h"

#include <stdio.h>

#include "base/memory.h"

/* pags_passes has only pointers to planes. */
enum { MOST_SLOTS = 16, PICTURE_PLANES = 6, PASS_PLANES = sizeof(pags_passes) / sizeof(const float *) };
enum { PLANES = PICTURE_PLANES + PASS_PLANES };

struct pags_picture_slot {
  pags_picture picture; /* its planes and those of the passes point into `memory` */
  pags_passes passes;
  pags_camera camera;
  float *memory;
  int64_t capacity; /* floats */
  pags_plane_scratch scratch;
  char name[PAGS_STEM];
  bool written;
  pags_result result;
  char message[1024]; /* copy of the error message, which is local to the worker thread that failed */
};

static void write_slots(void *context, int64_t begin, int64_t end, int worker) {
  const pags_picture_queue *queue = context;
  (void)worker;
  for (int64_t i = begin; i < end; i++) {
    pags_picture_slot *slot = &queue->slots[i];
    slot->result = pags_picture_write(queue->writer, &slot->picture, &slot->passes, &slot->camera, &slot->scratch,
                                      queue->folder, slot->name);
    slot->written = true;
    if (slot->result != PAGS_OK)
      snprintf(slot->message, sizeof slot->message, "%s", pags_error_message());
  }
}

pags_result pags_picture_queue_create(const pags_picture_writer *writer, pags_tasks *tasks, const char *folder,
                                      pags_picture_queue *out) {
  int workers = pags_tasks_workers(tasks), count = workers < MOST_SLOTS ? workers : MOST_SLOTS;
  *out = (pags_picture_queue){.writer = writer, .tasks = tasks, .folder = folder, .count = count};
  out->slots = calloc((size_t)count, sizeof *out->slots);
  PAGS_CHECK_MEMORY(out->slots, NULL);
  return PAGS_OK;
}

void pags_picture_queue_destroy(pags_picture_queue *queue) {
  if (queue->slots)
    for (int i = 0; i < queue->count; i++) {
      free(queue->slots[i].memory);
      free(queue->slots[i].scratch.data);
    }
  free(queue->slots);
}

/* The pointers to planes in a slot; returns how many. */
static int list_planes(pags_picture_slot *slot, const float **list[PLANES]) {
  int count = 0;
  for (int c = 0; c < 3; c++)
    list[count++] = &slot->picture.rgb[c];
  list[count++] = &slot->picture.transmittance;
  list[count++] = &slot->picture.depth;
  list[count++] = (const float **)(void *)&slot->picture.id;
  const float **const passes = (const float **)&slot->passes;
  for (int k = 0; k < PASS_PLANES; k++)
    list[count++] = &passes[k];
  return count;
}

pags_result pags_picture_queue_put(pags_picture_queue *queue, const pags_picture *picture, const pags_passes *passes,
                                   const pags_camera *camera, const char *name) {
  pags_picture_slot *slot = &queue->slots[queue->used];

  /* Copy the planes into the slot, growing its memory if they need more than any before. */
  const size_t count = (size_t)picture->stride * (size_t)picture->height;
  const float **list[PLANES];
  int64_t planes = 0;
  slot->picture = *picture;
  slot->passes = *passes;
  const int listed = list_planes(slot, list);
  for (int k = 0; k < listed; k++)
    planes += *list[k] != NULL;
  PAGS_CHECK_MEMORY(pags_grow(&slot->memory, planes * (int64_t)count, &slot->capacity, sizeof *slot->memory),
                    "a picture of %dx%d", picture->width, picture->height);
  float *to = slot->memory;
  for (int k = 0; k < listed; k++)
    if (*list[k]) {
      memcpy(to, *list[k], count * sizeof *to);
      *list[k] = to;
      to += count;
    }

  slot->camera = *camera;
  slot->picture.depth_sum = NULL;
  snprintf(slot->name, sizeof slot->name, "%s", name);
  slot->written = false;
  queue->used++;
  return queue->used == queue->count ? pags_picture_queue_finish(queue) : PAGS_OK;
}

pags_result pags_picture_queue_finish(pags_picture_queue *queue) {
  int used = queue->used;
  queue->used = 0;
  pags_parallel_for(queue->tasks, used, 1, write_slots, queue);
  for (int i = 0; i < used; i++) {
    if (!queue->slots[i].written) /* the parallel loop was cancelled before it reached this slot */
      write_slots(queue, i, i + 1, 0);
    if (queue->slots[i].result != PAGS_OK)
      return pags_fail(queue->slots[i].result, "%s", queue->slots[i].message);
  }
  return PAGS_OK;
}
