/* SPDX-License-Identifier: Apache-2.0 */
/* Splat files of any format, told apart by content. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <pags/packed.h>
#include <pags/scene.h>

#include "base/file.h"
#include "base/log.h"
#include "scene/splat_formats.h"

float pags_logit_of_byte(uint8_t alpha) {
  double p = fmin(fmax(alpha / 255.0, 1e-6), 1 - 1e-6);
  return (float)log(p / (1 - p));
}

static const char *plane_name(int plane) {
  return plane < PAGS_SCALE      ? "position"
         : plane < PAGS_ROTATION ? "scale"
         : plane < PAGS_OPACITY  ? "rotation"
         : plane < PAGS_SH       ? "opacity"
                                 : "colour";
}

static pags_result fail_first_bad(const char *path, const pags_gaussians *g) {
  for (int64_t i = 0; i < g->count; i++)
    for (int p = 0; p < pags_plane_count(g->sh_degree); p++)
      if (!isfinite(pags_plane(g, p)[i]))
        return pags_fail(PAGS_ERROR_FORMAT, "%s: Gaussian %lld: expected finite numbers for its %s", path, (long long)i,
                         plane_name(p));
  return PAGS_OK;
}

static int64_t fix_rotations(pags_gaussians *g) {
  int64_t fixed = 0;
  float *q[4];
  for (int k = 0; k < 4; k++)
    q[k] = pags_plane(g, PAGS_ROTATION + k);
  for (int64_t i = 0; i < g->count; i++) {
    if (q[0][i] == 0 && q[1][i] == 0 && q[2][i] == 0 && q[3][i] == 0) {
      q[0][i] = 1;
      fixed++;
    }
  }
  return fixed;
}

pags_result pags_splat_accept(const char *path, pags_gaussians *g) {
  if (g->count == 0 || pags_gaussians_find_bad(g, NULL) == 0)
    return PAGS_OK;
  PAGS_TRY(fail_first_bad(path, g));
  int64_t fixed = fix_rotations(g);
  pags_log(PAGS_LOG_WARNING, "%s: %lld all-zero quaternions taken as no rotation", path, (long long)fixed);
  return PAGS_OK;
}

static pags_result decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out, const char **kind,
                          int *antialiased) {
  if (size >= 4 && memcmp(bytes, "ply", 3) == 0 && (bytes[3] == '\n' || bytes[3] == '\r'))
    return pags_ply_decode(path, bytes, size, out, kind, antialiased);
  if (size >= 4 && (memcmp(bytes, "NGSP", 4) == 0 || (bytes[0] == 0x1f && bytes[1] == 0x8b)))
    return pags_spz_decode(path, bytes, size, out, kind, antialiased);
  /* A .splat has no signature: only its name tells. */
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
