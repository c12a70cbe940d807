/* SPDX-License-Identifier: Apache-2.0 */
/* Implements picture_queue.h: copies pictures into slots and writes all slots in parallel when they are full. */
#include "cli/picture_queue.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* PLANES of a slot: red, green, blue, transmittance, depth, id. */
enum { MOST_SLOTS = 16, PLANES = 6 };

struct pags_picture_slot {
  pags_picture picture; /* its planes point into `planes` */
  pags_camera camera;
  float *planes;   /* memory for PLANES planes of the largest picture so far */
  size_t capacity; /* floats per plane */
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
    slot->result =
        pags_picture_write(queue->writer, &slot->picture, &slot->camera, &slot->scratch, queue->folder, slot->name);
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
  if (!out->slots)
    return pags_out_of_memory(NULL);
  return PAGS_OK;
}

void pags_picture_queue_destroy(pags_picture_queue *queue) {
  for (int i = 0; queue->slots && i < queue->count; i++) {
    free(queue->slots[i].planes);
    free(queue->slots[i].scratch.data);
  }
  free(queue->slots);
  memset(queue, 0, sizeof *queue);
}

static const void *copy_plane(const void *from, size_t bytes, float **to, size_t capacity) {
  if (!from)
    return NULL;
  void *copy = *to;
  memcpy(copy, from, bytes);
  *to += capacity;
  return copy;
}

pags_result pags_picture_queue_put(pags_picture_queue *queue, const pags_picture *picture, const pags_camera *camera,
                                   const char *name) {
  pags_picture_slot *slot = &queue->slots[queue->used];

  /* Copy the picture's planes into the slot, growing it if the picture is larger than any before. */
  size_t count = (size_t)picture->stride * (size_t)picture->height, bytes = count * sizeof(float);
  if (count > slot->capacity) {
    free(slot->planes);
    slot->planes = malloc(PLANES * bytes);
    slot->capacity = slot->planes ? count : 0;
    if (!slot->planes)
      return pags_out_of_memory("a picture of %dx%d", picture->width, picture->height);
  }
  float *to = slot->planes;
  slot->picture = *picture;
  for (int c = 0; c < 3; c++)
    slot->picture.rgb[c] = copy_plane(picture->rgb[c], bytes, &to, slot->capacity);
  slot->picture.transmittance = copy_plane(picture->transmittance, bytes, &to, slot->capacity);
  slot->picture.depth = copy_plane(picture->depth, bytes, &to, slot->capacity);
  slot->picture.id = copy_plane(picture->id, bytes, &to, slot->capacity);

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
