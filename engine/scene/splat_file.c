/* SPDX-License-Identifier: Apache-2.0 */
/* Loads a splat file of any format. The format is recognised by the first bytes of the file, for .splat, which has no
 * signature, by the extension. */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <pags/packed.h>
#include <pags/scene.h>

#include "base/file.h"
#include "scene/splat_formats.h"

static pags_result decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out, const char **kind,
                          int *antialiased) {
  if (size >= 4 && memcmp(bytes, "ply", 3) == 0 && (bytes[3] == '\n' || bytes[3] == '\r'))
    return pags_ply_decode(path, bytes, size, out, kind, antialiased);
  if (size >= 4 && (memcmp(bytes, "NGSP", 4) == 0 || (bytes[0] == 0x1f && bytes[1] == 0x8b)))
    return pags_spz_decode(path, bytes, size, out, kind, antialiased);
  /* A .splat file has no signature and is recognised by its extension. */
  if (strcasecmp(pags_path_extension(path), ".splat") == 0) {
    *kind = "splat";
    return pags_splat_decode(path, bytes, size, out);
  }
  return pags_fail(PAGS_ERROR_FORMAT, "%s: expected a splat file (PLY, SPZ, packed or one named .splat)", path);
}

static pags_result load_packed(const char *path, pags_gaussians *out, const char **kind, int *antialiased) {
  pags_packed packed;
  PAGS_TRY(pags_packed_open(path, &packed));
  if (kind)
    *kind = "packed";
  if (antialiased)
    *antialiased = packed.antialiased;
  const pags_result result = pags_packed_unpack(&packed, out);
  pags_packed_destroy(&packed);
  return result;
}

pags_result pags_splat_load(const char *path, pags_gaussians *out, const char **kind, int *antialiased) {
  uint8_t *bytes;
  size_t size;
  const char *found_kind = "";
  int found_antialiased = 0;
  *out = (pags_gaussians){0};
  if (pags_packed_is_file(path))
    return load_packed(path, out, kind, antialiased);
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  pags_result result = decode(path, bytes, size, out, &found_kind, &found_antialiased);
  free(bytes);
  PAGS_TRY(result);
  if (kind)
    *kind = found_kind;
  if (antialiased)
    *antialiased = found_antialiased;
  return PAGS_OK;
}
