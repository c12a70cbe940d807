/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench reference: draws views by the double-precision oracle (tests/reference) and writes them as floats, to hold
 * the pictures of any program against. */
#include "benchmarks/bench.h"

#include <stdlib.h>
#include "base/file.h"
#include "base/memory.h"
#include "benchmarks/error/error.h"
#include "reference/reference.h"

/* Writes a picture as a PFM of three channels, 32-bit floats in this machine's order, rows from below (Debevec's
 * HDRShop format). */
static pags_result write_pfm(const char *path, const reference_picture *picture) {
  const int64_t width = picture->width, height = picture->height, pixels = width * height;
  const uint16_t one = 1;
  char head[64];
  float *const row = malloc(3 * (size_t)width * sizeof *row);
  if (!row)
    return pags_out_of_memory("a row of a picture");
  pags_file_writer file;
  const int length = snprintf(head, sizeof head, "PF\n%d %d\n%s\n", picture->width, picture->height,
                              *(const uint8_t *)&one ? "-1.0" : "1.0");
  pags_result result = pags_file_writer_begin(&file, path);
  if (result == PAGS_OK) {
    result = pags_file_writer_put(&file, head, (size_t)length);
    for (int64_t y = height - 1; y >= 0 && result == PAGS_OK; y--) {
      for (int64_t i = 0; i < 3 * width; i++)
        row[i] = (float)picture->rgb[i % 3 * pixels + y * width + i / 3];
      result = pags_file_writer_put(&file, row, 3 * (size_t)width * sizeof *row);
    }
    if (result == PAGS_OK)
      result = pags_file_writer_commit(&file);
    else
      pags_file_writer_abort(&file);
  }
  free(row);
  return result;
}

pags_result pags_bench_reference(const pags_bench_view *view, FILE *people, pags_json_writer *json) {
  if (view->part_count > PAGS_BENCH_ERROR_PARTS)
    return pags_fail(PAGS_ERROR_LIMIT, "%d models; the renderer in double precision takes at most %d", view->part_count,
                     PAGS_BENCH_ERROR_PARTS);
  reference_part parts[PAGS_BENCH_ERROR_PARTS];
  for (int p = 0; p < view->part_count; p++)
    parts[p] = reference_part_from(view->parts + p);
  reference_picture picture = reference_render(parts, view->part_count, view->cameras, &view->options);
  const pags_result result = write_pfm(view->picture, &picture);
  pags_json_put_integer(json, "width", picture.width);
  pags_json_put_integer(json, "height", picture.height);
  pags_json_put_integer(json, "pairs", picture.contribution_count);
  if (people && result == PAGS_OK)
    fprintf(people, "%s: %dx%d, %lld pairs of Gaussian and pixel blended\n", view->picture, picture.width,
            picture.height, (long long)picture.contribution_count);
  reference_picture_destroy(&picture);
  for (int p = 0; p < view->part_count; p++)
    reference_part_destroy(parts + p);
  return result;
}
