/* SPDX-License-Identifier: Apache-2.0 */
/* Loads a splat file of any format. The format is recognised by the first bytes of the file, for .splat, which has no
 * signature, by the extension. */
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include <pags/packed.h>
#include <pags/scene.h>

#include "base/file.h"
#include "base/json.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "base/zip.h"
#include "scene/axes.h"
#include "scene/other_formats.h"
#include "scene/splat_formats.h"

/* ---- Other files with the names of splat files, or found next to them ---- */

static pags_result refuse(const char *path, const uint8_t *bytes, size_t size) {
  const size_t blanks = strspn((const char *)bytes, " \t\r\n");
  if (size > blanks && (bytes[blanks] == '{' || bytes[blanks] == '['))
    return pags_fail_at(path,
                        "a JSON file of another program: expected a splat file, the meta.json of a SOG, a glTF, or "
                        "the scene.json of a scene folder");
  if (size > blanks && bytes[blanks] == '<')
    return pags_fail_at(path, "a web page or other XML: expected a splat file");
  if (blanks == size)
    return pags_fail_at(path, "empty: expected a splat file");
  bool text = true; /* no control characters but blanks in the first bytes */
  for (size_t i = 0; i < size && i < 256; i++)
    text = text && (bytes[i] >= ' ' || (bytes[i] && strchr("\t\r\n\f", bytes[i])));
  char found[32] = "text";
  if (!text)
    snprintf(found, sizeof found, "bytes %02x %02x %02x %02x", bytes[0], size > 1 ? bytes[1] : 0,
             size > 2 ? bytes[2] : 0, size > 3 ? bytes[3] : 0);
  return pags_fail_at(
      path, "expected a splat file (PLY, SPZ, SOG, glTF with Gaussians, packed or one named .splat), found %s", found);
}

/* ---- Loading ---- */

static bool begins_with(const uint8_t *bytes, size_t size, const char four[4]) {
  return size >= 4 && memcmp(bytes, four, 4) == 0;
}

/* Finds the decoder of a JSON file: a SOG's meta.json, or a .gltf. */
static pags_result find_json_decoder(const char *path, const uint8_t *bytes, size_t size, pags_splat_decoder **out) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_TRY(pags_json_parse_text(path, (const char *)bytes, size, &json));
  const pags_json_value *root = pags_json_root(json);
  if (pags_json_member(root, "means") && pags_json_member(root, "quats"))
    *out = pags_sog_decode;
  else if (pags_json_member(root, "asset") && pags_json_member(root, "buffers"))
    *out = pags_gltf_decode;
  else {
    PAGS_TRY(pags_unsupported_splats_check(path, NULL, 0, root));
    return refuse(path, bytes, size);
  }
  return PAGS_OK;
}

static pags_result find_decoder(const char *path, const uint8_t *bytes, size_t size, pags_splat_decoder **out) {
  size_t blanks = 0;
  while (blanks < size && bytes[blanks] && strchr(" \t\r\n\xef\xbb\xbf", bytes[blanks]))
    blanks++;
  if (pags_ply_is(bytes, size))
    *out = pags_ply_decode;
  else if (begins_with(bytes, size, "NGSP") || (size >= 4 && bytes[0] == 0x1f && bytes[1] == 0x8b))
    *out = pags_spz_decode;
  else if (strcasecmp(pags_path_extension(path), ".splat") == 0) /* it has no signature */
    *out = pags_splat_decode;
  else if (begins_with(bytes, size, "glTF"))
    *out = pags_gltf_decode;
  else if (blanks < size && bytes[blanks] == '{')
    return find_json_decoder(path, bytes, size, out);
  else {
    PAGS_TRY(pags_unsupported_splats_check(path, bytes, size, NULL));
    if (!pags_zip_is(bytes, size))
      return refuse(path, bytes, size);
    *out = pags_sog_decode_zip;
  }
  return PAGS_OK;
}

static pags_result decode(const char *path, const uint8_t *bytes, size_t size, int axes, pags_gaussians *out,
                          pags_splat_facts *facts) {
  pags_splat_decoder *decoder = NULL;
  PAGS_TRY(find_decoder(path, bytes, size, &decoder));
  PAGS_TRY(pags_splat_run(decoder, path, bytes, size, out, facts));
  if (axes != PAGS_AXES_UNKNOWN && decoder == pags_gltf_decode)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: a glTF's axes are known: expected no other ones", path);
  if (axes != PAGS_AXES_UNKNOWN) {
    facts->axes = axes;
    facts->axes_from = "option";
    facts->up = PAGS_UP_UNKNOWN; /* the file's up axis refers to the axes stored in it */
  }
  if (facts->axes_from && strcmp(facts->axes_from, "specification") == 0)
    pags_log_message(PAGS_LOG_INFO,
                     "%s: no record of its axes: taken as %s, as its format's specification says; what splat-transform "
                     "3 and SuperSplat write is RDF (--axes rdf)",
                     path, pags_axes_name(facts->axes));
  if (facts->axes != PAGS_AXES_UNKNOWN) {
    pags_gaussians_turn(out, facts->axes);
    if (decoder != pags_spz_decode) /* whose record has the origin in PLY's axes */
      pags_axes_turn_point(facts->axes, facts->origin);
    pags_axes_turn_point(facts->axes, facts->taken_off);
  }
  const double from = (double)facts->converted_from;
  if (from >= (double)PAGS_LEAST_ALPHA_MIN && from < 1 && out->alpha_min == 0.0f)
    pags_plain_cut_undo(out, from);
  else if (from != 0)
    PAGS_WARN("%s: says that its Gaussians had the alpha_min %g, which can't be; not used", path, from);
  return PAGS_OK;
}

static pags_result read_file(const char *path, int axes, pags_gaussians *out, pags_splat_facts *facts) {
  if (pags_packed_is_file(path)) {
    if (axes != PAGS_AXES_UNKNOWN)
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: a packed file's axes are known: expected no other ones", path);
    PAGS_AUTO(pags_packed_destroy) pags_packed packed = {0};
    PAGS_TRY(pags_packed_open(path, &packed));
    *facts = (pags_splat_facts){.kind = "packed", .antialiased = packed.antialiased, .up = (pags_up)packed.up};
    pags_copy3(packed.origin, facts->origin);
    return pags_packed_unpack(&packed, out);
  }
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  return decode(path, bytes, size, axes, out, facts);
}

pags_result pags_splat_read(const char *path, int axes, pags_gaussians *out, pags_splat_facts *facts) {
  pags_splat_facts found = {0};
  *out = (pags_gaussians){0};
  const bool folder = pags_dir_exists(path); /* a SOG in a folder */
  PAGS_AUTOFREE char *meta = folder ? pags_path_join(path, "meta.json") : NULL;
  PAGS_CHECK_MEMORY(meta || !folder, "%s: a path", path);
  const pags_result result = read_file(folder ? meta : path, axes, out, &found);
  if (result != PAGS_OK)
    pags_gaussians_destroy(out);
  else if (facts)
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
