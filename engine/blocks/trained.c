/* SPDX-License-Identifier: Apache-2.0 */
/* Reads what the blocks of a split were trained to, and refuses what can't be merged (cells.h). */
#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"
#include "blocks/cells.h"
#include "dataset/block.h"
#include "scene/scene_json.h"

void pags_trained_destroy(pags_trained *trained) {
  for (int b = 0; b < trained->count; b++) {
    free(trained->folders[b]);
    pags_scene_destroy(&trained->heads[b]);
  }
  free(trained->folders);
  free(trained->heads);
  *trained = (pags_trained){0};
}

/* ---- One scene ---- */

/* Checks that the block of a scene is block b of this split. */
static pags_result check_block(const pags_blocks *split, int b, const char *folder, const pags_scene *head) {
  if (!head->block)
    return pags_fail_at(folder, "trained on %s, not on a block; expected block %d of %s, trained by itself",
                        head->dataset ? head->dataset : "an unknown data set", b, split->recording);
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  const char *id = "";
  int64_t number = -1;
  PAGS_TRY(pags_json_parse_text(folder, head->block, strlen(head->block), &json));
  PAGS_TRY(pags_json_string(json, pags_json_root(json), "split", &id));
  PAGS_TRY(pags_json_integer(json, pags_json_root(json), "number", 0, INT32_MAX, &number));
  if (strcmp(id, split->id) != 0)
    return pags_fail_at(folder,
                        "trained on a block of another split (%.16s, here it is %s); train this split's block %d", id,
                        split->id, b);
  if (number != b)
    return pags_fail_at(folder, "the scene of block %lld; expected that of block %d", (long long)number, b);
  return PAGS_OK;
}

static pags_result parse_config(const char *folder, const pags_scene *head, pags_json **json) {
  if (!head->config)
    return pags_fail_at(folder, "its scene.json has no training configuration ('config')");
  return pags_json_parse_text(folder, head->config, strlen(head->config), json);
}

/* ---- Comparison of scenes ---- */

/* Compares the configurations of two blocks' trainings. half_until is what each run has decided by its own number of
 * Gaussians. */
static pags_result compare_configs(const char *const folders[2], const pags_json *const configs[2]) {
  for (const pags_json_value *v = pags_json_root(configs[0])->first; v; v = v->next) {
    const pags_json_value *other = pags_json_member(pags_json_root(configs[1]), v->key);
    const int length = (int)(v->source_end - v->source_begin);
    const int other_length = other ? (int)(other->source_end - other->source_begin) : 0;
    if (strcmp(v->key, "half_until") == 0 ||
        (length == other_length && memcmp(v->source_begin, other->source_begin, (size_t)length) == 0))
      continue;
    return pags_fail_at(folders[1], "trained with %s %.*s, but %s with %.*s; train all blocks with the same options",
                        v->key, other ? other_length : 4, other ? other->source_begin : "none", folders[0], length,
                        v->source_begin);
  }
  return PAGS_OK;
}

static pags_result compare_sizes(const char *const folders[2], const pags_scene *first, const pags_scene *head) {
  for (int64_t i = 0; i < head->view_count; i++) {
    const pags_camera *mine = &head->views[i].camera;
    const pags_scene_view *other = first->views, *const end = first->views + first->view_count;
    while (other < end && other->sensor != head->views[i].sensor)
      other++;
    if (other < end && (mine->width != other->camera.width || mine->height != other->camera.height))
      return pags_fail(
          PAGS_ERROR_FORMAT,
          "%s: camera %d has %d x %d pixels, but %d x %d in %s; train all blocks with the same --downscale", folders[1],
          head->views[i].sensor, mine->width, mine->height, other->camera.width, other->camera.height, folders[0]);
  }
  return PAGS_OK;
}

/* Checks that a block was trained to the end, in the same way as the first. */
static pags_result compare_with_first(const pags_trained *trained, int b) {
  const char *const folders[2] = {trained->folders[0], trained->folders[b]};
  const pags_scene *const head = &trained->heads[b];
  PAGS_AUTO(pags_json_destroy_auto) pags_json *first = NULL, *config = NULL;
  int64_t iterations;
  PAGS_TRY(parse_config(folders[0], &trained->heads[0], &first));
  PAGS_TRY(parse_config(folders[1], head, &config));
  PAGS_TRY(pags_json_integer(config, pags_json_root(config), "iterations", 1, INT64_MAX, &iterations));
  if (head->iterations < iterations)
    return pags_fail_at(folders[1], "stopped after step %lld of %lld; go on with the same command and --resume",
                        (long long)head->iterations, (long long)iterations);
  PAGS_TRY(compare_configs(folders, (const pags_json *const[]){first, config}));
  return compare_sizes(folders, &trained->heads[0], head);
}

/* ---- All scenes ---- */

/* Reports missing and untrained blocks, before anything is read. */
static pags_result check_present(const pags_blocks *split, const char *folder, const pags_trained *trained) {
  int lacking = 0, first = -1;
  for (int b = 0; b < split->count; b++) {
    PAGS_AUTOFREE char *block = pags_text_format("%s/%03d", folder, b);
    PAGS_CHECK_MEMORY(block, "%s", folder);
    if (!pags_folder_has(block, PAGS_BLOCK_FILE))
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s/%03d: block %d of %d is missing; give the command of pags split again, which puts it back",
                       folder, b, b, split->count);
    const bool trained_here = pags_folder_has(trained->folders[b], "scene.json");
    first = trained_here || lacking++ ? first : b;
  }
  if (lacking == 0)
    return PAGS_OK;
  return pags_fail(
      PAGS_ERROR_FORMAT,
      "%s: %d of %d blocks aren't trained, the first is %03d; expected a scene in %s (pags train %s/%03d -o %s)",
      folder, lacking, split->count, first, trained->folders[first], folder, first, trained->folders[first]);
}

pags_result pags_trained_load(const pags_blocks *split, const char *folder, pags_trained *trained) {
  const size_t count = (size_t)split->count;
  *trained = (pags_trained){.folders = calloc(count, sizeof *trained->folders),
                            .heads = calloc(count, sizeof *trained->heads)};
  PAGS_CHECK_MEMORY(trained->folders && trained->heads, "%d blocks", split->count);
  trained->count = split->count;
  for (int b = 0; b < split->count; b++) {
    trained->folders[b] = pags_text_format("%s/%03d/scene", folder, b);
    PAGS_CHECK_MEMORY(trained->folders[b], "%d blocks", split->count);
  }
  PAGS_TRY(check_present(split, folder, trained));
  for (int b = 0; b < split->count; b++) {
    PAGS_AUTOFREE char *path = pags_path_join(trained->folders[b], "scene.json");
    PAGS_AUTO(pags_scene_files_destroy) pags_scene_files files = {0};
    PAGS_CHECK_MEMORY(path, "%s", trained->folders[b]);
    PAGS_TRY(pags_scene_json_read(path, &trained->heads[b], &files));
    PAGS_TRY(check_block(split, b, trained->folders[b], &trained->heads[b]));
    PAGS_TRY(compare_with_first(trained, b));
  }
  return PAGS_OK;
}
