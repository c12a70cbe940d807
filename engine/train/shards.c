/* SPDX-License-Identifier: Apache-2.0 */
/* Writes and reads checkpoints in shards (shards.h). */
#include "train/shards.h"

#include <assert.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"
#include "port/port.h"

enum { VERSION = 1 };

/* ---- Names ---- */

static char *shard_path(const char *path, int64_t generation, int rank) {
  return pags_text_format("%s.g%lld.%d", path, (long long)generation, rank);
}

/* The generation of a file's name if it is one of the shards of the checkpoint called `name`, else 0. `part`: of one
 * that was never finished. */
static int64_t generation_of(const char *file, const char *name, bool *part) {
  const size_t length = strlen(name);
  if (strncmp(file, name, length) != 0 || file[length] != '.' || file[length + 1] != 'g')
    return 0;
  char *end;
  const long long generation = strtoll(file + length + 2, &end, 10);
  const size_t digits = *end == '.' ? strspn(end + 1, "0123456789") : 0;
  *part = digits > 0 && !strcmp(end + 1 + digits, ".part");
  return *part || (digits > 0 && end[1 + digits] == '\0') ? generation : 0;
}

/* Finds the newest generation of which a shard lies next to `path` and removes those of others than `keep`; keep < 0:
 * all stay. A shard that can't be removed stays. */
static pags_result look_through(const char *path, int64_t keep, int64_t *newest) {
  *newest = 0;
  PAGS_AUTOFREE char *folder = pags_path_folder(path);
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_CHECK_MEMORY(folder, NULL);
  PAGS_TRY(pags_dir_list_read(folder, &list));
  for (int64_t i = 0; i < list.count; i++) {
    bool part;
    const int64_t generation = generation_of(list.names[i], pags_path_name(path), &part);
    *newest = generation > *newest && !part ? generation : *newest;
    if (keep < 0 || generation <= 0 || generation == keep)
      continue;
    PAGS_AUTOFREE char *file = pags_path_join(folder, list.names[i]);
    if (file)
      pags_port_remove_file(file);
  }
  return PAGS_OK;
}

/* ---- Writing ---- */

/* What rank 0 hears of each shard: its bytes, then its rows of each model. */
static pags_result write_manifest(const char *path, int64_t generation, const pags_train_state *state, int ranks,
                                  const int64_t *facts) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {.indent = 1};
  pags_json_begin_object(&writer, NULL);
  pags_json_put_string(&writer, "format", "pags-checkpoint-shards");
  pags_json_put_integer(&writer, "version", VERSION);
  pags_json_put_integer(&writer, "step", state->step);
  pags_json_put_integer(&writer, "models", state->model_count);
  pags_json_begin_array(&writer, "shards");
  for (int rank = 0; rank < ranks; rank++, facts += 1 + state->model_count) {
    PAGS_AUTOFREE char *file = shard_path(pags_path_name(path), generation, rank);
    PAGS_CHECK_MEMORY(file, NULL);
    pags_json_begin_object(&writer, NULL);
    pags_json_put_string(&writer, "file", file);
    pags_json_put_integer(&writer, "bytes", facts[0]);
    pags_json_begin_array(&writer, "rows");
    for (int64_t m = 0; m < state->model_count; m++)
      pags_json_put_integer(&writer, NULL, facts[1 + m]);
    pags_json_end_array(&writer);
    pags_json_end_object(&writer);
  }
  pags_json_end_array(&writer);
  pags_json_end_object(&writer);
  return pags_json_writer_save(&writer, path);
}

