/* SPDX-License-Identifier: Apache-2.0 */
/* Writes, reads and inspects checkpoints of training runs; the file layout is described in checkpoint.h. Every number
 * read is checked before it is used, so that a damaged file gives an error message. */
#include "train/checkpoint.h"

#include <ctype.h>
#include <zlib.h>

#include "base/file.h"
#include "base/vec3.h"
#include "cluster/shares.h"
#include "simd/kernels.h"
#include "train/config.h"
#include "train/run.h"

static const char magic[8] = {'P', 'A', 'G', 'S', 'R', 'U', 'N', '4'};

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "checkpoints are written as little endian memory"
#endif

/* Payload of section RUN0: the numbers of the run. */
typedef struct run_record {
  int64_t step, stop, resets, cap, clocked, views, models, keyframes, sky_size, exposures, lidar_points;
  double extent, loss, mse, sky_share;
  uint64_t fingerprint;
} run_record;

/* Payload of section MODL: the numbers of one model. `fourier`: number of SH coefficients that change over time;
 * `object_ids`, `s_sem`, `squared`: 1 if the model has them. */
typedef struct model_record {
  int64_t object, count, sh_degree, clusters, fourier, object_ids, s_sem, squared;
  double extent, fourier_gain;
} model_record;

/* ---- Writing ---- */

static uint32_t crc_add(uint32_t crc, const void *bytes, size_t size) {
  const uint8_t *at = bytes;
  while (size > 0) { /* zlib takes 32-bit sizes */
    uInt piece = size < 1u << 30 ? (uInt)size : 1u << 30;
    crc = (uint32_t)crc32(crc, at, piece);
    at += piece;
    size -= piece;
  }
  return crc;
}

/* The file and the CRC of the section being written. All ranks go through the same sections, each with a file of its
 * own, or one `whole` file by rank 0, which takes the rows of all, a column at a time. A failure to write is kept until
 * the end, since the others wait for what a rank sends or takes. */
typedef struct section_writer {
  pags_file_writer file;
  uint32_t crc;
  pags_transport *transport;
  bool whole;
  pags_result failed;
  uint32_t *column; /* [rows of the largest model] at rank 0 */
  int64_t *rows;    /* [ranks] of the model that is being written */
  int64_t *bytes;   /* [ranks] */
} section_writer;

static bool leads(const section_writer *w) {
  return pags_transport_rank(w->transport) == 0;
}

static void put_bytes(section_writer *w, const void *bytes, size_t size) {
  if ((leads(w) || !w->whole) && w->failed == PAGS_OK)
    w->failed = pags_file_writer_put(&w->file, bytes, size);
}

static void put(section_writer *w, const void *bytes, size_t size) {
  w->crc = crc_add(w->crc, bytes, size);
  put_bytes(w, bytes, size);
}

/* A column of four bytes for each row of the model, or each `group` rows. */
static pags_result put_column(section_writer *w, const pags_train_model *m, const void *own, int group) {
  if (!w->whole) {
    put(w, own, (size_t)((m->gaussians.count + group - 1) / group) * sizeof(uint32_t));
    return PAGS_OK;
  }
  int64_t all = 0;
  for (int r = 0; r < pags_transport_ranks(w->transport); r++) {
    w->bytes[r] = (w->rows[r] + group - 1) / group * (int64_t)sizeof(uint32_t);
    all += w->bytes[r];
  }
  PAGS_TRY(
      pags_transport_gather(w->transport, 0, own, w->bytes[pags_transport_rank(w->transport)], w->column, w->bytes));
  if (leads(w))
    put(w, w->column, (size_t)all);
  return PAGS_OK;
}

/* Rows of which the columns are written. */
static int64_t written_rows(const section_writer *w, const pags_train_model *m) {
  return w->whole ? m->total : m->gaussians.count;
}

static void open_section(section_writer *w, const char tag[4], uint64_t size) {
  w->crc = 0;
  put(w, tag, 4);
  put(w, &size, sizeof size);
}

static void close_section(section_writer *w) {
  const uint32_t crc = w->crc;
  put_bytes(w, &crc, sizeof crc);
}

static void put_whole(section_writer *w, const char tag[4], const void *bytes, size_t size) {
  open_section(w, tag, size);
  put(w, bytes, size);
  close_section(w);
}

static pags_result put_planes(section_writer *w, const char tag[4], const pags_train_model *m,
                              const pags_gaussians *g) {
  const int planes = pags_all_planes(g);
  open_section(w, tag, (uint64_t)planes * (uint64_t)written_rows(w, m) * sizeof(float));
  for (int p = 0; p < planes; p++)
    PAGS_TRY(put_column(w, m, pags_any_plane(g, p), 1));
  close_section(w);
  return PAGS_OK;
}

