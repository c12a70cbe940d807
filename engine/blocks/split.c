/* SPDX-License-Identifier: Apache-2.0 */
/* Cuts a recording along the drive into blocks, and reads and writes split.json. */
#include <pags/blocks.h>

#include <math.h>
#include <stdio.h>

#include "base/bytes.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/vec3.h"
#include "dataset/block.h"

enum { VERSION = 1, MOST_BLOCKS = 1000 };
static const double FARTHEST = 1e9; /* metres: a place farther from the origin isn't one on the earth */

void pags_blocks_destroy(pags_blocks *split) {
  free(split->recording);
  free(split->ranges);
  free(split->frames);
  free(split->stands);
  *split = (pags_blocks){0};
}

static pags_result allocate(pags_blocks *split, int64_t stands, int count) {
  split->count = count;
  split->stand_count = stands;
  split->ranges = calloc((size_t)count + 1, sizeof *split->ranges);
  split->frames = calloc((size_t)stands + 1, sizeof *split->frames);
  split->stands = calloc((size_t)stands + 1, sizeof *split->stands);
  PAGS_CHECK_MEMORY(split->ranges && split->frames && split->stands, "%d blocks of %lld time steps", count,
                    (long long)stands);
  return PAGS_OK;
}

/* ---- The cut ---- */

/* Finds where the rig stood at each time step: views are sorted by frame. */
static void find_stands(const pags_dataset *dataset, pags_blocks *split) {
  int64_t at = -1, cameras = 0;
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    if (at < 0 || split->frames[at] != view->frame) {
      split->frames[++at] = view->frame;
      cameras = 0;
    }
    cameras++;
    for (int k = 0; k < 3; k++)
      split->stands[at][k] += (view->camera.world_from_camera[4 * k + 3] - split->stands[at][k]) / (double)cameras;
  }
  split->stand_count = at + 1;
}

/* Gives block b the time steps from b / count of the drive to (b + 1) / count as its own, and those within the overlap
 * of either end besides. `along`: how far along the drive each time step is, metres. */
static void share_out(pags_blocks *split, const double *along) {
  for (int b = 0; b < split->count; b++) {
    const double from = split->block * b, to = b + 1 < split->count ? split->block * (b + 1) : (double)INFINITY;
    struct pags_block_range range = {-1, -1, -1, -1};
    for (int64_t i = 0; i < split->stand_count; i++) {
      if (along[i] < from - split->overlap || along[i] >= to + split->overlap)
        continue;
      range.first = range.first < 0 ? split->frames[i] : range.first;
      range.last = split->frames[i];
      if (along[i] < from || along[i] >= to)
        continue;
      range.own_first = range.own_first < 0 ? split->frames[i] : range.own_first;
      range.own_last = split->frames[i];
    }
    split->ranges[b] = range;
  }
}

/* Checks that every block has a time step of its own and a view to train on, and names the split. */
static pags_result check_and_name(const pags_dataset *dataset, pags_blocks *split) {
  const int64_t views = pags_dataset_view_count(dataset);
  uint64_t hash = PAGS_HASH_OF_NOTHING;
  for (int64_t i = 0; i < views; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    hash = pags_hash_bytes(hash, view->name, strlen(view->name) + 1);
    hash = pags_hash_bytes(hash, &view->test, sizeof view->test);
    hash = pags_hash_bytes(hash, view->camera.world_from_camera, sizeof view->camera.world_from_camera);
  }
  for (int b = 0; b < split->count; b++) {
    const struct pags_block_range *range = &split->ranges[b];
    int64_t training = 0;
    for (int64_t i = 0; i < views && range->own_first >= 0; i++) {
      const pags_view *view = pags_dataset_view(dataset, i);
      training += !view->test && view->frame >= range->own_first && view->frame <= range->own_last;
    }
    if (training == 0)
      return pags_fail(PAGS_ERROR_ARGUMENT,
                       "%s: block %d of %d would begin %.1f m along the drive and have no photograph of its own to "
                       "train on; expected longer blocks than %.1f m",
                       pags_dataset_path(dataset), b, split->count, split->block * b, split->block);
    hash = pags_hash_bytes(hash, range, sizeof *range);
  }
  snprintf(split->id, sizeof split->id, "%08x%08x", (unsigned)(hash >> 32), (unsigned)(hash & 0xffffffffu));
  return PAGS_OK;
}

