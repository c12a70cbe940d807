/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets of checkpoints and of the weights file of LPIPS. */
#include "fuzz/fuzz.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include <pags/eval.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/text.h"
#include "dataset/driving/reader.h"
#include "dataset/internal.h"
#include "eval/npz.h"
#include "train/checkpoint.h"
#include "train/run.h"

/* ---- Checkpoints ---- */

enum { VIEWS = 3, OBJECTS = 2, KEYFRAMES = 3, SECTION = 12 };

/* A driving set made in memory, to which a checkpoint's tracks, sky and exposures belong. */
static struct pags_dataset set;
static pags_view views[VIEWS];
static pags_driving driving;
static pags_object objects[OBJECTS];
static pags_keyframe keyframes[OBJECTS][KEYFRAMES];

static void make_dataset(void) {
  for (int i = 0; i < OBJECTS; i++) {
    static char name[] = "a";
    objects[i] = (pags_object){.id = name,
                               .class_name = name,
                               .category = PAGS_CATEGORY_VEHICLE,
                               .size = {4, 2, 1.5},
                               .moving = 1,
                               .keyframe_count = KEYFRAMES};
    objects[i].keyframes = keyframes[i];
    for (int k = 0; k < KEYFRAMES; k++)
      keyframes[i][k] = (pags_keyframe){
          .frame = k, .trained = 1, .time = k, .world_from_object = {1, 0, 0, k, 0, 1, 0, 0, 0, 0, 1, 0}};
  }
  for (int i = 0; i < VIEWS; i++)
    views[i] = (pags_view){.name = "v",
                           .image_path = "v",
                           .frame = i,
                           .camera = {.width = 8,
                                      .height = 6,
                                      .fx = 6,
                                      .fy = 6,
                                      .cx = 4,
                                      .cy = 3,
                                      .world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}}};
  driving = (pags_driving){.object_count = OBJECTS, .objects = objects, .fps = 1};
  set = (struct pags_dataset){.views = views, .count = VIEWS, .parsed = {.driving = &driving}};
}

static void add_model(pags_train_state *state, int64_t object, int64_t count, int with_all) {
  const int degree = state->schedule.config.color.sh_degree;
  pags_gaussians g;
  sample_gaussians(&g, count, degree, 3);
  if (with_all)
    FUZZ_CHECK(pags_gaussians_add_s_sem(&g) == PAGS_OK && pags_gaussians_add_object_id(&g) == PAGS_OK);
  FUZZ_CHECK(pags_state_add_model(state, object, 2.5, &g) == PAGS_OK);
  FUZZ_CHECK(!with_all || pags_model_add_fourier(&state->models[state->model_count - 1], degree) == PAGS_OK);
}

static void seed_checkpoint(void) {
  make_dataset();
  for (int full = 0; full < 2; full++) {
    pags_train_state state;
    pags_train_config config = pags_train_config_default();
    config.schedule.iterations = 100;
    config.color.sh_degree = full;
    config.picture.cluster_size = 16;
    const pags_schedule schedule = pags_schedule_make(&config, 2.5, VIEWS);
    FUZZ_CHECK(pags_state_create(&state, &schedule, 100, 3) == PAGS_OK);
    add_model(&state, -1, full ? 5 : 1, 0);
    FUZZ_CHECK(pags_track_poses_create(&state.tracks, &set) == PAGS_OK);
    if (full) {
      add_model(&state, 0, 2, 1);
      FUZZ_CHECK(pags_sky_fit_prepare(&state.sky, 2) == PAGS_OK &&
                 pags_exposures_create(&state.exposures, &set) == PAGS_OK);
    }
    pags_state_set_step(&state, 50);
    const char *const path = fuzz_file("seed.run", "", 0);
    fuzz_seed_saved(pags_checkpoint_save(path, NULL, false, &state, 77), path);
    pags_state_destroy(&state);
  }
}

static void check_state(const pags_train_state *state) {
  for (int64_t i = 0; i < state->model_count; i++) {
    const pags_train_model *const m = &state->models[i];
    FUZZ_CHECK(m->gaussians.count >= 0 && m->object < state->tracks.count);
    for (int64_t c = 0; c < m->adam.cluster_count; c++)
      FUZZ_CHECK(m->adam.moment_step[c] >= 0 && m->adam.param_step[c] <= state->step);
  }
}

