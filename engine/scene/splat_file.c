/* SPDX-License-Identifier: Apache-2.0 */
/* Loads a splat file of any format. The format is recognised by the first bytes of the file, for .splat, which has no
 * signature, by the extension. */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <pags/packed.h>
#include <pags/scene.h>

#include "base/file.h"
#include "base/log.h"
#include "scene/axes.h"
#include "scene/splat_formats.h"

/* ---- What other files are, which are named like splat files or found beside them ---- */

static pags_result refuse(const char *path, const uint8_t *bytes, size_t size) {
  const char *const extension = pags_path_extension(path);
  const size_t blanks = strspn((const char *)bytes, " \t\r\n");
  if (strcasecmp(extension, ".ksplat") == 0)
    return pags_fail(
        PAGS_ERROR_UNSUPPORTED,
        "%s: .ksplat, the format of the viewer GaussianSplats3D, can't be read; '@playcanvas/splat-transform' "
        "turns it into .ply",
        path);
  if (size > blanks && (bytes[blanks] == '{' || bytes[blanks] == '['))
    return pags_fail(PAGS_ERROR_FORMAT,
                     "%s: a JSON file of another program: expected a splat file, or the scene.json of a scene folder",
                     path);
  if (size > blanks && bytes[blanks] == '<')
    return pags_fail(PAGS_ERROR_FORMAT, "%s: a web page or other XML: expected a splat file", path);
  if (blanks == size)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: empty: expected a splat file", path);
  return pags_fail(PAGS_ERROR_FORMAT, "%s: expected a splat file (PLY, SPZ, packed or one named .splat)", path);
}

/* ---- Loading ---- */

static pags_result decode(const char *path, const uint8_t *bytes, size_t size, int axes, pags_gaussians *out,
                          pags_splat_facts *facts) {
  if (size >= 4 && memcmp(bytes, "ply", 3) == 0 && (bytes[3] == '\n' || bytes[3] == '\r'))
    PAGS_TRY(pags_ply_decode(path, bytes, size, out, facts));
  else if (size >= 4 && (memcmp(bytes, "NGSP", 4) == 0 || (bytes[0] == 0x1f && bytes[1] == 0x8b)))
    PAGS_TRY(pags_spz_decode(path, bytes, size, out, facts));
  else if (strcasecmp(pags_path_extension(path), ".splat") == 0) {
    /* A .splat file has no signature and is recognised by its extension. */
    facts->kind = "splat";
    PAGS_TRY(pags_splat_decode(path, bytes, size, out));
  } else
    return refuse(path, bytes, size);
  if (axes != PAGS_AXES_UNKNOWN) {
    facts->axes = axes;
    facts->axes_from = "option";
    facts->up = PAGS_UP_UNKNOWN; /* what the file says is of the axes that it names itself */
  }
  if (facts->axes_from && strcmp(facts->axes_from, "specification") == 0)
    pags_log_message(
        PAGS_LOG_INFO,
        "%s: no record of its axes: taken as %s, as its format's specification says; what splat-transform 3 "
        "and SuperSplat write is RDF (--axes rdf)",
        path, pags_axes_name(facts->axes));
  if (facts->axes != PAGS_AXES_UNKNOWN)
    pags_gaussians_turn(out, facts->axes);
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

pags_result pags_splat_read(const char *path, int axes, pags_gaussians *out, pags_splat_facts *facts) {
  uint8_t *bytes;
  size_t size;
  pags_splat_facts found = {0};
  *out = (pags_gaussians){0};
  const bool packed = pags_packed_is_file(path);
  if (packed && axes != PAGS_AXES_UNKNOWN)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: a packed file's axes are known: expected no other ones", path);
  if (packed) {
    PAGS_TRY(load_packed(path, out, &found));
  } else {
    PAGS_TRY(pags_file_read(path, &bytes, &size));
    const pags_result result = decode(path, bytes, size, axes, out, &found);
    free(bytes);
    PAGS_TRY(result);
  }
  if (facts)
    *facts = found;
  return PAGS_OK;
}

pags_result pags_splat_load(const char *path, pags_gaussians *out, const char **kind, int *antialiased) {
  pags_splat_facts facts;
  PAGS_TRY(pags_splat_read(path, PAGS_AXES_UNKNOWN, out, &facts));
  if (kind)
    *kind = facts.kind;
  if (antialiased)
    *antialiased = facts.antialiased;
  return PAGS_OK;
}
