/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench reference: draws views by the double-precision oracle (tests/reference) and writes them as floats, to hold
 * the pictures of any program against. */
#include "benchmarks/bench.h"

#include <stdlib.h>
#include "base/file.h"
#include "base/memory.h"
#include "reference/reference.h"

pags_result pags_bench_exact(const pags_part *parts, int part_count, const pags_camera *camera,
                             const pags_frame_options *options, double **rgb, int64_t *pairs) {
  PAGS_AUTOFREE reference_part *copies = calloc((size_t)part_count + 1, sizeof *copies);
  PAGS_CHECK_MEMORY(copies, "%d models", part_count);
  for (int p = 0; p < part_count; p++)
    copies[p] = reference_part_from(parts + p);
  reference_picture picture = reference_render(copies, part_count, camera, options);
  *rgb = pags_take(&picture.rgb);
  *pairs = picture.contribution_count;
  reference_picture_destroy(&picture);
  for (int p = 0; p < part_count; p++)
    reference_part_destroy(copies + p);
  return PAGS_OK;
}

/* Writes a picture as a PFM of three channels, 32-bit floats in this machine's order, rows from below (Debevec's
 * HDRShop format). */
static pags_result write_pfm(const char *path, const double *rgb, int64_t width, int64_t height) {
  const uint16_t one = 1;
  char head[64];
  PAGS_AUTOFREE float *row = malloc(3 * (size_t)width * sizeof *row);
  PAGS_CHECK_MEMORY(row, "a row of a picture");
  pags_file_writer file;
  const int length = snprintf(head, sizeof head, "PF\n%lld %lld\n%s\n", (long long)width, (long long)height,
                              *(const uint8_t *)&one ? "-1.0" : "1.0");
  PAGS_TRY(pags_file_writer_begin(&file, path));
  pags_result result = pags_file_writer_put(&file, head, (size_t)length);
  for (int64_t y = height - 1; y >= 0 && result == PAGS_OK; y--) {
    for (int64_t i = 0; i < 3 * width; i++)
      row[i] = (float)rgb[i % 3 * width * height + y * width + i / 3];
    result = pags_file_writer_put(&file, row, 3 * (size_t)width * sizeof *row);
  }
  if (result == PAGS_OK)
    return pags_file_writer_commit(&file);
  pags_file_writer_abort(&file);
  return result;
}

pags_result pags_bench_reference(const pags_bench_view *view, FILE *people, pags_json_writer *json) {
  const pags_camera *const camera = view->cameras;
  PAGS_AUTOFREE double *rgb = NULL;
  int64_t pairs;
  PAGS_TRY(pags_bench_exact(view->parts, view->part_count, camera, &view->options, &rgb, &pairs));
  PAGS_TRY(write_pfm(view->picture, rgb, camera->width, camera->height));
  pags_json_put_integer(json, "width", camera->width);
  pags_json_put_integer(json, "height", camera->height);
  pags_json_put_integer(json, "pairs", pairs);
  if (people)
    fprintf(people, "%s: %dx%d, %lld pairs of Gaussian and pixel blended\n", view->picture, camera->width,
            camera->height, (long long)pairs);
  return PAGS_OK;
}
