/* Bilinear resampling through the distortion model, row by row; display-referred values as they are stored.
 *
 * The centre of output pixel (x, y) lies at (x + 0.5, y + 0.5); its ray goes through the model to a source position (u, v),
 * which lies between the four pixels whose centres surround it. Within half a pixel of the border the outermost pixels
 * are repeated. */
#include "dataset/undistort.h"

#include <assert.h>
#include <stdlib.h>

typedef struct taps {
  size_t at[4];    /* pixel indices */
  float weight[4]; /* sum 1 */
} taps;

static int clamp(int value, int size) {
  return value < 0 ? 0 : value >= size ? size - 1 : value;
}

/* False where (u, v) lies outside of the picture. */
static bool find_taps(const pags_lens *lens, double u, double v, taps *out) {
  if (!(u >= 0 && u <= lens->width && v >= 0 && v <= lens->height))
    return false;
  int x = (int)(u + 0.5) - 1, y = (int)(v + 0.5) - 1; /* floor(u - 0.5), u >= 0 */
  float fx = (float)(u - 0.5 - x), fy = (float)(v - 0.5 - y);
  size_t left = (size_t)clamp(x, lens->width), right = (size_t)clamp(x + 1, lens->width);
  size_t top = (size_t)clamp(y, lens->height) * (size_t)lens->width;
  size_t bottom = (size_t)clamp(y + 1, lens->height) * (size_t)lens->width;
  out->at[0] = top + left;
  out->at[1] = top + right;
  out->at[2] = bottom + left;
  out->at[3] = bottom + right;
  out->weight[0] = (1 - fx) * (1 - fy);
  out->weight[1] = fx * (1 - fy);
  out->weight[2] = (1 - fx) * fy;
  out->weight[3] = fx * fy;
  return true;
}

static void mix(const uint8_t *from, int channels, const taps *t, uint8_t *to) {
  for (int c = 0; c < channels; c++) {
    float sum = 0;
    for (int i = 0; i < 4; i++)
      sum += t->weight[i] * (float)from[t->at[i] * (size_t)channels + (size_t)c];
    to[c] = (uint8_t)(sum + 0.5f);
  }
}

static bool mask_uses(const uint8_t *mask, const taps *t) {
  for (int i = 0; i < 4; i++)
    if (mask[t->at[i]] < 128 && t->weight[i] > 0)
      return false;
  return true;
}

/* Returns whether every pixel of the row has a source. */
static bool resample_row(const pags_lens *lens, const pags_camera *pinhole, int y, const pags_image *from,
                         const pags_image *from_mask, uint8_t *row, uint8_t *mask) {
  bool complete = true;
  double ry = (y + 0.5 - pinhole->cy) / pinhole->fy;
  for (int x = 0; x < pinhole->width; x++) {
    double u, v, rx = (x + 0.5 - pinhole->cx) / pinhole->fx;
    taps t;
    bool has_source = pags_lens_project(lens, rx, ry, &u, &v) && find_taps(lens, u, v, &t);
    if (has_source)
      mix(from->data, from->channels, &t, row + x * from->channels);
    complete = complete && has_source;
    mask[x] = has_source && (!from_mask || mask_uses(from_mask->data, &t)) ? 255 : 0;
  }
  return complete;
}

pags_result pags_undistort(const pags_lens *lens, const pags_camera *pinhole, const pags_image *from,
                           const pags_image *from_mask, pags_image *to, pags_image *to_mask) {
  assert(from->sample == PAGS_U8 && from->width == lens->width && from->height == lens->height);
  assert(!from_mask || (from_mask->sample == PAGS_U8 && from_mask->channels == 1));
  assert(!from_mask || (from_mask->width == lens->width && from_mask->height == lens->height));
  PAGS_TRY(pags_image_create(to, pinhole->width, pinhole->height, from->channels, PAGS_U8));
  pags_result result = pags_image_create(to_mask, pinhole->width, pinhole->height, 1, PAGS_U8);
  if (result != PAGS_OK) {
    pags_image_destroy(to);
    return result;
  }
  bool complete = true;
  for (int y = 0; y < pinhole->height; y++) {
    size_t begin = (size_t)y * (size_t)pinhole->width;
    uint8_t *row = (uint8_t *)to->data + begin * (size_t)from->channels;
    complete = resample_row(lens, pinhole, y, from, from_mask, row, (uint8_t *)to_mask->data + begin) && complete;
  }
  if (complete && !from_mask)
    pags_image_destroy(to_mask);
  return PAGS_OK;
}
