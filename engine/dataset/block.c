/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes block.json, and cuts a parsed driving set to the time steps of a block (block.h). */
#include "dataset/block.h"

#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"
#include "dataset/driving/driving_set.h"
#include "port/port.h"

enum { VERSION = 1 };

/* The options that a block takes from its split. `is_path`: relative to the current folder. */
static const struct option_text {
  const char *key, *flag;
  size_t offset;
  bool is_path;
} texts[PAGS_BLOCK_TEXTS] = {
    {"kind", "kind", offsetof(pags_dataset_options, kind), false},
    {"cameras", "cameras", offsetof(pags_dataset_options, cameras), false},
    {"holdout_camera", "holdout-camera", offsetof(pags_dataset_options, holdout_camera), false},
    {"ego_mask", "ego-mask", offsetof(pags_dataset_options, ego_mask), true},
    {"critical", "critical", offsetof(pags_dataset_options, critical), false},
    {"sfm", "sfm", offsetof(pags_dataset_options, sfm), true}};

static const char **text_of(const pags_dataset_options *options, size_t offset) {
  return (const char **)((uintptr_t)options + offset);
}

/* ---- Reading ---- */

bool pags_block_is(const char *path) {
  return pags_folder_has(path, PAGS_BLOCK_FILE) ||
         (strcmp(pags_path_name(path), PAGS_BLOCK_FILE) == 0 && pags_file_exists(path));
}

void pags_block_file_destroy(pags_block_file *block) {
  for (int i = 0; i < PAGS_BLOCK_TEXTS; i++)
    free(block->texts[i]);
  free(block->split);
  free(block->recording);
  free(block->whole);
  free(block->path);
  *block = (pags_block_file){0};
}

/* Reads a range of time steps, [first, last]. */
static pags_result read_steps(const pags_json *json, const pags_json_value *root, const char *key, int *first,
                              int *last) {
  double range[2];
  PAGS_TRY(pags_json_numbers(json, root, key, 2, range));
  *first = (int)range[0];
  *last = (int)range[1];
  if (range[0] >= 0 && range[1] < INT32_MAX && *first == range[0] && *last == range[1] && *first <= *last)
    return PAGS_OK;
  return pags_json_fail(json, pags_json_member(root, key), "expected the first and the last time step for '%s'", key);
}

static pags_result refuse(const pags_json *json, const char *flag, const char *given, const char *stated) {
  return pags_fail(
      PAGS_ERROR_ARGUMENT,
      "%s: --%s %s, but the recording was split with %s%s; leave the option out, or split the recording with it",
      pags_json_path(json), flag, given, stated ? stated : "none", stated ? "" : " given");
}

static pags_result take_options(const pags_json *json, const pags_json_value *stated, pags_block_file *out,
                                pags_dataset_options *options) {
  for (int i = 0; i < PAGS_BLOCK_TEXTS; i++) {
    const char *value, **given = text_of(options, texts[i].offset);
    PAGS_TRY(pags_json_string_or(json, stated, texts[i].key, NULL, &value));
    if (value && !(out->texts[i] = pags_text_copy(value)))
      return pags_out_of_memory("%s", out->path);
    if (*given && (!value || strcmp(*given, value) != 0))
      return refuse(json, texts[i].flag, *given, value);
    *given = out->texts[i];
  }
  int64_t every;
  bool missing;
  PAGS_TRY(pags_json_integer_or(json, stated, "split_every", -1, INT32_MAX, -1, &every));
  PAGS_TRY(pags_json_bool_or(json, stated, "allow_missing", false, &missing));
  char given[PAGS_DOUBLE_TEXT], said[PAGS_DOUBLE_TEXT];
  pags_text_from_double(options->split_every, given);
  pags_text_from_double((double)every, said);
  if (options->split_every >= 0 && options->split_every != every)
    return refuse(json, "split-every", given, every < 0 ? NULL : said);
  options->split_every = (int)every;
  options->allow_missing |= missing;
  if (options->frame_first == 0 && options->frame_last < 0)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT, "%s: --frames: a block has its own time steps, %d to %d", out->path,
                   out->facts.first, out->facts.last);
}