/* A section of one or two columns; b may be NULL. */
static pags_result put_columns(section_writer *w, const char tag[4], const pags_train_model *m, const void *a,
                               const void *b, int group) {
  const int64_t items = (written_rows(w, m) + group - 1) / group;
  open_section(w, tag, (b ? 2 : 1) * (uint64_t)items * sizeof(uint32_t));
  PAGS_TRY(put_column(w, m, a, group));
  if (b)
    PAGS_TRY(put_column(w, m, b, group));
  close_section(w);
  return PAGS_OK;
}

static int64_t keyframes_of(const pags_track_poses *tracks) {
  int64_t keyframes = 0;
  for (int64_t i = 0; i < tracks->count; i++)
    keyframes += tracks->objects[i].keyframe_count;
  return keyframes;
}

static size_t sky_bytes(int64_t size) {
  return 18 * (size_t)size * (size_t)size * sizeof(float);
}

static pags_result put_model(section_writer *w, const pags_train_model *m) {
  const pags_gaussians *g = &m->gaussians;
  const int cluster = m->adam.cluster_size;
  const int64_t rows = written_rows(w, m);
  model_record record = {.object = m->object,
                         .count = rows,
                         .sh_degree = g->sh_degree,
                         .clusters = (rows + cluster - 1) / cluster,
                         .fourier = pags_fourier_planes(g) / PAGS_FOURIER_PLANES,
                         .object_ids = g->object_id != NULL,
                         .s_sem = g->s_sem != NULL,
                         .squared = m->density.squared != NULL,
                         .extent = m->schedule.extent,
                         .fourier_gain = m->fourier_gain};
  if (w->whole)
    PAGS_TRY(pags_share_all(w->transport, &g->count, sizeof g->count, w->rows));
  put_whole(w, "MODL", &record, sizeof record);
  PAGS_TRY(put_planes(w, "GAUS", m, g));
  PAGS_TRY(put_planes(w, "MOM1", m, &m->adam.first));
  PAGS_TRY(put_planes(w, "MOM2", m, &m->adam.second));
  PAGS_TRY(put_columns(w, "STEP", m, m->adam.moment_step, m->adam.param_step, cluster));
  PAGS_TRY(put_columns(w, "STAT", m, m->density.gradient, m->density.seen, 1));
  if (g->object_id)
    PAGS_TRY(put_columns(w, "OBJI", m, g->object_id, NULL, 1));
  if (g->s_sem)
    PAGS_TRY(put_columns(w, "SSEM", m, g->s_sem, NULL, 1));
  return m->density.squared ? put_columns(w, "SQUA", m, m->density.squared, NULL, 1) : PAGS_OK;
}

/* One keyframe's record in section TRAK. */
typedef struct keyframe_record {
  double increment[6]; /* rotation, translation */
  pags_adam6 moments;
} keyframe_record;

static size_t exposure_bytes(const pags_exposures *exposures) {
  return (size_t)(exposures->count + exposures->sensors) * sizeof(pags_exposure);
}

static void put_tracks(section_writer *w, const pags_track_poses *tracks) {
  open_section(w, "TRAK", (uint64_t)keyframes_of(tracks) * sizeof(keyframe_record));
  for (int64_t i = 0; i < tracks->count; i++)
    for (int64_t k = 0; k < tracks->objects[i].keyframe_count; k++) {
      keyframe_record record = {.moments = tracks->moments[i][k]};
      pags_copy3(tracks->objects[i].keyframes[k].rotation, record.increment);
      pags_copy3(tracks->objects[i].keyframes[k].translation, record.increment + 3);
      put(w, &record, sizeof record);
    }
  close_section(w);
}

/* Section KERN: the names of the kernels used, with this process's, by whether they fuse multiply-add. */
static void put_kernels(section_writer *w, const pags_train_state *s) {
  pags_kernel_names names = s->kernels;
  const pags_kernels *const own = pags_kernels_get(NULL);
  if (own) {
    memset(names.of[own->fuses], 0, PAGS_KERNEL_NAME);
    memcpy(names.of[own->fuses], own->name, strlen(own->name));
  }
  put_whole(w, "KERN", &names, sizeof names);
}

/* The begin of sections CAMS and LITE, which holdout tests decide about; the parts follow. */
typedef struct holdout_record {
  pags_holdout_test holdout;
  int64_t items;
} holdout_record;

/* Payload of section TEST: the test of exposures, if there was one. */
typedef struct test_record {
  pags_holdout_test exposures;
  pags_costs costs;
} test_record;