/* Collective, once all shards are on disk. */
static pags_result name_shards(const char *path, const char *own, int64_t generation, pags_transport *transport,
                               const pags_train_state *state) {
  const int ranks = pags_transport_ranks(transport);
  const int64_t count = 1 + state->model_count, bytes = count * (int64_t)sizeof(int64_t);
  const bool leads = pags_transport_rank(transport) == 0;
  PAGS_AUTOFREE int64_t *facts = calloc((size_t)(count + (leads ? (count + 1) * ranks : 0)), sizeof *facts);
  uint64_t size = 0;
  PAGS_TRY(
      pags_transport_agree(transport, facts ? pags_file_size(own, &size) : pags_out_of_memory("%d shards", ranks)));
  int64_t *const all = facts + count, *const sizes = all + count * ranks; /* at rank 0 */
  for (int rank = 0; leads && rank < ranks; rank++)
    sizes[rank] = bytes;
  facts[0] = (int64_t)size;
  for (int64_t m = 0; m < state->model_count; m++)
    facts[1 + m] = state->models[m].gaussians.count;
  PAGS_TRY(pags_transport_gather(transport, 0, facts, bytes, all, sizes));
  return pags_transport_agree(transport, leads ? write_manifest(path, generation, state, ranks, all) : PAGS_OK);
}

pags_result pags_shards_save(const char *path, pags_transport *transport, const pags_train_state *state,
                             uint64_t fingerprint) {
  int64_t generation = 0, newest;
  if (pags_transport_ranks(transport) == 1)
    return pags_shards_save_whole(path, transport, state, fingerprint);
  const bool leads = pags_transport_rank(transport) == 0;
  PAGS_TRY(pags_transport_agree(transport, leads ? look_through(path, -1, &generation) : PAGS_OK));
  generation++;
  PAGS_TRY(pags_transport_broadcast(transport, 0, &generation, sizeof generation));
  PAGS_AUTOFREE char *own = shard_path(path, generation, pags_transport_rank(transport));
  PAGS_TRY(pags_transport_agree(transport, own ? PAGS_OK : pags_out_of_memory(NULL)));
  pags_result result = pags_checkpoint_save(own, transport, false, state, fingerprint);
  if (result == PAGS_OK)
    result = name_shards(path, own, generation, transport, state);
  if (result != PAGS_OK)
    pags_port_remove_file(own);
  else if (leads)
    look_through(path, generation, &newest); /* what stays of earlier generations takes room, and no more */
  return result;
}

pags_result pags_shards_save_whole(const char *path, pags_transport *transport, const pags_train_state *state,
                                   uint64_t fingerprint) {
  int64_t newest;
  PAGS_TRY(pags_checkpoint_save(path, transport, pags_transport_ranks(transport) > 1, state, fingerprint));
  return pags_transport_agree(transport,
                              pags_transport_rank(transport) == 0 ? look_through(path, 0, &newest) : PAGS_OK);
}

/* ---- Reading ---- */

typedef struct shard {
  char *path;
  int64_t bytes;
  int64_t *rows, *first; /* [models] its rows, and those of the shards before it */
  pags_train_state state;
  bool loaded;
} shard;

typedef struct manifest {
  int64_t step, models, count;
  shard *shards;
  int64_t *rows;  /* [models] of all shards */
  int64_t *begin; /* [models * (ranks + 1)] as pags_shards_cut_fn fills it */
} manifest;

static void destroy_manifest(manifest *m) {
  for (int64_t i = 0; m->shards && i < m->count; i++) {
    if (m->shards[i].loaded)
      pags_state_destroy(&m->shards[i].state);
    free(m->shards[i].path);
    free(m->shards[i].rows);
  }
  free(m->shards);
  free(m->rows);
  free(m->begin);
}