static pags_result read_root(const pags_json *json, pags_block_file *out, pags_dataset_options *options) {
  const pags_json_value *root = pags_json_root(json), *stated;
  pags_block *facts = &out->facts;
  int64_t version, number, count;
  const char *whole;
  PAGS_TRY(pags_json_as_object(json, root, "a block"));
  PAGS_TRY(pags_json_integer(json, root, "version", 1, INT32_MAX, &version));
  if (version > VERSION)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: the block's version is %lld, this program reads up to %d", out->path,
                     (long long)version, VERSION);
  PAGS_TRY(pags_json_string_copy(json, root, "split", &out->split));
  if (!*out->split || out->split[strspn(out->split, "0123456789abcdef")])
    return pags_json_fail(json, pags_json_member(root, "split"),
                          "expected hexadecimal digits for 'split', found \"%.40s\"", out->split);
  PAGS_TRY(pags_json_string_copy(json, root, "recording", &out->recording));
  PAGS_TRY(pags_json_string_or(json, root, "whole", NULL, &whole));
  PAGS_TRY(pags_json_integer(json, root, "blocks", 1, INT32_MAX, &count));
  PAGS_TRY(pags_json_integer(json, root, "block", 0, count - 1, &number));
  PAGS_TRY(read_steps(json, root, "frames", &facts->first, &facts->last));
  PAGS_TRY(read_steps(json, root, "own", &facts->own_first, &facts->own_last));
  if (facts->own_first < facts->first || facts->own_last > facts->last)
    return pags_json_fail(json, pags_json_member(root, "own"), "expected time steps of 'frames' for 'own'");
  char *folder = whole ? pags_path_folder(out->path) : NULL;
  out->whole = folder ? pags_path_join(folder, whole) : NULL;
  free(folder);
  if (whole && !out->whole)
    return pags_out_of_memory("%s", out->path);
  facts->split = out->split;
  facts->recording = out->recording;
  facts->whole = out->whole;
  facts->number = (int)number;
  facts->count = (int)count;
  PAGS_TRY(pags_json_object(json, root, "options", &stated));
  return take_options(json, stated, out, options);
}

pags_result pags_block_read(const char *path, pags_block_file *out, pags_dataset_options *options) {
  *out =
      (pags_block_file){.path = pags_dir_exists(path) ? pags_path_join(path, PAGS_BLOCK_FILE) : pags_text_copy(path)};
  PAGS_CHECK_MEMORY(out->path, "%s", path);
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_TRY(pags_json_parse_file(out->path, &json));
  return read_root(json, out, options);
}

/* ---- Writing ---- */

pags_result pags_block_write(const char *folder, const pags_block *block, const pags_dataset_options *options) {
  PAGS_TRY(pags_make_dirs(folder));
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer w = {0};
  pags_json_writer_init(&w, 1);
  pags_json_begin_object(&w, NULL);
  pags_json_put_integer(&w, "version", VERSION);
  pags_json_put_string(&w, "split", block->split);
  pags_json_put_integer(&w, "block", block->number);
  pags_json_put_integer(&w, "blocks", block->count);
  pags_json_put_string(&w, "recording", block->recording);
  pags_json_put_string(&w, "whole", block->whole);
  pags_json_put_numbers(&w, "frames", (double[]){block->first, block->last}, 2);
  pags_json_put_numbers(&w, "own", (double[]){block->own_first, block->own_last}, 2);
  pags_json_begin_object(&w, "options");
  for (int i = 0; i < PAGS_BLOCK_TEXTS; i++) {
    const char *value = *text_of(options, texts[i].offset);
    PAGS_AUTOFREE char *absolute = value && texts[i].is_path ? pags_port_real_path(value) : NULL;
    pags_json_put_string(&w, texts[i].key, absolute ? absolute : value);
  }
  pags_json_put_integer(&w, "split_every", options->split_every);
  pags_json_put_bool(&w, "allow_missing", options->allow_missing != 0);
  pags_json_end_object(&w);
  pags_json_end_object(&w);
  return pags_json_writer_save_in_folder(&w, folder, PAGS_BLOCK_FILE);
}

/* ---- Cutting ---- */

static bool is_used(const pags_block *block, int64_t frame) {
  return frame >= block->first && frame <= block->last;
}

pags_result pags_block_cut(const pags_block *block, pags_parsed_dataset *parsed) {
  pags_driving *driving = parsed->driving;
  int64_t views = 0, sweeps = 0, objects = 0;
  for (int64_t i = 0; i < parsed->count; i++)
    if (is_used(block, parsed->views[i].frame))
      parsed->views[views++] = parsed->views[i];
    else
      pags_parsed_view_destroy(&parsed->views[i]);
  for (int64_t i = 0; i < driving->sweep_count; i++)
    if (is_used(block, driving->sweeps[i].frame))
      driving->sweeps[sweeps++] = driving->sweeps[i];
    else
      free((char *)(uintptr_t)driving->sweeps[i].path);
  for (int64_t i = 0; i < driving->object_count; i++) {
    pags_object *object = &driving->objects[i];
    bool seen = false; /* whether the track has a label at a time step of the block; labels at others are held out */
    for (int64_t k = 0; k < object->keyframe_count; k++) {
      const bool used = is_used(block, object->keyframes[k].frame);
      seen |= used;
      object->keyframes[k].trained &= used;
    }
    if (seen) {
      driving->critical.objects[objects] = driving->critical.objects[i];
      driving->objects[objects++] = *object;
    } else {
      pags_object_destroy(object);
    }
  }
  parsed->count = views;
  driving->sweep_count = sweeps;
  driving->object_count = objects;
  if (views == 0)
    return pags_fail(
        PAGS_ERROR_FORMAT,
        "%s: has no photograph of the time steps %d to %d, which are block %d's; expected the recording that was split",
        driving->root, block->first, block->last, block->number);
  return pags_driving_note(driving,
                           "block %d of %d of this recording: time steps %d to %d, of which %d to %d are its own",
                           block->number, block->count, block->first, block->last, block->own_first, block->own_last);
}
