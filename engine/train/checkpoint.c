/* Checkpoint files; the layout is in checkpoint.h. */
#include "train/checkpoint.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "base/file.h"
#include "train/config.h"

static const char magic[8] = "PAGSRUN1";

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "checkpoints are written as little endian memory"
#endif

/* RUN0. */
typedef struct run_record {
  int64_t step, stop, resets, cap, clocked, views, count, sh_degree, clusters;
  double extent, loss, mse;
  uint64_t fingerprint;
} run_record;

static uint32_t crc_add(uint32_t crc, const void *bytes, size_t size) {
  const uint8_t *at = bytes;
  while (size > 0) { /* zlib counts in 32 bits */
    uInt piece = size < 1u << 30 ? (uInt)size : 1u << 30;
    crc = (uint32_t)crc32(crc, at, piece);
    at += piece;
    size -= piece;
  }
  return crc;
}

/* A section under way. */
typedef struct section_writer {
  pags_file_writer file;
  uint32_t crc;
} section_writer;

static pags_result put(section_writer *w, const void *bytes, size_t size) {
  w->crc = crc_add(w->crc, bytes, size);
  return pags_file_writer_put(&w->file, bytes, size);
}

static pags_result open_section(section_writer *w, const char tag[4], uint64_t size) {
  w->crc = 0;
  PAGS_TRY(put(w, tag, 4));
  return put(w, &size, sizeof size);
}

static pags_result close_section(section_writer *w) {
  uint32_t crc = w->crc;
  return pags_file_writer_put(&w->file, &crc, sizeof crc);
}

static pags_result put_whole(section_writer *w, const char tag[4], const void *bytes, size_t size) {
  PAGS_TRY(open_section(w, tag, size));
  PAGS_TRY(put(w, bytes, size));
  return close_section(w);
}

static pags_result put_planes(section_writer *w, const char tag[4], const pags_gaussians *g) {
  int planes = pags_plane_count(g->sh_degree);
  size_t bytes = (size_t)g->count * sizeof(float);
  PAGS_TRY(open_section(w, tag, (uint64_t)planes * bytes));
  for (int p = 0; p < planes; p++)
    PAGS_TRY(put(w, pags_plane(g, p), bytes));
  return close_section(w);
}

static pags_result put_pair(section_writer *w, const char tag[4], const void *a, const void *b, int64_t count) {
  size_t bytes = (size_t)count * sizeof(int32_t);
  PAGS_TRY(open_section(w, tag, 2 * (uint64_t)bytes));
  PAGS_TRY(put(w, a, bytes));
  PAGS_TRY(put(w, b, bytes));
  return close_section(w);
}

static pags_result put_state(section_writer *w, const pags_train_state *s, uint64_t fingerprint) {
  char text[PAGS_CONFIG_TEXT];
  run_record record = {.step = s->step,
                       .stop = s->stop,
                       .resets = s->resets,
                       .cap = s->cap,
                       .clocked = s->clocked,
                       .views = s->schedule.views,
                       .count = s->gaussians.count,
                       .sh_degree = s->gaussians.sh_degree,
                       .clusters = s->adam.cluster_count,
                       .extent = s->schedule.extent,
                       .loss = s->loss,
                       .mse = s->mse,
                       .fingerprint = fingerprint};
  pags_config_write(&s->schedule.config, text);
  PAGS_TRY(pags_file_writer_put(&w->file, magic, sizeof magic));
  PAGS_TRY(put_whole(w, "CONF", text, strlen(text)));
  PAGS_TRY(put_whole(w, "RUN0", &record, sizeof record));
  PAGS_TRY(put_planes(w, "GAUS", &s->gaussians));
  PAGS_TRY(put_planes(w, "MOM1", &s->adam.first));
  PAGS_TRY(put_planes(w, "MOM2", &s->adam.second));
  PAGS_TRY(put_pair(w, "STEP", s->adam.moment_step, s->adam.param_step, s->adam.cluster_count));
  PAGS_TRY(put_pair(w, "STAT", s->density.gradient, s->density.seen, s->gaussians.count));
  return put_whole(w, "END!", "", 0);
}

pags_result pags_checkpoint_save(const char *path, const pags_train_state *state, uint64_t fingerprint) {
  section_writer w = {.crc = 0};
  PAGS_TRY(pags_file_writer_begin(&w.file, path));
  pags_result result = put_state(&w, state, fingerprint);
  if (result != PAGS_OK) {
    pags_file_writer_abort(&w.file);
    return result;
  }
  return pags_file_writer_commit(&w.file);
}

/* What is left to read of a file in memory. */
typedef struct section_reader {
  const char *path;
  const uint8_t *at, *end;
} section_reader;

/* Steps over the next section, which must have that tag and a sound CRC. */
static pags_result next(section_reader *r, const char tag[4], const uint8_t **payload, uint64_t *size) {
  size_t left = (size_t)(r->end - r->at);
  if (left < 16 || memcmp(r->at, tag, 4) != 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected section %.4s at byte %lld from the end", r->path, tag,
                     (long long)left);
  memcpy(size, r->at + 4, sizeof *size);
  if (*size > left - 16)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: section %.4s is cut off", r->path, tag);
  uint32_t crc;
  memcpy(&crc, r->at + 12 + *size, sizeof crc);
  if (crc != crc_add(0, r->at, 12 + (size_t)*size))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: section %.4s: wrong CRC", r->path, tag);
  *payload = r->at + 12;
  r->at += 16 + *size;
  return PAGS_OK;
}

