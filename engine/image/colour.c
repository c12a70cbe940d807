/* SPDX-License-Identifier: Apache-2.0 */
/* Conversion of pictures to sRGB (colour.h). */
#include "image/colour.h"

#include <math.h>
#include <stdio.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "image/pixels.h"
#include "maths/maths.h"

/* ---- Curves ---- */

static double light_of_srgb(double v) {
  return v <= 0.04045 ? v / 12.92 : pags_pow((v + 0.055) / 1.055, 2.4);
}

static double light_of_bt709(double v) {
  return v < 0.081 ? v / 4.5 : pags_pow((v + 0.099) / 1.099, 1 / 0.45);
}

static double srgb_of_light(double light) {
  return light <= 0.0031308 ? light * 12.92 : 1.055 * pags_pow(light, 1 / 2.4) - 0.055;
}

static double power(double v, double gamma) {
  return v <= 0 ? 0 : pags_pow(v, gamma);
}

/* The curves that files name; GAMMA is followed by its exponent. */
typedef enum curve { CURVE_SRGB, CURVE_BT709, CURVE_GAMMA } curve;

static void set_curves(pags_colour *out, curve which, double gamma) {
  for (int i = 0; i <= PAGS_CURVE_STEPS; i++) {
    const double v = (double)i / PAGS_CURVE_STEPS;
    const double light = which == CURVE_SRGB    ? light_of_srgb(v)
                         : which == CURVE_BT709 ? light_of_bt709(v)
                                                : power(v, gamma);
    out->light[0][i] = out->light[1][i] = out->light[2][i] = (float)light;
  }
}

/* ---- Primaries ---- */

static const double bt709[8] = {0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290};
static const double adobe[8] = {0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290};

/* From XYZ adapted to D50 (Bradford), as ICC profiles have it, to the light of sRGB. */
static const double srgb_from_d50[9] = {3.1338561, -1.6168667, -0.4906146, -0.9787684, 1.9161415,
                                        0.0334540, 0.0719453,  -0.2289914, 1.4052427};