static pags_result read_shard(const pags_json *json, const pags_json_value *value, const char *folder, int64_t models,
                              shard *out) {
  const char *file;
  const pags_json_value *rows;
  PAGS_TRY(pags_json_string(json, value, "file", &file));
  if (!pags_path_is_inside(file))
    return pags_json_fail(json, value, "'file' is '%s', outside of the folder", file);
  PAGS_TRY(pags_json_integer(json, value, "bytes", 1, INT64_MAX, &out->bytes));
  PAGS_TRY(pags_json_array(json, value, "rows", &rows));
  if (rows->count != models)
    return pags_json_fail(json, rows, "'rows' has %lld numbers, expected %lld, one a model", (long long)rows->count,
                          (long long)models);
  out->path = pags_path_join(folder, file);
  out->rows = calloc(2 * (size_t)models, sizeof *out->rows);
  PAGS_CHECK_MEMORY(out->path && out->rows, NULL);
  int64_t m = 0;
  for (const pags_json_value *row = rows->first; row; row = row->next, m++) {
    double number;
    PAGS_TRY(pags_json_as_number(json, row, "rows", &number));
    if (!(number >= 0 && number < INT32_MAX) || number != (double)(int64_t)number)
      return pags_json_fail(json, row, "'rows': expected a count, got %s", row->text);
    out->rows[m] = (int64_t)number;
  }
  return PAGS_OK;
}

static pags_result read_manifest(const pags_json *json, const char *folder, manifest *out) {
  const pags_json_value *root = pags_json_root(json), *shards;
  const char *format;
  int64_t version;
  PAGS_TRY(pags_json_string(json, root, "format", &format));
  PAGS_TRY(pags_json_integer(json, root, "version", 1, INT32_MAX, &version));
  if (strcmp(format, "pags-checkpoint-shards") != 0 || version != VERSION)
    return pags_json_fail(json, root, "expected 'format' pags-checkpoint-shards, 'version' %d", VERSION);
  PAGS_TRY(pags_json_integer(json, root, "step", 0, INT64_MAX, &out->step));
  PAGS_TRY(pags_json_integer(json, root, "models", 1, INT32_MAX, &out->models));
  PAGS_TRY(pags_json_array(json, root, "shards", &shards));
  if (shards->count < 1 || shards->count > PAGS_RANKS_MOST)
    return pags_json_fail(json, shards, "expected 1 to %d shards, got %lld", PAGS_RANKS_MOST, (long long)shards->count);
  out->shards = calloc((size_t)shards->count, sizeof *out->shards);
  PAGS_CHECK_MEMORY(out->shards, "%lld shards", (long long)shards->count);
  out->count = shards->count;
  shard *at = out->shards;
  for (const pags_json_value *value = shards->first; value; value = value->next)
    PAGS_TRY(read_shard(json, value, folder, out->models, at++));
  return PAGS_OK;
}

static pags_result load_shard(const manifest *m, shard *s, const pags_dataset *dataset, uint64_t *fingerprint) {
  uint64_t size, other;
  PAGS_TRY(pags_file_size(s->path, &size));
  if (size != (uint64_t)s->bytes)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: has %llu bytes, expected %lld as the manifest says", s->path,
                     (unsigned long long)size, (long long)s->bytes);
  PAGS_TRY(pags_checkpoint_load(s->path, dataset, &s->state, &other));
  s->loaded = true;
  bool same = s->state.step == m->step && s->state.model_count == m->models;
  for (int64_t i = 0; same && i < m->models; i++)
    same = s->state.models[i].gaussians.count == s->rows[i];
  if (!same || (s != m->shards && other != *fingerprint))
    return pags_fail(PAGS_ERROR_FORMAT,
                     "%s: belongs to another checkpoint: expected step %lld and the rows that the "
                     "manifest says",
                     s->path, (long long)m->step);
  *fingerprint = other;
  return PAGS_OK;
}

/* Copies what lies in both: a shard's rows of a model, and this rank's [begin, end) of them. */
static pags_result take_rows(const shard *s, int64_t model, int64_t begin, int64_t end, pags_train_model *to) {
  pags_train_model *from = &s->state.models[model];
  const int64_t offset = s->first[model], size = from->adam.cluster_size;
  const int64_t last = offset + s->rows[model] < end ? offset + s->rows[model] : end;
  const int64_t first = offset > begin ? offset : begin;
  if (first >= last)
    return PAGS_OK;
  if (offset % size != 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: begins at row %lld, which is no multiple of the cluster size %lld",
                     s->path, (long long)offset, (long long)size);
  assert(begin % size == 0);
  pags_model_copy_rows(from, first - offset, last - first, to, first - begin);
  for (int64_t row = first; row < last; row += size) {
    const int64_t source = (row - offset) / size, target = (row - begin) / size;
    to->adam.moment_step[target] = from->adam.moment_step[source];
    to->adam.param_step[target] = from->adam.param_step[source];
  }
  return PAGS_OK;
}

