/* SPDX-License-Identifier: Apache-2.0 */
/* Names of photographs (pictures.h). */
#include "dataset/driving/pictures.h"

#include "base/memory.h"
#include "base/sort.h"

#include <ctype.h>
#include <stdlib.h>
#include <strings.h>

enum { LARGEST_NUMBER = 99999999 };

bool pags_driving_number(const char **at, int *out) {
  int64_t value = 0;
  const char *begin = *at;
  for (; isdigit((unsigned char)**at) && value <= LARGEST_NUMBER; ++*at)
    value = 10 * value + (**at - '0');
  *out = (int)value;
  return *at > begin && value <= LARGEST_NUMBER;
}

bool pags_driving_parse_picture(const char *name, pags_driving_picture *out) {
  const char *at = name;
  out->name = name;
  if (!pags_driving_number(&at, &out->frame) || *at != '_')
    return false;
  out->digits = (int)(at - name);
  at++;
  if (!pags_driving_number(&at, &out->camera))
    return false;
  return strcasecmp(at, ".jpg") == 0 || strcasecmp(at, ".jpeg") == 0 || strcasecmp(at, ".png") == 0;
}

static int by_frame(const void *a, const void *b) {
  const pags_driving_picture *left = a, *right = b;
  if (left->frame != right->frame)
    return left->frame < right->frame ? -1 : 1;
  return left->camera < right->camera ? -1 : left->camera > right->camera;
}

pags_result pags_driving_pictures(const char *folder, const pags_dir_list *list, int64_t *count,
                                  pags_driving_picture **out) {
  *count = 0;
  *out = malloc(((size_t)list->count + 1) * sizeof **out);
  PAGS_CHECK_MEMORY(*out, "%s", folder);
  for (int64_t i = 0; i < list->count; i++)
    *count += pags_driving_parse_picture(list->names[i], &(*out)[*count]);
  pags_sort(*out, *count, sizeof **out, by_frame);
  return PAGS_OK;
}

bool pags_driving_has_picture(const pags_driving_picture *pictures, int64_t count, int frame, int camera) {
  if (frame < 0) {
    for (int64_t i = 0; i < count; i++)
      if (pictures[i].camera == camera)
        return true;
    return false;
  }
  int64_t low = 0, high = count; /* the first picture of the frame, with that camera or a later one */
  while (low < high) {
    const int64_t middle = low + (high - low) / 2;
    const pags_driving_picture *p = &pictures[middle];
    if (p->frame < frame || (p->frame == frame && p->camera < camera))
      low = middle + 1;
    else
      high = middle;
  }
  return low < count && pictures[low].frame == frame && (camera < 0 || pictures[low].camera == camera);
}
