/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets of the readers of split.json and block.json. */
#include "fuzz/fuzz.h"

#include <math.h>
#include <string.h>

#include <pags/blocks.h>

#include "dataset/block.h"

/* ---- split.json ---- */

static int run_split(const uint8_t *data, size_t size) {
  pags_blocks split;
  fuzz_file("split.json", data, size);
  const pags_result result = pags_blocks_load(fuzz_folder(), &split);
  for (int b = 0; result == PAGS_OK && b < split.count; b++) {
    const struct pags_block_range *const r = &split.ranges[b];
    FUZZ_CHECK(0 <= r->first && r->first <= r->own_first && r->own_first <= r->own_last && r->own_last <= r->last);
  }
  for (int64_t i = 0; result == PAGS_OK && i < split.stand_count; i++) {
    FUZZ_CHECK(split.frames[i] >= 0 && (i == 0 || split.frames[i] > split.frames[i - 1]));
    FUZZ_CHECK(isfinite(split.stands[i][0] + split.stands[i][1] + split.stands[i][2]));
  }
  if (result != PAGS_OK)
    fuzz_refused(result, "split.json");
  else
    FUZZ_CHECK(split.count >= 1 && split.stand_count >= 1 && split.recording && strlen(split.id) < sizeof split.id);
  pags_blocks_destroy(&split);
  return result == PAGS_OK;
}

static void seed_split(void) {
  fuzz_seed_text(
      "{\"version\": 1, \"split\": \"0123456789abcdef\", \"recording\": \"/drive\", \"length\": 110.5,\n"
      " \"block_length\": 55.25, \"overlap\": 20, \"blocks\": [{\"frames\": [0, 7], \"own\": [0, 4]},\n"
      " {\"frames\": [3, 9], \"own\": [5, 9]}], \"path\": [[0, 1, 2, 3], [5, 50, 2.5, 3], [9, 1e2, 2, -3]]}");
}

static const char *const split_words[] = {"\"version\": ",
                                          "\"split\": ",
                                          "\"recording\": ",
                                          "\"length\": ",
                                          "\"blocks\": [",
                                          "\"frames\": [",
                                          "\"own\": [",
                                          "\"path\": [",
                                          "2147483647",
                                          "1e300",
                                          "-0.5",
                                          "[]",
                                          "{}",
                                          "null",
                                          NULL};
static const fuzz_target split = {
    .name = "split", .seeds = seed_split, .run = run_split, .words = split_words, .times = 256, .smoke = 2000};

/* ---- block.json ---- */

static int run_block(const uint8_t *data, size_t size) {
  pags_block_file block;
  pags_dataset_options options = pags_dataset_options_default();
  const pags_result result = pags_block_read(fuzz_file("block.json", data, size), &block, &options);
  if (result != PAGS_OK) {
    fuzz_refused(result, "block.json");
  } else {
    const pags_block *const f = &block.facts;
    FUZZ_CHECK(f->split && f->recording && 0 <= f->number && f->number < f->count);
    FUZZ_CHECK(0 <= f->first && f->first <= f->own_first && f->own_first <= f->own_last && f->own_last <= f->last);
    FUZZ_CHECK(options.split_every >= -1);
  }
  pags_block_file_destroy(&block);
  return result == PAGS_OK;
}

static void seed_block(void) {
  fuzz_seed_text(
      "{\"version\": 1, \"split\": \"0123456789abcdef\", \"block\": 1, \"blocks\": 3, \"recording\": \"/drive\",\n"
      " \"whole\": \"../whole\", \"frames\": [2, 9], \"own\": [4, 7], \"options\": {\"kind\": \"pags\",\n"
      " \"cameras\": \"0,1\", \"ego_mask\": null, \"split_every\": 10, \"allow_missing\": false}}");
}

static const char *const block_words[] = {"\"version\": ",
                                          "\"split\": ",
                                          "\"block\": ",
                                          "\"blocks\": ",
                                          "\"whole\": ",
                                          "\"recording\": ",
                                          "\"frames\": [",
                                          "\"own\": [",
                                          "\"options\": {",
                                          "\"cameras\": ",
                                          "\"split_every\": ",
                                          "\"allow_missing\": ",
                                          "2147483647",
                                          "-1",
                                          "null",
                                          "true",
                                          NULL};
static const fuzz_target block = {
    .name = "block", .seeds = seed_block, .run = run_block, .words = block_words, .times = 256, .smoke = 2000};

const fuzz_target *const fuzz_targets[] = {&split, &block, NULL};