static void multiply(const double a[9], const double b[9], double out[9]) {
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

static void transform(const double m[9], const double v[3], double out[3]) {
  for (int i = 0; i < 3; i++)
    out[i] = pags_dot3(m + 3 * i, v);
}

static bool invert(const double m[9], double out[9]) {
  const double cofactor[9] = {m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
                              m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
                              m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};
  const double determinant = m[0] * cofactor[0] + m[1] * cofactor[3] + m[2] * cofactor[6];
  for (int i = 0; i < 9; i++)
    out[i] = cofactor[i] / determinant;
  return fabs(determinant) > 1e-9;
}

/* XYZ, adapted to D50 by Bradford's matrix, of the light of primaries with these chromaticities. */
static bool d50_from_primaries(const double xy[8], double out[9]) {
  static const double bradford[9] = {0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296};
  static const double d50[3] = {0.96422, 1, 0.82521};
  double columns[9], inverse[9], xyz[9], white[3], amounts[3], from[3], to[3], cone[9];
  for (int i = 0; i < 4; i++) {
    const double x = xy[2 * i], y = xy[2 * i + 1];
    const double column[3] = {x / y, 1, (1 - x - y) / y};
    if (!(fabs(y) > 1e-6 && fabs(x) < 10 && fabs(y) < 10))
      return false;
    for (int k = 0; k < 3; k++)
      *(i < 3 ? &columns[3 * k + i] : &white[k]) = column[k];
  }
  if (!invert(columns, inverse))
    return false;
  transform(inverse, white, amounts);
  for (int i = 0; i < 9; i++)
    xyz[i] = columns[i] * amounts[i % 3];
  transform(bradford, white, from);
  transform(bradford, d50, to);
  for (int i = 0; i < 9; i++)
    cone[i] = bradford[i] * to[i / 3] / from[i / 3];
  if (!invert(bradford, inverse))
    return false;
  double adapt[9];
  multiply(inverse, cone, adapt);
  multiply(adapt, xyz, out);
  return true;
}

/* ---- Spaces ---- */

void pags_colour_set_unknown(pags_colour *out, const char *name) {
  memset(out, 0, sizeof *out);
  out->kind = PAGS_COLOUR_UNKNOWN;
  snprintf(out->name, sizeof out->name, "%s", name);
}

static double light_at(const pags_colour *colour, int c, double v) {
  const double at = (v > 0 ? (v < 1 ? v : 1) : 0) * PAGS_CURVE_STEPS;
  const int i = at < PAGS_CURVE_STEPS ? (int)at : PAGS_CURVE_STEPS - 1;
  const double low = (double)colour->light[c][i], high = (double)colour->light[c][i + 1];
  return low + (high - low) * (at - i);
}

/* The most that the conversion changes a sample, over a grid of colours; of 1. */
static double find_change(const pags_colour *colour) {
  enum { SIDE = 6 };
  double most = 0;
  for (int k = 0; k < SIDE * SIDE * SIDE; k++) {
    const double v[3] = {(k % SIDE) / (SIDE - 1.0), (k / SIDE % SIDE) / (SIDE - 1.0), (k / SIDE / SIDE) / (SIDE - 1.0)};
    for (int i = 0; i < 3; i++) {
      double light = 0;
      for (int c = 0; c < 3; c++)
        light += (double)colour->matrix[3 * i + c] * light_at(colour, c, v[c]);
      const double change = fabs(srgb_of_light(light > 0 ? (light < 1 ? light : 1) : 0) - v[i]);
      most = change > most ? change : most;
    }
  }
  return most;
}

/* Completes a space whose curves are set with its matrix to XYZ: what is sRGB within a level of 255 is left as it is.
 */
static void finish(pags_colour *out, const double d50_from[9], const char *name) {
  const double as_srgb = 1 / 255.0;
  double matrix[9];
  multiply(srgb_from_d50, d50_from, matrix);
  bool sound = true;
  for (int i = 0; i < 9; i++) {
    out->matrix[i] = (float)matrix[i];
    sound = sound && fabs(matrix[i]) < 100;
  }
  for (int i = 0; i < 3 * (PAGS_CURVE_STEPS + 1); i++)
    sound = sound && fabsf(out->light[i / (PAGS_CURVE_STEPS + 1)][i % (PAGS_CURVE_STEPS + 1)]) < 100;
  if (!sound) {
    pags_colour_set_unknown(out, name);
    return;
  }
  snprintf(out->name, sizeof out->name, "%s", name);
  out->kind = find_change(out) < as_srgb ? PAGS_COLOUR_SRGB : PAGS_COLOUR_OTHER;
}

static void finish_primaries(pags_colour *out, const double xy[8], const char *name) {
  double d50[9];
  if (d50_from_primaries(xy, d50))
    finish(out, d50, name);
  else
    pags_colour_set_unknown(out, "invalid primaries");
}

void pags_colour_set_gamma(pags_colour *out, double gamma, const double xy[8], const char *name) {
  const double usual = 2.2;
  char numbers[PAGS_IMAGE_NAME];
  memset(out, 0, sizeof *out);
  if (gamma == 0)
    snprintf(numbers, sizeof numbers, "primaries of its own");
  else
    snprintf(numbers, sizeof numbers, "gamma %.3g%s%s", gamma, gamma == 1 ? ", linear light" : "",
             xy ? ", primaries of its own" : "");
  /* A gamma of 2.2 with the primaries of sRGB means sRGB: programs that write sRGB state it for those that know no
   * other way. */
  if (gamma == 0 || fabs(gamma / usual - 1) < 0.02) {
    set_curves(out, CURVE_SRGB, 0);
    finish_primaries(out, xy ? xy : bt709, name ? name : numbers);
    if (gamma == 0 || out->kind == PAGS_COLOUR_SRGB)
      return;
  }
  set_curves(out, CURVE_GAMMA, gamma);
  finish_primaries(out, xy ? xy : bt709, name ? name : numbers);
}

void pags_colour_set_adobe_rgb(pags_colour *out) {
  pags_colour_set_gamma(out, 2.19921875, adobe, "Adobe RGB");
}

void pags_colour_set_primaries(pags_colour *out, const double xy[8]) {
  memset(out, 0, sizeof *out);
  set_curves(out, CURVE_SRGB, 0); /* compares the primaries; light isn't encoded */
  finish_primaries(out, xy, "linear light of primaries of its own");
}

void pags_colour_set_cicp(pags_colour *out, int primaries, int transfer, bool full_range) {
  static const struct {
    int number;
    const char *name;
    double xy[8];
  } known[] = {{1, "BT.709", {0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290}},
               {2, "BT.709", {0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290}},
               {5, "BT.601 (625 lines)", {0.64, 0.33, 0.29, 0.60, 0.15, 0.06, 0.3127, 0.3290}},
               {6, "BT.601 (525 lines)", {0.63, 0.34, 0.31, 0.595, 0.155, 0.07, 0.3127, 0.3290}},
               {7, "BT.601 (525 lines)", {0.63, 0.34, 0.31, 0.595, 0.155, 0.07, 0.3127, 0.3290}},
               {9, "BT.2020", {0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290}},
               {11, "DCI P3", {0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.314, 0.351}},
               {12, "Display P3", {0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.3290}}};
  char name[PAGS_IMAGE_NAME];
  size_t i = 0;
  memset(out, 0, sizeof *out);
  while (i < sizeof known / sizeof *known && known[i].number != primaries)
    i++;
  snprintf(name, sizeof name, "%s%s", i < sizeof known / sizeof *known ? known[i].name : "other primaries",
           transfer == 16   ? ", PQ (HDR)"
           : transfer == 18 ? ", HLG (HDR)"
           : !full_range    ? ", narrow range"
                            : "");
  if (transfer == 1 || transfer == 6 || transfer == 14 || transfer == 15)
    set_curves(out, CURVE_BT709, 0);
  else if (transfer == 4 || transfer == 5 || transfer == 8)
    set_curves(out, CURVE_GAMMA, transfer == 4 ? 2.2 : transfer == 5 ? 2.8 : 1);
  else if (transfer == 2 || transfer == 13)
    set_curves(out, CURVE_SRGB, 0);
  else
    full_range = false; /* not known */
  if (i == sizeof known / sizeof *known || !full_range)
    pags_colour_set_unknown(out, name);
  else
    finish_primaries(out, known[i].xy, name);
}

void pags_colour_state(const pags_colour *colour, pags_image_facts *facts) {
  facts->colour = colour->kind;
  memcpy(facts->space, colour->name, sizeof facts->space);
}

/* ---- ICC profiles ---- */

static double load_fixed(const uint8_t *p) {
  return (double)(int32_t)pags_load_big(p, 4) / 65536;
}

/* A tag's bytes; NULL: not found, or it doesn't lie in the profile. At least 8 bytes: its type and four of padding.
 */
static const uint8_t *find_tag(const uint8_t *profile, size_t size, const char *signature, size_t *length) {
  const size_t count = pags_load_big(profile + 128, 4);
  for (size_t i = 0; i < count && 132 + 12 * (i + 1) <= size; i++) {
    const uint8_t *const entry = profile + 132 + 12 * i;
    const size_t at = pags_load_big(entry + 4, 4);
    *length = pags_load_big(entry + 8, 4);
    if (memcmp(entry, signature, 4) == 0)
      return at <= size && *length <= size - at && *length >= 8 ? profile + at : NULL;
  }
  return NULL;
}

/* A parametric curve of one of five kinds (ICC.1, 10.18). */
static double parametric(int kind, const double p[7], double x) {
  const double g = p[0], a = p[1], b = p[2], c = p[3];
  if (kind == 0)
    return power(x, g);
  if (kind <= 2)
    return (a * x + b >= 0 ? power(a * x + b, g) : 0) + (kind == 2 ? c : 0);
  return x >= p[4] ? power(a * x + b, g) + p[5] : c * x + p[6];
}

static bool read_curve(const uint8_t *tag, size_t length, float light[PAGS_CURVE_STEPS + 1]) {
  static const int counts[] = {1, 3, 4, 5, 7};
  const bool is_table = length >= 12 && memcmp(tag, "curv", 4) == 0;
  const bool is_formula = length >= 12 && memcmp(tag, "para", 4) == 0;
  const size_t entries = is_table ? pags_load_big(tag + 8, 4) : 0;
  const unsigned kind = is_formula ? pags_load_big(tag + 8, 2) : 0;
  double p[7] = {0};
  if (!is_table && !is_formula)
    return false;
  if (is_table ? (length - 12) / 2 < entries : kind > 4 || length < 12 + 4 * (size_t)counts[kind])
    return false;
  for (int i = 0; is_formula && i < counts[kind]; i++)
    p[i] = load_fixed(tag + 12 + 4 * i);
  for (int i = 0; i <= PAGS_CURVE_STEPS; i++) {
    const double x = (double)i / PAGS_CURVE_STEPS;
    double y = x;
    if (is_formula) {
      y = parametric((int)kind, p, x);
    } else if (entries == 1) {
      y = power(x, pags_load_big(tag + 12, 2) / 256.0);
    } else if (entries > 1) {
      const double at = x * (double)(entries - 1);
      const size_t low = (size_t)at < entries - 1 ? (size_t)at : entries - 2;
      const double first = pags_load_big(tag + 12 + 2 * low, 2), second = pags_load_big(tag + 14 + 2 * low, 2);
      y = (first + (second - first) * (at - (double)low)) / 65535;
    }
    light[i] = (float)y;
  }
  return true;
}

/* Writes the profile's description in ASCII, other characters left out. */
static void read_name(const uint8_t *profile, size_t size, char name[PAGS_IMAGE_NAME]) {
  size_t length, begin = 12, end = 0, step = 1, used = 0;
  const uint8_t *const tag = find_tag(profile, size, "desc", &length);
  if (tag && length >= 12 && memcmp(tag, "desc", 4) == 0) {
    end = begin + pags_load_big(tag + 8, 4);
  } else if (tag && length >= 28 && memcmp(tag, "mluc", 4) == 0) { /* the first language; UTF-16, big-endian */
    begin = (size_t)pags_load_big(tag + 24, 4) + 1;
    end = begin + pags_load_big(tag + 20, 4);
    step = 2;
  }
  for (size_t i = begin; tag && i < end && i < length && used < PAGS_IMAGE_NAME - 1; i += step)
    if (tag[i] >= ' ' && tag[i] < 127)
      name[used++] = (char)tag[i];
  name[used] = '\0';
  if (used == 0)
    snprintf(name, PAGS_IMAGE_NAME, "an ICC profile without a name");
}

/* The columns of the matrix; false: not found. */
static bool read_matrix(const uint8_t *profile, size_t size, double d50[9]) {
  static const char *const signatures[] = {"rXYZ", "gXYZ", "bXYZ"};
  for (int c = 0; c < 3; c++) {
    size_t length;
    const uint8_t *const tag = find_tag(profile, size, signatures[c], &length);
    if (!tag || length < 20 || memcmp(tag, "XYZ ", 4) != 0)
      return false;
    for (int k = 0; k < 3; k++)
      d50[3 * k + c] = load_fixed(tag + 8 + 4 * k);
  }
  return true;
}

void pags_colour_set_icc(pags_colour *out, const uint8_t *profile, size_t size) {
  static const char *const curves[] = {"rTRC", "gTRC", "bTRC"};
  char name[PAGS_IMAGE_NAME];
  double d50[9];
  size_t length;
  memset(out, 0, sizeof *out);
  if (size < 132 || memcmp(profile + 36, "acsp", 4) != 0 || pags_load_big(profile, 4) > size) {
    pags_colour_set_unknown(out, "a damaged ICC profile");
    return;
  }
  read_name(profile, size, name);
  const uint8_t *const code = find_tag(profile, size, "cicp", &length);
  if (code && length >= 12 && (code[9] == 16 || code[9] == 18)) {
    pags_colour_set_cicp(out, code[8], code[9], true);
    return;
  }
  const bool grey = memcmp(profile + 16, "GRAY", 4) == 0;
  bool known = memcmp(profile + 20, "XYZ ", 4) == 0 &&
               (grey || (memcmp(profile + 16, "RGB ", 4) == 0 && read_matrix(profile, size, d50)));
  if (grey)
    known = known && d50_from_primaries(bt709, d50);
  for (int c = 0; c < 3 && known; c++) {
    const uint8_t *const tag = find_tag(profile, size, grey ? "kTRC" : curves[c], &length);
    known = tag && read_curve(tag, length, out->light[c]);
  }
  out->encoded = true;
  if (known)
    finish(out, d50, name);
  else if (memcmp(profile + 16, "RGB ", 4) != 0 || !strstr(name, "sRGB")) /* tables of sRGB are sRGB */
    pags_colour_set_unknown(out, name);
}

/* ---- Conversion ---- */

pags_result pags_colour_refuse(const char *path, const char *space) {
  return pags_fail(PAGS_ERROR_FORMAT,
                   "%s: its colours are in a space that is not converted here (%s); expected sRGB, or a profile of "
                   "primaries and curves. Convert it first: magick IN -profile sRGB.icc OUT.png; for HDR, ffmpeg -i IN "
                   "-vf zscale=t=linear:npl=203,format=gbrpf32le,zscale=p=bt709,tonemap=mobius,"
                   "zscale=t=iec61966-2-1,format=rgb24 OUT.png",
                   path, space);
}

/* limit[k]: the smallest linear light whose display value rounds to k + 1 of 255. */
static uint8_t encode(const float limit[255], float light) {
  int low = 0, high = 255;
  while (low < high) { /* the number of limits that the light reaches; NaN reaches none */
    const int middle = (low + high) / 2;
    if (light >= limit[middle])
      low = middle + 1;
    else
      high = middle;
  }
  return (uint8_t)low;
}

/* Applies the matrix to a colour. */
static void mix(const pags_colour *colour, const float from[3], float to[3]) {
  for (int i = 0; i < 3; i++)
    to[i] = pags_dot3f(colour->matrix + 3 * i, from);
}

/* Converts linear light; alpha, by which it is multiplied, becomes straight. */
static void convert_light(const pags_colour *colour, const pags_image *image, const float limit[255], uint8_t *to) {
  const size_t pixels = (size_t)image->width * (size_t)image->height, channels = (size_t)image->channels;
  const float *from = image->data;
  for (size_t i = 0; i < pixels; i++, from += channels, to += channels) {
    const float alpha = channels == 4 ? (from[3] > 0 ? (from[3] < 1 ? from[3] : 1) : 0) : 1;
    float light[3];
    for (size_t c = 0; c < 3; c++)
      light[c] = alpha > 0 ? from[c] / alpha : from[c];
    if (colour->kind == PAGS_COLOUR_OTHER)
      mix(colour, (const float[3]){light[0], light[1], light[2]}, light);
    for (size_t c = 0; c < 3; c++)
      to[c] = encode(limit, light[c]);
    if (channels == 4)
      to[3] = (uint8_t)(alpha * 255 + 0.5f);
  }
}

/* Converts samples of U16, which have the curves of `colour`. The tables give the light of a sample and the display
 * value of light in steps of 1/65535, which is within 0.03 of a level. */
static pags_result convert_encoded(const pags_colour *colour, const pags_image *image, const float limit[255],
                                   uint8_t *to) {
  enum { VALUES = 65536 };
  const size_t pixels = (size_t)image->width * (size_t)image->height, channels = (size_t)image->channels;
  PAGS_AUTOFREE float *light = malloc(3 * VALUES * sizeof *light);
  PAGS_AUTOFREE uint8_t *display = malloc(VALUES);
  PAGS_CHECK_MEMORY(light && display, "the colours of a picture");
  for (size_t v = 0; v < VALUES; v++) {
    display[v] = encode(limit, (float)v / (VALUES - 1));
    for (int c = 0; c < 3; c++)
      light[(size_t)c * VALUES + v] = (float)light_at(colour, c, (double)v / (VALUES - 1));
  }
  const uint16_t *from = image->data;
  for (size_t i = 0; i < pixels; i++, from += channels, to += channels) {
    float mixed[3];
    mix(colour, (const float[3]){light[from[0]], light[VALUES + from[1]], light[2 * VALUES + from[2]]}, mixed);
    for (size_t c = 0; c < 3; c++) {
      const float clamped = mixed[c] > 0 ? (mixed[c] < 1 ? mixed[c] : 1) : 0;
      to[c] = display[(size_t)(clamped * (VALUES - 1) + 0.5f)];
    }
    if (channels == 4)
      to[3] = (uint8_t)((from[3] + 128) / 257);
  }
  return PAGS_OK;
}

pags_result pags_colour_convert(const pags_colour *colour, const char *path, pags_image *image) {
  const bool light = image->sample == PAGS_F32 && !colour->encoded;
  if (colour->kind == PAGS_COLOUR_UNKNOWN)
    return pags_colour_refuse(path, colour->name);
  if (!light && colour->kind == PAGS_COLOUR_SRGB)
    return pags_image_convert(image, PAGS_U8, image->channels);
  if (!light)
    PAGS_TRY(pags_image_convert(image, PAGS_U16, image->channels));
  float limit[255];
  for (int k = 0; k < 255; k++)
    limit[k] = (float)light_of_srgb((k + 0.5) / 255);
  PAGS_AUTO(pags_image_destroy) pags_image out = {0};
  PAGS_TRY(pags_image_create(&out, image->width, image->height, image->channels, PAGS_U8));
  if (light)
    convert_light(colour, image, limit, out.data);
  else
    PAGS_TRY(convert_encoded(colour, image, limit, out.data));
  pags_image_move(&out, image);
  return PAGS_OK;
}