/* Nothing if there was no test. */
static void put_holdout(section_writer *w, const char tag[4], const pags_holdout_test *holdout, const void *parts,
                        int64_t items, size_t each) {
  const holdout_record record = {*holdout, items};
  if (holdout->state == PAGS_HOLDOUT_NONE)
    return;
  open_section(w, tag, sizeof record + (size_t)items * each);
  put(w, &record, sizeof record);
  put(w, parts, (size_t)items * each);
  close_section(w);
}

/* ---- The sky ---- */

/* Own blocks of each rank that are brought together at a time. */
enum { SKY_BLOCKS = 1024 };

/* Values of `each` bytes a texel, of which the ranks have blocks in turn; rank 0 writes all of them. */
static pags_result put_sky_shares(section_writer *w, const pags_sky_fit *sky, const void *own, int64_t each) {
  const int ranks = sky->ranks;
  const int64_t bytes = each * PAGS_SKY_BLOCK, blocks = pags_sky_fit_blocks(sky);
  int64_t left = 6 * (int64_t)sky->sky.size * sky->sky.size * each;
  PAGS_AUTOFREE char *arrived = malloc((size_t)(leads(w) ? 2 * SKY_BLOCKS * ranks * bytes : 1));
  PAGS_TRY(pags_transport_agree(w->transport, arrived ? PAGS_OK : pags_out_of_memory("a sky")));
  for (int64_t first = 0; first * ranks < blocks; first += SKY_BLOCKS) {
    int64_t counts[PAGS_RANKS_MOST], all = 0;
    for (int r = 0; r < ranks; r++) {
      const int64_t rest = pags_sky_fit_own_blocks(sky, r) - first;
      counts[r] = rest < 0 ? 0 : rest < SKY_BLOCKS ? rest : SKY_BLOCKS;
      w->bytes[r] = counts[r] * bytes;
      all += w->bytes[r];
    }
    PAGS_TRY(pags_transport_gather(w->transport, 0, (const char *)own + first * bytes, w->bytes[sky->rank], arrived,
                                   w->bytes));
    if (!leads(w))
      continue;
    char *const in_turn = arrived + SKY_BLOCKS * ranks * bytes;
    const char *from = arrived;
    for (int r = 0; r < ranks; r++)
      for (int64_t i = 0; i < counts[r]; i++, from += bytes)
        memcpy(in_turn + (i * ranks + r) * bytes, from, (size_t)bytes);
    put(w, in_turn, (size_t)(all < left ? all : left));
    left -= all;
  }
  return PAGS_OK;
}

/* With several ranks rank 0's file alone has the sky. */
static int written_sky(const section_writer *w, const pags_sky_fit *sky) {
  return sky->ranks > 1 && !leads(w) ? 0 : sky->sky.size;
}

static pags_result put_sky(section_writer *w, const pags_sky_fit *sky) {
  const size_t bytes = sky_bytes(sky->sky.size), written = sky_bytes(written_sky(w, sky));
  open_section(w, "SKY0", 3 * (uint64_t)written + written / 6);
  if (written > 0)
    put(w, sky->sky.texels, bytes);
  if (bytes > 0 && sky->ranks > 1) {
    PAGS_TRY(put_sky_shares(w, sky, sky->first, 3 * sizeof *sky->first));
    PAGS_TRY(put_sky_shares(w, sky, sky->second, 3 * sizeof *sky->second));
    PAGS_TRY(put_sky_shares(w, sky, sky->visits, sizeof *sky->visits));
  } else if (bytes > 0) {
    put(w, sky->first, bytes);
    put(w, sky->second, bytes);
    put(w, sky->visits, bytes / 6);
  }
  close_section(w);
  return PAGS_OK;
}

/* ---- All of it ---- */