/* Returns whether the run length in the section RUN0 is short. Each step takes 16 bytes in a model's optimiser, memory
 * that isn't in proportion to the file's size. */
static int is_short_run(const uint8_t *data, size_t size) {
  const size_t head = 8 + SECTION;
  if (size < head)
    return 1;
  const uint64_t config = pags_load_u64(data + 12), stop_at = head + 4 + SECTION + 8;
  return config > size || size - config < stop_at + 8 || pags_load_u64(data + config + stop_at) <= 20000 ||
         pags_load_u64(data + config + stop_at) > 10000000;
}

static int run_checkpoint(const uint8_t *data, size_t size) {
  if (!is_short_run(data, size))
    return 0;
  pags_train_state state;
  uint64_t fingerprint;
  pags_checkpoint_facts facts;
  const char *const path = fuzz_file("a.run", data, size);
  const pags_result looked = pags_checkpoint_inspect(path, &facts);
  if (looked != PAGS_OK)
    fuzz_refused(looked, "a.run");
  const pags_result result = pags_checkpoint_load(path, &set, &state, &fingerprint);
  if (result != PAGS_OK) {
    fuzz_refused(result, "");
    return 0;
  }
  check_state(&state);
  /* A checkpoint that was read must give the same bytes when written, or a resumed run would not have the same bits. */
  uint8_t *bytes = NULL;
  size_t again = 0;
  const char *const copy = fuzz_file("b.run", "", 0);
  FUZZ_CHECK(pags_checkpoint_save(copy, NULL, false, &state, fingerprint) == PAGS_OK &&
             pags_file_read(copy, &bytes, &again) == PAGS_OK);
  free(bytes);
  pags_state_destroy(&state);
  return 1;
}

static size_t mend_checkpoint(uint8_t *data, size_t size, size_t capacity) {
  (void)capacity;
  for (size_t at = 8; at < size && size - at >= SECTION + 4;) {
    const uint64_t length = pags_load_u64(data + at + 4);
    if (length > size - at - SECTION - 4)
      break;
    pags_store_u32(data + at + SECTION + length, (uint32_t)crc32(0, data + at, (uInt)(SECTION + length)));
    at += SECTION + (size_t)length + 4;
  }
  return size;
}

static const char *const run_words[] = {
    "PAGSRUN4",   "CONF",        "RUN0",          "MODL",      "GAUS",   "MOM1",     "MOM2", "STEP",
    "STAT",       "OBJI",        "SSEM",          "SQUA",      "TRAK",   "SKY0",     "EXPO", "END!",
    "sh_degree=", "iterations=", "cluster_size=", "strategy=", "=nan\n", "=1e300\n", NULL};
static const fuzz_target checkpoint = {.name = "checkpoint",
                                       .seeds = seed_checkpoint,
                                       .run = run_checkpoint,
                                       .mend = mend_checkpoint,
                                       .words = run_words,
                                       .smoke = 6000};

/* ---- LPIPS weights: the archive and its arrays; a file with the network's real shapes would take 5 MB, so the
 * inputs' arrays are refused, with their names in the message ---- */

static int run_npz(const uint8_t *data, size_t size) {
  pags_npz npz;
  pags_lpips *lpips;
  const pags_result result = pags_npz_parse(data, size, "a.npz", &npz);
  if (result != PAGS_OK) {
    FUZZ_CHECK(!npz.arrays && npz.count == 0);
    fuzz_refused(result, "a.npz");
  } else {
    for (int64_t i = 0; i < npz.count; i++) {
      const pags_npz_array *const a = &npz.arrays[i];
      int64_t count = 1;
      FUZZ_CHECK(a->name && a->data && a->rank >= 0 && a->rank <= PAGS_NPZ_MAX_RANK);
      for (int k = 0; k < a->rank; k++)
        count *= a->shape[k];
      FUZZ_CHECK(count == a->count && count >= 0 && (uint64_t)count <= size);
    }
    pags_npz_destroy(&npz);
  }
  const pags_result loaded = pags_lpips_load(fuzz_file("a.npz", data, size), &lpips);
  if (loaded == PAGS_OK)
    pags_lpips_destroy(lpips);
  else
    fuzz_refused(loaded, "a.npz");
  return result == PAGS_OK;
}