pags_result pags_blocks_plan(const pags_dataset *dataset, double length, double overlap, pags_blocks *split) {
  *split = (pags_blocks){.overlap = overlap};
  const char *path = pags_dataset_path(dataset);
  if (!(pags_dataset_fps(dataset) > 0))
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: a static set (%s); only drives are split, along their path", path,
                     pags_dataset_kind(dataset));
  if (pags_dataset_block(dataset))
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: a block itself; expected the recording, %s", path,
                     pags_dataset_block(dataset)->recording);
  if (!(length > 0) || !(overlap >= 0) || !isfinite(length) || !isfinite(overlap))
    return pags_fail(PAGS_ERROR_ARGUMENT, "blocks of %g m with %g m of overlap: expected lengths above 0 and from 0",
                     length, overlap);
  const int64_t views = pags_dataset_view_count(dataset);
  PAGS_TRY(allocate(split, views, 0));
  find_stands(dataset, split);
  PAGS_AUTOFREE double *along = malloc((size_t)views * sizeof *along);
  split->recording = pags_text_copy(path);
  PAGS_CHECK_MEMORY(along && split->recording, "%s", path);
  along[0] = 0;
  for (int64_t i = 1; i < split->stand_count; i++)
    along[i] = along[i - 1] + pags_distance3(split->stands[i], split->stands[i - 1]);
  split->length = along[split->stand_count - 1];
  const double count = fmax(1, ceil(split->length / length - 1e-9));
  if (count > MOST_BLOCKS)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: %.0f m in blocks of %g m would be %.0f blocks; expected at most %d", path,
                     split->length, length, count, MOST_BLOCKS);
  struct pags_block_range *ranges = realloc(split->ranges, ((size_t)count + 1) * sizeof *ranges);
  PAGS_CHECK_MEMORY(ranges, "%s", path);
  split->ranges = ranges;
  split->count = (int)count;
  split->block = split->length / count;
  share_out(split, along);
  return check_and_name(dataset, split);
}

/* ---- split.json ---- */

pags_result pags_blocks_save(const pags_blocks *split, const char *folder) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer w = {.indent = 1};
  pags_json_begin_object(&w, NULL);
  pags_json_put_integer(&w, "version", VERSION);
  pags_json_put_string(&w, "split", split->id);
  pags_json_put_string(&w, "recording", split->recording);
  pags_json_put_number(&w, "length", split->length);
  pags_json_put_number(&w, "block_length", split->block);
  pags_json_put_number(&w, "overlap", split->overlap);
  pags_json_begin_array(&w, "blocks");
  for (int b = 0; b < split->count; b++) {
    const struct pags_block_range *range = &split->ranges[b];
    pags_json_begin_object(&w, NULL);
    pags_json_put_numbers(&w, "frames", (double[]){range->first, range->last}, 2);
    pags_json_put_numbers(&w, "own", (double[]){range->own_first, range->own_last}, 2);
    pags_json_end_object(&w);
  }
  pags_json_end_array(&w);
  pags_json_begin_array(&w, "path");
  for (int64_t i = 0; i < split->stand_count; i++)
    pags_json_put_numbers(
        &w, NULL, (double[]){split->frames[i], split->stands[i][0], split->stands[i][1], split->stands[i][2]}, 4);
  pags_json_end_array(&w);
  pags_json_end_object(&w);
  return pags_json_writer_save_in_folder(&w, folder, PAGS_SPLIT_FILE);
}

static pags_result read_range(const pags_json *json, const pags_json_value *block, struct pags_block_range *out) {
  double frames[2], own[2];
  PAGS_TRY(pags_json_as_object(json, block, "a block"));
  PAGS_TRY(pags_json_numbers(json, block, "frames", 2, frames));
  PAGS_TRY(pags_json_numbers(json, block, "own", 2, own));
  if (!(frames[0] >= 0 && frames[0] <= own[0] && own[0] <= own[1] && own[1] <= frames[1] && frames[1] < INT32_MAX))
    return pags_json_fail(json, block, "expected time steps in 'frames', and some of them in 'own'");
  *out = (struct pags_block_range){(int)frames[0], (int)frames[1], (int)own[0], (int)own[1]};
  return PAGS_OK;
}