static pags_result put_state(section_writer *w, const pags_train_state *s, uint64_t fingerprint) {
  char text[PAGS_CONFIG_TEXT];
  run_record record = {.step = s->step,
                       .stop = s->stop,
                       .resets = s->resets,
                       .cap = s->cap,
                       .clocked = s->clocked,
                       .views = s->schedule.views,
                       .models = s->model_count,
                       .keyframes = keyframes_of(&s->tracks),
                       .sky_size = written_sky(w, &s->sky),
                       .exposures = s->exposures.count,
                       .lidar_points = s->lidar_points,
                       .extent = s->schedule.extent,
                       .loss = s->loss,
                       .mse = s->mse,
                       .sky_share = s->sky_share,
                       .fingerprint = fingerprint};
  pags_config_write(&s->schedule.config, text);
  put_bytes(w, magic, sizeof magic);
  put_whole(w, "CONF", text, strlen(text));
  put_whole(w, "RUN0", &record, sizeof record);
  for (int64_t i = 0; i < s->model_count; i++)
    PAGS_TRY(put_model(w, &s->models[i]));
  put_tracks(w, &s->tracks);
  PAGS_TRY(put_sky(w, &s->sky));
  put_whole(w, "EXPO", s->exposures.items, exposure_bytes(&s->exposures));
  put_holdout(w, "CAMS", &s->cameras.holdout, s->cameras.items, pags_camera_poses_items(&s->cameras),
              sizeof *s->cameras.items);
  put_holdout(w, "LITE", &s->photometry.holdout, s->photometry.parts, s->photometry.count, sizeof *s->photometry.parts);
  if (s->exposures.holdout.state != PAGS_HOLDOUT_NONE)
    put_whole(w, "TEST", &(test_record){s->exposures.holdout, s->costs}, sizeof(test_record));
  if (s->nonfinite.count > 0)
    put_whole(w, "BADR", &(pags_left_out){s->nonfinite.count, s->nonfinite.first}, sizeof(pags_left_out));
  put_kernels(w, s);
  put_whole(w, "END!", "", 0);
  return PAGS_OK;
}

/* Memory for the columns, and the file where one is written. */
static pags_result begin(section_writer *w, const char *path, const pags_train_state *state, bool writes) {
  int64_t most = 0;
  for (int64_t i = 0; i < state->model_count; i++)
    most = state->models[i].total > most ? state->models[i].total : most;
  w->rows = malloc(2 * (size_t)pags_transport_ranks(w->transport) * sizeof *w->rows);
  w->column = malloc((size_t)(w->whole && writes ? most + 1 : 1) * sizeof *w->column);
  PAGS_CHECK_MEMORY(w->rows && w->column, "a column of %lld Gaussians", (long long)most);
  w->bytes = w->rows + pags_transport_ranks(w->transport);
  return writes ? pags_file_writer_begin(&w->file, path) : PAGS_OK;
}

pags_result pags_checkpoint_save(const char *path, pags_transport *transport, bool whole, const pags_train_state *state,
                                 uint64_t fingerprint) {
  section_writer w = {.transport = transport, .whole = whole};
  const bool writes = leads(&w) || !whole;
  const pags_result begun = begin(&w, path, state, writes);
  pags_result result = pags_transport_agree(transport, begun);
  if (result == PAGS_OK)
    result = put_state(&w, state, fingerprint);
  if (result == PAGS_OK && writes && w.failed == PAGS_OK)
    w.failed = pags_file_writer_commit(&w.file);
  else if (begun == PAGS_OK && writes)
    pags_file_writer_abort(&w.file);
  free(w.rows);
  free(w.column);
  return result == PAGS_OK ? pags_transport_agree(transport, w.failed) : result;
}

/* ---- Reading sections ---- */

/* The part of a file in memory that hasn't been read yet. */
typedef struct section_reader {
  const char *path;
  const uint8_t *at, *end;
} section_reader;

/* Moves past the next section, which must have the given tag and a correct CRC; `payload` and `size` receive its
 * payload. */
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

/* As next(), for a section whose size must be `wanted` bytes. */
static pags_result next_sized(section_reader *r, const char tag[4], uint64_t wanted, const uint8_t **payload) {
  uint64_t size = 0;
  PAGS_TRY(next(r, tag, payload, &size));
  if (size != wanted)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: section %.4s has %llu bytes, expected %llu", r->path, tag,
                     (unsigned long long)size, (unsigned long long)wanted);
  return PAGS_OK;
}

static pags_result get_record(section_reader *r, const char tag[4], void *record, size_t size) {
  const uint8_t *payload = NULL;
  PAGS_TRY(next_sized(r, tag, size, &payload));
  memcpy(record, payload, size);
  return PAGS_OK;
}

static pags_result get_planes(section_reader *r, const char tag[4], pags_gaussians *g) {
  const int planes = pags_all_planes(g);
  const size_t bytes = (size_t)g->count * sizeof(float);
  const uint8_t *payload = NULL;
  PAGS_TRY(next_sized(r, tag, (uint64_t)planes * bytes, &payload));
  for (int p = 0; p < planes; p++)
    memcpy(pags_any_plane(g, p), payload + (size_t)p * bytes, bytes);
  return PAGS_OK;
}