typedef struct npz_writer {
  file_bytes file, directory;
  unsigned members;
} npz_writer;

static void u16(file_bytes *out, unsigned value) {
  bytes_u8(out, value & 255);
  bytes_u8(out, value >> 8 & 255);
}

static void add_member(npz_writer *w, const char *name, const char *shape, int count) {
  file_bytes npy = {0}, header = {0};
  bytes_text(&header, "{'descr': '<f4', 'fortran_order': False, 'shape': (%s), }\n", shape);
  bytes_put(&npy, "\x93NUMPY\1\0", 8);
  u16(&npy, (unsigned)header.size);
  bytes_put(&npy, header.data, header.size);
  for (int i = 0; i < count; i++)
    bytes_f32(&npy, 0.5f + (float)i);
  const uint32_t crc = (uint32_t)crc32(0, npy.data, (uInt)npy.size), at = (uint32_t)w->file.size;
  for (int central = 0; central < 2; central++) {
    file_bytes *const out = central ? &w->directory : &w->file;
    bytes_put(out, central ? "PK\1\2\24\0" : "PK\3\4", central ? 6 : 4);
    bytes_put(out, "\24\0\0\0\0\0\0\0\0\0", 10);
    bytes_u32(out, crc);
    bytes_u32(out, (uint32_t)npy.size);
    bytes_u32(out, (uint32_t)npy.size);
    u16(out, (unsigned)strlen(name));
    u16(out, 0);
    if (central) {
      bytes_put(out, "\0\0\0\0\0\0\0\0\0\0", 10);
      bytes_u32(out, at);
    }
    bytes_text(out, "%s", name);
  }
  bytes_put(&w->file, npy.data, npy.size);
  bytes_free(&npy);
  bytes_free(&header);
  w->members++;
}

static void seed_of_network(const char *own) {
  npz_writer w = {0};
  add_member(&w, "conv1.weight.npy", "2, 3, 1", 6);
  add_member(&w, own, "2, 3, 1", 6);
  add_member(&w, "shift.npy", "3,", 3);
  add_member(&w, "empty.npy", "0, 7", 0);
  add_member(&w, "scalar.npy", "", 1);
  const uint32_t size = (uint32_t)w.directory.size, at = (uint32_t)w.file.size;
  bytes_put(&w.file, w.directory.data, w.directory.size);
  bytes_put(&w.file, "PK\5\6\0\0\0\0", 8);
  u16(&w.file, w.members);
  u16(&w.file, w.members);
  bytes_u32(&w.file, size);
  bytes_u32(&w.file, at);
  u16(&w.file, 0);
  bytes_free(&w.directory);
  fuzz_seed_bytes(w.file);
}

static void seed_npz(void) {
  seed_of_network("fire2.squeeze.weight.npy");
  seed_of_network("conv2.weight.npy");
}

/* Corrects the CRCs of the archive's members by the central directory, wherever bytes look like an entry. */
static size_t mend_npz(uint8_t *data, size_t size, size_t capacity) {
  (void)capacity;
  for (size_t at = 0; size >= 46 && at <= size - 46; at++) {
    if (memcmp(data + at, "PK\1\2", 4) != 0)
      continue;
    const size_t length = pags_load_u32(data + at + 24), local = pags_load_u32(data + at + 42);
    if (local > size || size - local < 30)
      continue;
    const size_t skip = 30 + (size_t)pags_load_u16(data + local + 26) + pags_load_u16(data + local + 28);
    if (skip <= size - local && length <= size - local - skip)
      pags_store_u32(data + at + 16, (uint32_t)crc32(0, data + local + skip, (uInt)length));
  }
  return size;
}

static const char *const npz_words[] = {
    "PK\1\2", "PK\3\4",     "PK\5\6",      "'descr': ",  "'<f4'", "'fortran_order': ",
    "False",  "'shape': (", "\x93NUMPY\2", "2147483647", "(0, ",  NULL};
static const fuzz_target lpips = {
    .name = "lpips", .seeds = seed_npz, .run = run_npz, .mend = mend_npz, .words = npz_words};

const fuzz_target *const fuzz_targets[] = {&checkpoint, &lpips, NULL};