/* Reads a place of the path, whose time step must be later than `before`. */
static pags_result read_stand(const pags_json *json, const pags_json_value *row, int before, int *frame,
                              double stand[3]) {
  double values[4];
  int count = 0;
  for (const pags_json_value *v = row->first; v && count < 4; v = v->next)
    PAGS_TRY(pags_json_as_number(json, v, "a place of the path", &values[count++]));
  if (row->count != 4 || !(values[0] > before && values[0] < INT32_MAX) || values[0] != floor(values[0]))
    return pags_json_fail(json, row, "expected a time step, later than the one before, and three coordinates");
  for (int k = 1; k < 4; k++)
    if (fabs(values[k]) > FARTHEST)
      return pags_json_fail(json, row, "expected coordinates within %g m, found %g", FARTHEST, values[k]);
  *frame = (int)values[0];
  memcpy(stand, values + 1, 3 * sizeof *stand);
  return PAGS_OK;
}

static pags_result read_root(const pags_json *json, pags_blocks *split) {
  const pags_json_value *root = pags_json_root(json), *blocks, *path;
  const char *id;
  int64_t version;
  PAGS_TRY(pags_json_as_object(json, root, "a split"));
  PAGS_TRY(pags_json_integer(json, root, "version", 1, INT32_MAX, &version));
  if (version > VERSION)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: the split's version is %lld, this program reads up to %d",
                     pags_json_path(json), (long long)version, VERSION);
  PAGS_TRY(pags_json_string(json, root, "split", &id));
  if (strlen(id) >= sizeof split->id)
    return pags_json_fail(json, pags_json_member(root, "split"), "expected %zu hexadecimal digits for 'split'",
                          sizeof split->id - 1);
  snprintf(split->id, sizeof split->id, "%s", id);
  PAGS_TRY(pags_json_string_copy(json, root, "recording", &split->recording));
  PAGS_TRY(pags_json_number(json, root, "length", &split->length));
  PAGS_TRY(pags_json_number(json, root, "block_length", &split->block));
  PAGS_TRY(pags_json_number(json, root, "overlap", &split->overlap));
  PAGS_TRY(pags_json_array(json, root, "blocks", &blocks));
  PAGS_TRY(pags_json_array(json, root, "path", &path));
  if (blocks->count < 1 || blocks->count > MOST_BLOCKS || path->count < 1)
    return pags_json_fail(json, blocks, "expected 1 to %d blocks and a path, found %lld blocks and %lld places",
                          MOST_BLOCKS, (long long)blocks->count, (long long)path->count);
  PAGS_TRY(allocate(split, path->count, (int)blocks->count));
  int64_t i = 0;
  for (const pags_json_value *v = blocks->first; v; v = v->next)
    PAGS_TRY(read_range(json, v, &split->ranges[i++]));
  i = 0;
  int before = -1;
  for (const pags_json_value *v = path->first; v; v = v->next, before = split->frames[i++])
    PAGS_TRY(read_stand(json, v, before, &split->frames[i], split->stands[i]));
  return PAGS_OK;
}

pags_result pags_blocks_load(const char *folder, pags_blocks *split) {
  *split = (pags_blocks){0};
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_TRY(pags_json_parse_in_folder(folder, PAGS_SPLIT_FILE, &json));
  if (!json)
    return pags_fail(PAGS_ERROR_IO, "%s: has no %s; expected a folder that pags split wrote", folder, PAGS_SPLIT_FILE);
  return read_root(json, split);
}

/* ---- The blocks ---- */

pags_result pags_blocks_write(const pags_blocks *split, const char *folder, const pags_dataset_options *options,
                              const char *whole) {
  for (int b = 0; b < split->count; b++) {
    const struct pags_block_range *range = &split->ranges[b];
    const pags_block block = {.split = split->id,
                              .number = b,
                              .count = split->count,
                              .recording = split->recording,
                              .whole = whole,
                              .first = range->first,
                              .last = range->last,
                              .own_first = range->own_first,
                              .own_last = range->own_last};
    PAGS_AUTOFREE char *path = pags_text_format("%s/%03d", folder, b);
    PAGS_CHECK_MEMORY(path, "%s", folder);
    PAGS_TRY(pags_block_write(path, &block, options));
  }
  return PAGS_OK;
}