/* A section of one or two columns; b may be NULL. */
static pags_result get_columns(section_reader *r, const char tag[4], void *a, void *b, int64_t count) {
  const size_t bytes = (size_t)count * sizeof(uint32_t);
  const uint8_t *payload = NULL;
  PAGS_TRY(next_sized(r, tag, (b ? 2 : 1) * (uint64_t)bytes, &payload));
  if (bytes > 0)
    memcpy(a, payload, bytes);
  if (bytes > 0 && b)
    memcpy(b, payload + bytes, bytes);
  return PAGS_OK;
}

static pags_result out_of_range(const section_reader *r, const char *tag) {
  return pags_fail(PAGS_ERROR_FORMAT, "%s: section %s: a number is out of range", r->path, tag);
}

/* ---- Reading the state ---- */

static bool is_sound_run(const run_record *r, const pags_dataset *dataset, const pags_track_poses *tracks) {
  const int64_t views = dataset ? pags_dataset_view_count(dataset) : 0;
  return r->step >= 0 && r->stop >= r->step && r->stop <= PAGS_CONFIG_STEPS && r->resets >= 0 && r->resets <= r->step &&
         r->cap >= 0 && (r->clocked == 0 || r->clocked == 1) && r->lidar_points >= 0 && r->views >= 1 &&
         r->views <= INT32_MAX && isfinite(r->extent) && r->extent > 0 && r->models >= 1 &&
         r->models <= 1 + tracks->count && r->keyframes == keyframes_of(tracks) &&
         (r->exposures == 0 || r->exposures == views) && r->sky_size >= 0 && r->sky_size <= 4096 &&
         (r->sky_size == 0 || dataset);
}

/* The SH degree of the coefficients that change over time; a number that none has counts as degree 4. */
static int fourier_degree(const model_record *m) {
  int degree = 0;
  while (degree < 4 && pags_sh_coefficients(degree) != m->fourier)
    degree++;
  return degree;
}

/* Checks a model's record. Models are stored in rising order of their object number, the background (-1) first;
 * `before` is the object number of the model before this one, -2: this is the first. */
static bool is_sound_model(const model_record *m, const pags_train_config *config, int64_t before, int64_t objects) {
  int in_order = before == -2 ? m->object == -1 : m->object > before;
  return in_order && m->object < objects && m->count >= 0 && m->count <= INT32_MAX - 64 &&
         m->sh_degree == config->color.sh_degree && isfinite(m->extent) && m->extent > 0 &&
         m->clusters == (m->count + config->picture.cluster_size - 1) / config->picture.cluster_size &&
         (m->fourier == 0 || fourier_degree(m) <= config->color.sh_degree) &&
         (m->object_ids == 0 || m->object_ids == 1) && (m->s_sem == 0 || m->s_sem == 1) &&
         (m->squared == 0 || m->squared == 1);
}

static pags_result get_model_rest(section_reader *r, const model_record *record, pags_train_state *s,
                                  pags_train_model *m) {
  pags_gaussians *const g = &m->gaussians;
  if (record->fourier)
    PAGS_TRY(pags_model_add_fourier(m, fourier_degree(record)));
  m->fourier_gain = record->fourier_gain;
  PAGS_TRY(get_planes(r, "MOM1", &m->adam.first));
  PAGS_TRY(get_planes(r, "MOM2", &m->adam.second));
  PAGS_TRY(get_columns(r, "STEP", m->adam.moment_step, m->adam.param_step, m->adam.cluster_count));
  PAGS_TRY(get_columns(r, "STAT", m->density.gradient, m->density.seen, g->count));
  if (record->object_ids) { /* each must be -1 or an object of the data set */
    PAGS_TRY(pags_gaussians_add_object_id(g));
    PAGS_TRY(get_columns(r, "OBJI", g->object_id, NULL, g->count));
    for (int64_t i = 0; i < g->count; i++)
      if (g->object_id[i] < -1 || g->object_id[i] >= s->tracks.count)
        return out_of_range(r, "OBJI");
  }
  if (record->s_sem) { /* each must lie in 0..1, since they are written to PLYs and decide what is pruned */
    PAGS_TRY(pags_gaussians_add_s_sem(g));
    PAGS_TRY(get_columns(r, "SSEM", g->s_sem, NULL, g->count));
    for (int64_t i = 0; i < g->count; i++)
      if (!(g->s_sem[i] >= 0.0f && g->s_sem[i] <= 1.0f))
        return out_of_range(r, "SSEM");
  }
  if (record->squared && !m->density.squared)
    return out_of_range(r, "MODL");
  if (record->squared)
    PAGS_TRY(get_columns(r, "SQUA", m->density.squared, NULL, g->count));

  /* Check the clusters' steps: values that no run can produce would make the replay of pending steps read beyond its
   * tables. */
  for (int64_t c = 0; c < m->adam.cluster_count; c++) {
    int32_t moment = m->adam.moment_step[c], param = m->adam.param_step[c];
    if (moment < 0 || param < moment || param > s->step)
      return pags_fail(PAGS_ERROR_FORMAT, "%s: section STEP: cluster %lld is at an impossible step", r->path,
                       (long long)c);
  }
  pags_adam_bound_all(&m->adam, g, &m->clusters, NULL);
  return PAGS_OK;
}

