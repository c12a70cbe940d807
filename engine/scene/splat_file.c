/* SPDX-License-Identifier: Apache-2.0 */
/* Loads a splat file of any format. The format is recognised by the first bytes of the file, for .splat, which has no
 * signature, by the extension. */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <pags/packed.h>
#include <pags/scene.h>

#include "base/file.h"
#include "base/json.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/zip.h"
#include "scene/axes.h"
#include "scene/other_formats.h"
#include "scene/splat_formats.h"

/* ---- Other files with the names of splat files, or found next to them ---- */

/* Whether the first bytes are text: no control characters but blanks. */
static bool is_text(const uint8_t *bytes, size_t size) {
  enum { LOOKED_AT = 256 };
  for (size_t i = 0; i < size && i < LOOKED_AT; i++)
    if ((bytes[i] < ' ' && !strchr("\t\r\n\f", bytes[i])) || !bytes[i])
      return false;
  return true;
}

static pags_result refuse(const char *path, const uint8_t *bytes, size_t size) {
  const size_t blanks = strspn((const char *)bytes, " \t\r\n");
  if (size > blanks && (bytes[blanks] == '{' || bytes[blanks] == '['))
    return pags_fail(
        PAGS_ERROR_FORMAT,
        "%s: a JSON file of another program: expected a splat file, the meta.json of a SOG, a glTF, or the "
        "scene.json of a scene folder",
        path);
  if (size > blanks && bytes[blanks] == '<')
    return pags_fail(PAGS_ERROR_FORMAT, "%s: a web page or other XML: expected a splat file", path);
  if (blanks == size)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: empty: expected a splat file", path);
  char found[32] = "text";
  if (!is_text(bytes, size))
    snprintf(found, sizeof found, "bytes %02x %02x %02x %02x", bytes[0], size > 1 ? bytes[1] : 0,
             size > 2 ? bytes[2] : 0, size > 3 ? bytes[3] : 0);
  return pags_fail(
      PAGS_ERROR_FORMAT,
      "%s: expected a splat file (PLY, SPZ, SOG, glTF with Gaussians, packed or one named .splat), found %s", path,
      found);
}

/* ---- Loading ---- */

/* Reads a JSON file: a SOG's meta.json, or a .gltf. */
static pags_result decode_json(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                               pags_splat_facts *facts) {
  pags_json *json;
  PAGS_TRY(pags_json_parse_text(path, (const char *)bytes, size, &json));
  const pags_json_value *root = pags_json_root(json);
  const bool sog = pags_json_member(root, "means") && pags_json_member(root, "quats");
  const bool gltf = pags_json_member(root, "asset") && pags_json_member(root, "buffers");
  const pags_result known = sog || gltf ? PAGS_OK : pags_unsupported_splats_check(path, NULL, 0, root);
  pags_json_destroy(json);
  PAGS_TRY(known);
  if (sog)
    return pags_sog_decode(path, bytes, size, out, facts);
  if (gltf)
    return pags_gltf_decode(path, bytes, size, out, facts);
  return refuse(path, bytes, size);
}

