/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval: errors per object, over the pixels where a Gaussian of the object has the largest weight. */
#include "cli/measure/errors.h"

#include <stdlib.h>

#include "base/memory.h"
#include "base/psnr.h"
#include "cli/common/ranks.h"

/* Appends the errors of the objects that a view shows; `sums` has a zeroed entry per object. */
static pags_result append(pags_object_errors *errors, const pags_object_error *sums, int64_t object_count) {
  for (int64_t o = 0; o < object_count; o++) {
    if (sums[o].pixels == 0)
      continue;
    PAGS_CHECK_MEMORY(pags_grow(&errors->items, errors->count + 1, &errors->capacity, sizeof *errors->items),
                      "errors of objects");
    errors->items[errors->count++] = sums[o];
  }
  return PAGS_OK;
}

pags_result pags_object_errors_add(pags_object_errors *errors, const int32_t *object_of, int64_t object_count,
                                   int64_t view, const pags_picture *picture, const pags_image *render,
                                   const pags_photograph *photo) {
  PAGS_AUTOFREE pags_object_error *sums = calloc((size_t)object_count + 1, sizeof *sums);
  PAGS_CHECK_MEMORY(sums, "%lld objects", (long long)object_count);
  const float *const a = render->data, *const b = photo->image.data;
  for (int64_t o = 0; o < object_count; o++)
    sums[o] = (pags_object_error){.view = view, .object = o};
  for (int y = 0; y < picture->height; y++)
    for (int x = 0; x < picture->width; x++) {
      const int64_t at = (int64_t)y * picture->width + x;
      const int32_t id = picture->id[(int64_t)y * picture->stride + x];
      if (id < 0 || object_of[id] < 0 || (photo->mask && !photo->mask[at]))
        continue;
      pags_object_error *const sum = &sums[object_of[id]];
      sum->pixels++;
      for (int c = 0; c < 3; c++) {
        const double off = (double)(a[3 * at + c] - b[3 * at + c]);
        sum->squared += off * off;
      }
    }
  return append(errors, sums, object_count);
}

pags_result pags_object_errors_gather(pags_object_errors *errors) {
  PAGS_AUTOFREE pags_object_error *all = NULL;
  int64_t count;
  PAGS_TRY(pags_ranks_gather(errors->items, errors->count, sizeof *errors->items, &all, &count));
  if (!all)
    return PAGS_OK;
  free(errors->items);
  *errors = (pags_object_errors){count, count, pags_take(&all)};
  return PAGS_OK;
}

static double psnr(const pags_object_error *error) {
  return pags_psnr(error->squared / (3 * (double)error->pixels));
}

/* Sorts by object, then view: sums don't depend on which rank had which view. */
static int by_object(const void *a, const void *b) {
  const pags_object_error *const x = a, *const y = b;
  if (x->object != y->object)
    return (x->object > y->object) - (x->object < y->object);
  return (x->view > y->view) - (x->view < y->view);
}

void pags_object_errors_put_json(pags_json_writer *writer, const pags_object_errors *errors, const pags_scene *scene,
                                 const pags_dataset *dataset) {
  enum { LEAST = 64 }; /* pixels of a view that can be an object's worst */
  if (errors->count)
    qsort(errors->items, (size_t)errors->count, sizeof *errors->items, by_object);
  pags_json_begin_array(writer, "objects");
  for (int64_t i = 0, end; i < errors->count; i = end) {
    pags_object_error sum = errors->items[i];
    const pags_object_error *worst = &errors->items[i];
    for (end = i + 1; end < errors->count && errors->items[end].object == sum.object; end++) {
      const pags_object_error *const next = &errors->items[end];
      sum.pixels += next->pixels;
      sum.squared += next->squared;
      if ((next->pixels >= LEAST) > (worst->pixels >= LEAST) ||
          ((next->pixels >= LEAST) == (worst->pixels >= LEAST) && psnr(next) < psnr(worst)))
        worst = next;
    }
    pags_json_begin_object(writer, NULL);
    pags_json_put_string(writer, "id", scene->objects[sum.object].record.id);
    pags_json_put_integer(writer, "views", end - i);
    pags_json_put_integer(writer, "pixels", sum.pixels);
    pags_json_put_number(writer, "psnr", psnr(&sum));
    pags_json_put_string(writer, "worst_view", pags_dataset_view(dataset, worst->view)->name);
    pags_json_put_number(writer, "worst_psnr", psnr(worst));
    pags_json_end_object(writer);
  }
  pags_json_end_array(writer);
}