static pags_result get_model(section_reader *r, pags_train_state *s) {
  const pags_train_config *config = &s->schedule.config;
  const int64_t before = s->model_count > 0 ? s->models[s->model_count - 1].object : -2;
  model_record record;
  PAGS_TRY(get_record(r, "MODL", &record, sizeof record));
  if (!is_sound_model(&record, config, before, s->tracks.count))
    return out_of_range(r, "MODL");
  /* Check that the file is long enough for this many Gaussians before memory is allocated for them. */
  if ((uint64_t)record.count * sizeof(float) *
          (uint64_t)(pags_plane_count(config->color.sh_degree) + PAGS_FOURIER_PLANES * record.fourier) >
      (uint64_t)(r->end - r->at))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: section GAUS is cut off", r->path);
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians g = {0};
  PAGS_TRY(pags_gaussians_create(&g, record.count, config->color.sh_degree));
  g.alpha_min = (float)config->picture.alpha_min;
  PAGS_TRY(pags_gaussians_reserve(&g, 1)); /* a shard's model may have columns and no rows */
  if (record.fourier)
    PAGS_TRY(pags_gaussians_add_fourier(&g, fourier_degree(&record)));
  PAGS_TRY(get_planes(r, "GAUS", &g));
  PAGS_TRY(pags_state_add_model(s, record.object, record.extent, &g));
  pags_state_fit_box(s, s->model_count - 1);
  return get_model_rest(r, &record, s, &s->models[s->model_count - 1]);
}

static pags_result get_tracks(section_reader *r, pags_track_poses *tracks) {
  const uint8_t *at = NULL;
  PAGS_TRY(next_sized(r, "TRAK", (uint64_t)keyframes_of(tracks) * sizeof(keyframe_record), &at));
  for (int64_t i = 0; i < tracks->count; i++)
    for (int64_t k = 0; k < tracks->objects[i].keyframe_count; k++, at += sizeof(keyframe_record)) {
      keyframe_record record;
      memcpy(&record, at, sizeof record);
      for (int j = 0; j < 6; j++)
        if (!isfinite(record.increment[j]) || record.moments.count < 0)
          return out_of_range(r, "TRAK");
      pags_copy3(record.increment, tracks->objects[i].keyframes[k].rotation);
      pags_copy3(record.increment + 3, tracks->objects[i].keyframes[k].translation);
      tracks->moments[i][k] = record.moments;
    }
  return PAGS_OK;
}

static pags_result get_sky(section_reader *r, const run_record *run, pags_sky_fit *fit) {
  const uint8_t *payload = NULL;
  size_t bytes = sky_bytes(run->sky_size);
  PAGS_TRY(next_sized(r, "SKY0", 3 * (uint64_t)bytes + bytes / 6, &payload));
  if (run->sky_size == 0)
    return PAGS_OK;
  PAGS_TRY(pags_sky_fit_prepare(fit, (int)run->sky_size));
  memcpy(fit->sky.texels, payload, bytes);
  memcpy(fit->first, payload + bytes, bytes);
  memcpy(fit->second, payload + 2 * bytes, bytes);
  memcpy(fit->visits, payload + 3 * bytes, bytes / 6);
  return PAGS_OK;
}

static pags_result get_exposures(section_reader *r, const run_record *run, const pags_dataset *dataset,
                                 pags_exposures *exposures) {
  const uint8_t *payload = NULL;
  if (run->exposures > 0)
    PAGS_TRY(pags_exposures_create(exposures, dataset));
  PAGS_TRY(next_sized(r, "EXPO", exposure_bytes(exposures), &payload));
  if (run->exposures > 0)
    memcpy(exposures->items, payload, exposure_bytes(exposures));
  return PAGS_OK;
}

/* Finds a section about a holdout test (holdout_test.h); *fitted: `size` bytes of values follow the record. */
static pags_result next_holdout_test(section_reader *r, const char *tag, const pags_dataset *dataset,
                                     const uint8_t **values, uint64_t *size, holdout_record *record, bool *fitted) {
  PAGS_TRY(next(r, tag, values, size));
  if (*size < sizeof *record)
    return out_of_range(r, tag);
  memcpy(record, *values, sizeof *record);
  *values += sizeof *record;
  *size -= sizeof *record;
  *fitted = record->holdout.state == PAGS_HOLDOUT_RUNNING || record->holdout.state == PAGS_HOLDOUT_PASSED;
  return dataset && (*fitted || record->holdout.state == PAGS_HOLDOUT_FAILED) ? PAGS_OK : out_of_range(r, tag);
}