/* Whether a shard has some of the rows rows[0] .. rows[1] - 1 of a model. */
static bool has_some(const shard *s, int64_t model, const int64_t *rows) {
  return s->first[model] < rows[1] && s->first[model] + s->rows[model] > rows[0];
}

/* Adds the model with this rank's rows, rows[0] .. rows[1] - 1, to the state. */
static pags_result join_model(const manifest *m, int64_t model, const int64_t *rows, pags_train_state *state) {
  const pags_train_model *like = &m->shards[0].state.models[model];
  for (const shard *s = m->shards; s < m->shards + m->count; s++)
    if (s->loaded && has_some(s, model, rows))
      like = &s->state.models[model]; /* one without rows may not know which columns there are */
  pags_gaussians g;
  PAGS_TRY(pags_gaussians_create_like(&g, rows[1] - rows[0], &like->gaussians));
  PAGS_TRY(pags_state_add_model(state, like->object, like->schedule.extent, &g));
  pags_train_model *to = &state->models[model];
  if (like->gaussians.fourier)
    PAGS_TRY(pags_model_add_fourier(to, like->gaussians.fourier_degree));
  to->fourier_gain = like->fourier_gain;
  pags_state_fit_box(state, model);
  for (const shard *s = m->shards; s < m->shards + m->count; s++)
    if (s->loaded)
      PAGS_TRY(take_rows(s, model, rows[0], rows[1], to));
  pags_adam_bound_all(&to->adam, &to->gaussians, &to->clusters, NULL);
  return PAGS_OK;
}

/* Takes all but the models from the first shard, whose state keeps these alone. */
static pags_result take_shared(pags_train_state *from, pags_train_state *to) {
  pags_train_state shared = *from;
  PAGS_TRY(pags_state_create(to, &shared.schedule, shared.stop, shared.model_count));
  shared.models = to->models;
  shared.model_count = 0;
  *to = shared;
  from->tracks = (pags_track_poses){0};
  from->sky = (pags_sky_fit){0};
  from->exposures = (pags_exposures){0};
  from->cameras = (pags_camera_poses){0};
  from->photometry = (pags_photometry){0};
  return PAGS_OK;
}

static pags_result join_all(manifest *m, int rank, int ranks, pags_shards_cut_fn *cut, const pags_dataset *dataset,
                            pags_train_state *state, uint64_t *fingerprint) {
  m->rows = calloc((size_t)m->models, sizeof *m->rows);
  m->begin = calloc((size_t)(m->models * (ranks + 1)), sizeof *m->begin);
  PAGS_CHECK_MEMORY(m->rows && m->begin, "%lld models", (long long)m->models);
  for (shard *s = m->shards; s < m->shards + m->count; s++) {
    s->first = s->rows + m->models;
    for (int64_t k = 0; k < m->models; k++) {
      s->first[k] = m->rows[k];
      m->rows[k] += s->rows[k];
    }
  }
  cut(m->rows, m->models, m->shards[0].state.schedule.config.picture.cluster_size, ranks, m->begin);

  /* Load the shards in which this rank has rows. */
  for (int64_t k = 0; k < m->models; k++)
    for (shard *s = m->shards; s < m->shards + m->count; s++)
      if (!s->loaded && has_some(s, k, m->begin + k * (ranks + 1) + rank))
        PAGS_TRY(load_shard(m, s, dataset, fingerprint));

  PAGS_TRY(take_shared(&m->shards[0].state, state));
  for (int64_t k = 0; k < m->models; k++)
    PAGS_TRY(join_model(m, k, m->begin + k * (ranks + 1) + rank, state));
  return PAGS_OK;
}