static pags_result decode(const char *path, const uint8_t *bytes, size_t size, int axes, pags_gaussians *out,
                          pags_splat_facts *facts) {
  size_t blanks = 0;
  while (blanks < size && bytes[blanks] && strchr(" \t\r\n\xef\xbb\xbf", bytes[blanks]))
    blanks++;
  if (size >= 4 && memcmp(bytes, "ply", 3) == 0 && (bytes[3] == '\n' || bytes[3] == '\r'))
    PAGS_TRY(pags_ply_decode(path, bytes, size, out, facts));
  else if (size >= 4 && (memcmp(bytes, "NGSP", 4) == 0 || (bytes[0] == 0x1f && bytes[1] == 0x8b)))
    PAGS_TRY(pags_spz_decode(path, bytes, size, out, facts));
  else if (strcasecmp(pags_path_extension(path), ".splat") == 0) {
    /* A .splat file has no signature and is recognised by its extension. */
    facts->kind = "splat";
    PAGS_TRY(pags_splat_decode(path, bytes, size, out));
  } else if (size >= 4 && memcmp(bytes, "glTF", 4) == 0)
    PAGS_TRY(pags_gltf_decode(path, bytes, size, out, facts));
  else if (blanks < size && bytes[blanks] == '{')
    PAGS_TRY(decode_json(path, bytes, size, out, facts));
  else {
    PAGS_TRY(pags_unsupported_splats_check(path, bytes, size, NULL));
    if (!pags_zip_is(bytes, size))
      return refuse(path, bytes, size);
    PAGS_TRY(pags_sog_decode_zip(path, bytes, size, out, facts));
  }
  if (axes != PAGS_AXES_UNKNOWN && strcmp(facts->kind, "glTF") == 0) {
    pags_gaussians_destroy(out);
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: a glTF's axes are known: expected no other ones", path);
  }
  if (axes != PAGS_AXES_UNKNOWN) {
    facts->axes = axes;
    facts->axes_from = "option";
    facts->up = PAGS_UP_UNKNOWN; /* the file's up axis refers to the axes stored in it */
  }
  if (facts->axes_from && strcmp(facts->axes_from, "specification") == 0)
    pags_log_message(
        PAGS_LOG_INFO,
        "%s: no record of its axes: taken as %s, as its format's specification says; what splat-transform 3 "
        "and SuperSplat write is RDF (--axes rdf)",
        path, pags_axes_name(facts->axes));
  if (facts->axes != PAGS_AXES_UNKNOWN) {
    pags_gaussians_turn(out, facts->axes);
    if (strncmp(facts->kind, "SPZ", 3) != 0) /* whose record has the origin in PLY's axes */
      pags_axes_turn_point(facts->axes, facts->origin);
    pags_axes_turn_point(facts->axes, facts->taken_off);
  }
  const double from = (double)facts->converted_from;
  if (from >= (double)PAGS_LEAST_ALPHA_MIN && from < 1 && out->alpha_min == 0.0f)
    pags_plain_cut_undo(out, from);
  else if (from != 0)
    pags_log_message(PAGS_LOG_WARNING, "%s: says that its Gaussians had the alpha_min %g, which can't be; not used",
                     path, from);
  return PAGS_OK;
}

static pags_result load_packed(const char *path, pags_gaussians *out, pags_splat_facts *facts) {
  pags_packed packed;
  PAGS_TRY(pags_packed_open(path, &packed));
  facts->kind = "packed";
  facts->antialiased = packed.antialiased;
  facts->up = (pags_up)packed.up;
  memcpy(facts->origin, packed.origin, sizeof facts->origin);
  const pags_result result = pags_packed_unpack(&packed, out);
  pags_packed_destroy(&packed);
  return result;
}

static pags_result read_file(const char *path, int axes, pags_gaussians *out, pags_splat_facts *facts) {
  uint8_t *bytes;
  size_t size;
  const bool packed = pags_packed_is_file(path);
  if (packed && axes != PAGS_AXES_UNKNOWN)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: a packed file's axes are known: expected no other ones", path);
  if (packed)
    return load_packed(path, out, facts);
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  const pags_result result = decode(path, bytes, size, axes, out, facts);
  free(bytes);
  return result;
}

pags_result pags_splat_read(const char *path, int axes, pags_gaussians *out, pags_splat_facts *facts) {
  pags_splat_facts found = {0};
  *out = (pags_gaussians){0};
  char *const meta = pags_dir_exists(path) ? pags_path_join(path, "meta.json") : NULL; /* a SOG in a folder */
  if (pags_dir_exists(path) && !meta)
    return pags_out_of_memory("%s: a path", path);
  const pags_result result = read_file(meta ? meta : path, axes, out, &found);
  free(meta);
  if (result == PAGS_OK && facts)
    *facts = found;
  return result;
}

pags_result pags_splat_load(const char *path, pags_gaussians *out, const char **kind, int *antialiased) {
  pags_splat_facts facts;
  PAGS_TRY(pags_splat_read(path, PAGS_AXES_UNKNOWN, out, &facts));
  pags_large_put_back(out, facts.taken_off);
  if (kind)
    *kind = facts.kind;
  if (antialiased)
    *antialiased = facts.antialiased;
  return PAGS_OK;
}