static pags_result get_cameras(section_reader *r, const pags_dataset *dataset, pags_camera_poses *p) {
  const uint8_t *values = NULL;
  uint64_t size = 0;
  holdout_record record;
  bool fitted = false;
  PAGS_TRY(next_holdout_test(r, "CAMS", dataset, &values, &size, &record, &fitted));
  if (fitted)
    PAGS_TRY(pags_camera_poses_create(p, dataset));
  const int64_t items = pags_camera_poses_items(p);
  if (record.items != items || size != (size_t)items * sizeof *p->items)
    return out_of_range(r, "CAMS");
  if (fitted)
    memcpy(p->items, values, (size_t)size);
  for (int64_t i = 0; i < items; i++)
    for (int k = 0; k < 6; k++)
      if (!isfinite(p->items[i].value[k]) || p->items[i].moments.count < 0)
        return out_of_range(r, "CAMS");
  p->holdout = record.holdout;
  return PAGS_OK;
}

static pags_result get_photometry(section_reader *r, const pags_dataset *dataset, pags_photometry *p) {
  const uint8_t *values = NULL;
  uint64_t size = 0;
  holdout_record record;
  bool fitted = false;
  PAGS_TRY(next_holdout_test(r, "LITE", dataset, &values, &size, &record, &fitted));
  if (fitted)
    PAGS_TRY(pags_photometry_create(p, dataset));
  if (record.items != p->count || size != (size_t)p->count * sizeof *p->parts)
    return out_of_range(r, "LITE");
  if (fitted)
    memcpy(p->parts, values, (size_t)size);
  for (int64_t s = 0; s < p->count; s++) {
    const pags_photometric light = pags_photometry_of_sensor(p, (int)s);
    if (!pags_photometric_is_valid(&light) || p->parts[s].by_vignette.count < 0 || p->parts[s].by_slopes.count < 0)
      return out_of_range(r, "LITE");
  }
  p->holdout = record.holdout;
  return PAGS_OK;
}

static pags_result get_test(section_reader *r, pags_train_state *s) {
  test_record record;
  PAGS_TRY(get_record(r, "TEST", &record, sizeof record));
  const int64_t state = record.exposures.state;
  const bool kept = state == PAGS_HOLDOUT_RUNNING || state == PAGS_HOLDOUT_PASSED;
  if (kept != (s->exposures.count > 0) || (!kept && state != PAGS_HOLDOUT_FAILED) ||
      !(record.costs.uncovered >= 0.0 && record.costs.uncovered <= 1.0))
    return out_of_range(r, "TEST");
  s->exposures.holdout = record.exposures;
  s->costs = record.costs;
  return PAGS_OK;
}

static pags_result get_nonfinite(section_reader *r, pags_train_state *s) {
  pags_left_out record;
  PAGS_TRY(get_record(r, "BADR", &record, sizeof record));
  const pags_nonfinite_row *o = &record.first;
  if (record.count <= 0 || o->step < 0 || o->step > s->step || o->object < -1 || o->object >= s->tracks.count ||
      o->row < 0 || o->plane < 0 || o->plane >= PAGS_MAX_PLANES + PAGS_MAX_FOURIER || o->kind < 0 ||
      o->kind > PAGS_NONFINITE_CAMERA)
    return out_of_range(r, "BADR");
  s->nonfinite.count = record.count;
  s->nonfinite.first = record.first;
  return PAGS_OK;
}

static pags_result get_kernels(section_reader *r, pags_kernel_names *names) {
  PAGS_TRY(get_record(r, "KERN", names, sizeof *names));
  for (int k = 0; k < 2; k++) {
    int length = 0;
    while (length < PAGS_KERNEL_NAME - 1 && isalnum((unsigned char)names->of[k][length]))
      length++;
    for (int i = length; i < PAGS_KERNEL_NAME; i++)
      if (names->of[k][i])
        return out_of_range(r, "KERN");
  }
  return PAGS_OK;
}

static pags_result skip_magic(section_reader *r) {
  if (r->end - r->at < (ptrdiff_t)sizeof magic || memcmp(r->at, magic, sizeof magic) != 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: not a checkpoint of this version: expected it to begin with PAGSRUN4",
                     r->path);
  r->at += sizeof magic;
  return PAGS_OK;
}