/* The same where the size is known. */
static pags_result next_sized(section_reader *r, const char tag[4], uint64_t wanted, const uint8_t **payload) {
  uint64_t size = 0;
  PAGS_TRY(next(r, tag, payload, &size));
  if (size != wanted)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: section %.4s has %llu bytes, expected %llu", r->path, tag,
                     (unsigned long long)size, (unsigned long long)wanted);
  return PAGS_OK;
}

static pags_result get_planes(section_reader *r, const char tag[4], pags_gaussians *g) {
  int planes = pags_plane_count(g->sh_degree);
  size_t bytes = (size_t)g->count * sizeof(float);
  const uint8_t *payload = NULL;
  PAGS_TRY(next_sized(r, tag, (uint64_t)planes * bytes, &payload));
  for (int p = 0; p < planes; p++)
    memcpy(pags_plane(g, p), payload + (size_t)p * bytes, bytes);
  return PAGS_OK;
}

static pags_result get_pair(section_reader *r, const char tag[4], void *a, void *b, int64_t count) {
  size_t bytes = (size_t)count * sizeof(int32_t);
  const uint8_t *payload = NULL;
  PAGS_TRY(next_sized(r, tag, 2 * (uint64_t)bytes, &payload));
  memcpy(a, payload, bytes);
  memcpy(b, payload + bytes, bytes);
  return PAGS_OK;
}

static pags_result check_record(const char *path, const run_record *r, const pags_train_config *config) {
  int sound = r->step >= 0 && r->stop >= r->step && r->stop <= 2000000000 && r->views >= 1 && r->count >= 0 &&
              r->count <= INT32_MAX - 64 && r->sh_degree == config->sh_degree && isfinite(r->extent) && r->extent > 0 &&
              r->clusters == (r->count + config->cluster_size - 1) / config->cluster_size;
  return sound ? PAGS_OK : pags_fail(PAGS_ERROR_FORMAT, "%s: section RUN0: a number is out of range", path);
}

/* Steps that no run leaves would send replay over the ends of its tables. */
static pags_result check_steps(const char *path, const pags_train_state *s) {
  for (int64_t c = 0; c < s->adam.cluster_count; c++) {
    int32_t moment = s->adam.moment_step[c], param = s->adam.param_step[c];
    if (moment < 0 || param < moment || param > s->step)
      return pags_fail(PAGS_ERROR_FORMAT, "%s: section STEP: cluster %lld is at an impossible step", path,
                       (long long)c);
  }
  return PAGS_OK;
}

static pags_result read_rest(section_reader *r, pags_train_state *s) {
  const uint8_t *payload = NULL;
  PAGS_TRY(get_planes(r, "MOM1", &s->adam.first));
  PAGS_TRY(get_planes(r, "MOM2", &s->adam.second));
  PAGS_TRY(get_pair(r, "STEP", s->adam.moment_step, s->adam.param_step, s->adam.cluster_count));
  PAGS_TRY(get_pair(r, "STAT", s->density.gradient, s->density.seen, s->gaussians.count));
  PAGS_TRY(next_sized(r, "END!", 0, &payload));
  PAGS_TRY(check_steps(r->path, s));
  pags_adam_bound_all(&s->adam, &s->gaussians, &s->clusters, NULL);
  return PAGS_OK;
}

static pags_result read_state(section_reader *r, pags_train_state *s, uint64_t *fingerprint) {
  pags_train_config config = pags_train_config_default();
  const uint8_t *payload = NULL;
  uint64_t size = 0;
  run_record record;
  if (r->end - r->at < (ptrdiff_t)sizeof magic || memcmp(r->at, magic, sizeof magic) != 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: not a checkpoint of this version: expected it to begin with PAGSRUN1",
                     r->path);
  r->at += sizeof magic;
  PAGS_TRY(next(r, "CONF", &payload, &size));
  PAGS_TRY(pags_config_read(&config, (const char *)payload, (size_t)size, r->path));
  PAGS_TRY(pags_train_config_check(&config));
  PAGS_TRY(next_sized(r, "RUN0", sizeof record, &payload));
  memcpy(&record, payload, sizeof record);
  PAGS_TRY(check_record(r->path, &record, &config));
  /* Before memory is asked for: can the file hold that many? */
  if ((uint64_t)record.count * sizeof(float) * (uint64_t)pags_plane_count(config.sh_degree) >
      (uint64_t)(r->end - r->at))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: section GAUS is cut off", r->path);
  pags_gaussians g;
  PAGS_TRY(pags_gaussians_create(&g, record.count, config.sh_degree));
  pags_result result = get_planes(r, "GAUS", &g);
  pags_schedule schedule = pags_schedule_make(&config, record.extent, record.views);
  if (result == PAGS_OK)
    result = pags_state_create(s, &schedule, record.stop, &g);
  pags_gaussians_destroy(&g);
  PAGS_TRY(result);
  s->step = record.step;
  s->resets = record.resets;
  s->cap = record.cap;
  s->clocked = record.clocked;
  s->loss = record.loss;
  s->mse = record.mse;
  *fingerprint = record.fingerprint;
  return read_rest(r, s);
}

pags_result pags_checkpoint_load(const char *path, pags_train_state *state, uint64_t *fingerprint) {
  uint8_t *bytes;
  size_t size;
  *state = (pags_train_state){0};
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  section_reader reader = {.path = path, .at = bytes, .end = bytes + size};
  pags_result result = read_state(&reader, state, fingerprint);
  free(bytes);
  if (result != PAGS_OK)
    pags_state_destroy(state);
  return result;
}