/* Rank 0 reads the file at `path`, so that all have the same manifest; *text is freed by the caller. */
static pags_result read_for_all(const char *path, pags_transport *transport, uint8_t **text, size_t *size) {
  static const char sole[] = "PAGSRUN"; /* a checkpoint of one rank: each reads it for itself */
  enum { SOLE = sizeof sole - 1 };
  int64_t bytes = 0;
  char head[SOLE];
  pags_result mine = PAGS_OK;
  if (pags_transport_rank(transport) == 0 &&
      !(pags_file_head(path, head, SOLE) == SOLE && memcmp(head, sole, SOLE) == 0)) {
    mine = pags_file_read(path, text, size);
    bytes = mine == PAGS_OK ? (int64_t)*size : 0;
  }
  PAGS_TRY(pags_transport_agree(transport, mine));
  PAGS_TRY(pags_transport_broadcast(transport, 0, &bytes, sizeof bytes));
  *size = (size_t)bytes;
  if (!*text && bytes > 0)
    *text = malloc((size_t)bytes);
  PAGS_TRY(pags_transport_agree(transport, bytes > 0 && !*text ? pags_out_of_memory("%s", path) : PAGS_OK));
  return pags_transport_broadcast(transport, 0, *text, bytes);
}

/* A manifest of one shard, the file itself, which is read at once. */
static pags_result read_sole(const char *path, const pags_dataset *dataset, manifest *out, uint64_t *fingerprint) {
  shard *s = out->shards = calloc(1, sizeof *out->shards);
  PAGS_CHECK_MEMORY(s, NULL);
  out->count = 1;
  PAGS_TRY(pags_checkpoint_load(path, dataset, &s->state, fingerprint));
  s->loaded = true;
  out->models = s->state.model_count;
  s->path = pags_text_copy(path);
  s->rows = calloc(2 * (size_t)out->models, sizeof *s->rows);
  PAGS_CHECK_MEMORY(s->path && s->rows, NULL);
  for (int64_t i = 0; i < out->models; i++)
    s->rows[i] = s->state.models[i].gaussians.count;
  return PAGS_OK;
}

/* Reads the manifest and the first shard, which every rank needs. */
static pags_result read_first(const char *path, const uint8_t *text, size_t size, const pags_dataset *dataset,
                              manifest *out, uint64_t *fingerprint) {
  if (!text)
    return read_sole(path, dataset, out, fingerprint);
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_AUTOFREE char *folder = pags_path_folder(path);
  PAGS_TRY(pags_json_parse_text(path, (const char *)text, size, &json));
  PAGS_CHECK_MEMORY(folder, NULL);
  PAGS_TRY(read_manifest(json, folder, out));
  return load_shard(out, &out->shards[0], dataset, fingerprint);
}

pags_result pags_shards_load(const char *path, pags_transport *transport, pags_shards_cut_fn *cut,
                             const pags_dataset *dataset, pags_train_state *state, uint64_t *fingerprint) {
  const int rank = pags_transport_rank(transport), ranks = pags_transport_ranks(transport);
  PAGS_AUTO(destroy_manifest) manifest m = {0};
  PAGS_AUTOFREE uint8_t *text = NULL;
  size_t size;
  *state = (pags_train_state){0};
  PAGS_TRY(read_for_all(path, transport, &text, &size));
  if (!text && ranks == 1)
    return pags_checkpoint_load(path, dataset, state, fingerprint);
  pags_result result = read_first(path, text, size, dataset, &m, fingerprint);
  if (result == PAGS_OK)
    result = join_all(&m, rank, ranks, cut, dataset, state, fingerprint);
  result = pags_transport_agree(transport, result);
  if (result != PAGS_OK)
    pags_state_destroy(state);
  return result;
}