static bool follows(const section_reader *r, const char tag[4]) {
  return r->end - r->at >= 4 && memcmp(r->at, tag, 4) == 0;
}

static pags_result read_state(section_reader *r, const pags_dataset *dataset, pags_train_state *s,
                              uint64_t *fingerprint) {
  pags_train_config config = pags_train_config_default();
  const uint8_t *payload = NULL;
  uint64_t size = 0;
  run_record record;
  PAGS_TRY(skip_magic(r));
  PAGS_TRY(next(r, "CONF", &payload, &size));
  PAGS_TRY(pags_config_read(&config, (const char *)payload, (size_t)size, r->path));
  PAGS_TRY(pags_train_config_check(&config));
  PAGS_TRY(get_record(r, "RUN0", &record, sizeof record));
  if (dataset && pags_dataset_fps(dataset) > 0.0)
    PAGS_TRY(pags_track_poses_create(&s->tracks, dataset));
  if (!is_sound_run(&record, dataset, &s->tracks))
    return out_of_range(r, "RUN0");
  const pags_track_poses tracks = s->tracks;
  const pags_schedule schedule = pags_schedule_make(&config, record.extent, record.views);
  const pags_result result = pags_state_create(s, &schedule, record.stop, record.models);
  s->tracks = tracks;
  PAGS_TRY(result);
  s->step = record.step;
  s->resets = record.resets;
  s->cap = record.cap;
  s->clocked = record.clocked;
  s->loss = record.loss;
  s->mse = record.mse;
  s->sky_share = record.sky_share;
  s->lidar_points = record.lidar_points;
  *fingerprint = record.fingerprint;
  for (int64_t i = 0; i < record.models; i++)
    PAGS_TRY(get_model(r, s));
  PAGS_TRY(get_tracks(r, &s->tracks));
  PAGS_TRY(get_sky(r, &record, &s->sky));
  PAGS_TRY(get_exposures(r, &record, dataset, &s->exposures));
  if (follows(r, "CAMS"))
    PAGS_TRY(get_cameras(r, dataset, &s->cameras));
  if (follows(r, "LITE"))
    PAGS_TRY(get_photometry(r, dataset, &s->photometry));
  if (follows(r, "TEST"))
    PAGS_TRY(get_test(r, s));
  if (follows(r, "BADR"))
    PAGS_TRY(get_nonfinite(r, s));
  if (follows(r, "KERN"))
    PAGS_TRY(get_kernels(r, &s->kernels));
  return next_sized(r, "END!", 0, &payload);
}

pags_result pags_checkpoint_load(const char *path, const pags_dataset *dataset, pags_train_state *state,
                                 uint64_t *fingerprint) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  *state = (pags_train_state){0};
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  const pags_result result = read_state(&(section_reader){path, bytes, bytes + size}, dataset, state, fingerprint);
  if (result != PAGS_OK)
    pags_state_destroy(state);
  return result;
}

/* ---- Inspecting ---- */

pags_result pags_checkpoint_inspect(const char *path, pags_checkpoint_facts *out) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t length;
  *out = (pags_checkpoint_facts){0};
  PAGS_TRY(pags_file_read(path, &bytes, &length));
  section_reader reader = {path, bytes, bytes + length}, *const r = &reader;
  const uint8_t *payload = NULL;
  uint64_t size = 0;
  char tag[4] = "";
  PAGS_TRY(skip_magic(r));
  while (memcmp(tag, "END!", 4) != 0) {
    run_record run;
    model_record model;

    /* Move past the next section, whatever its tag; `tag` receives the tag. */
    if (r->end - r->at < 16)
      return pags_fail(PAGS_ERROR_FORMAT, "%s: expected a section at its end, found %lld bytes", r->path,
                       (long long)(r->end - r->at));
    memcpy(tag, r->at, 4);
    PAGS_TRY(next(r, tag, &payload, &size));

    if (memcmp(tag, "RUN0", 4) == 0 && size == sizeof run) {
      memcpy(&run, payload, sizeof run);
      out->step = run.step;
      out->stop = run.stop;
      out->views = run.views;
      out->models = run.models;
      out->loss = run.loss;
    }
    if (memcmp(tag, "MODL", 4) == 0 && size == sizeof model) {
      memcpy(&model, payload, sizeof model);
      if (model.count < 0 || model.count > INT32_MAX || model.sh_degree < 0 || model.sh_degree > 3)
        return out_of_range(r, "MODL");
      out->gaussians += model.count;
      out->sh_degree = (int)model.sh_degree;
    }
  }
  return PAGS_OK;
}
