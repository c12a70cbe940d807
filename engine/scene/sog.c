/* SPDX-License-Identifier: Apache-2.0 */
/* Decodes PlayCanvas's SOG, versions 1 and 2 (developer.playcanvas.com, "The SOG Format"): a meta.json and lossless
 * WebP pictures whose pixels, row by row, are the Gaussians' quantised values. They lie in a folder or in a zip
 * archive.
 *
 * means    two pictures, low and high bytes of 16 bits a coordinate, linear in sign(x) ln(1 + |x|)
 * scales   a byte for each ln sigma
 * quats    "smallest three": R, G, B over -1..1 times sqrt 1/2; A - 252 is the component that was left out
 * sh0      a byte for each constant colour term, and the opacity in A
 * shN      16 bits that choose an entry of a palette, whose picture has 64 entries a row, a pixel for each term
 *
 * A byte of scales, sh0 and shN is an index of a codebook (version 2), or linear between two bounds (version 1). The
 * axes are those of PLY files. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/json.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "base/zip.h"
#include "maths/maths.h"
#include "scene/axes.h"
#include "scene/splat_formats.h"
#include "scene/webp.h"

enum { PALETTE_ROW = 64, MOST_NAME = 300, MOST_SHOWN = 1000 };

/* Where the files lie. */
typedef struct sog_source {
  const char *path;   /* of the archive or meta.json, for messages */
  const char *folder; /* of the files; NULL: in the archive */
  const pags_zip *zip;
  char inner[MOST_NAME]; /* folder in the archive, with its slash; "" */
} sog_source;

/* How the bytes of one attribute become values. */
typedef struct sog_scale {
  int size;           /* of the codebook; 0: linear */
  float book[4][256]; /* values of each channel; a codebook is the same in all */
} sog_scale;

typedef struct sog_file {
  sog_source source;
  pags_json *json;
  int version, sh_degree;
  int64_t count, palette; /* Gaussians; entries of the palette */
  double mins[3], maxs[3];
  sog_scale scales, sh0, shn;
  pags_splat_facts *facts; /* while it is decoded, the origin is without what was taken off */
  pags_tally lossy;        /* pictures that are not lossless */
} sog_file;

/* ---- meta.json ---- */

static pags_result member(const sog_file *f, const char *name, const pags_json_value **out) {
  return pags_json_object(f->json, pags_json_root(f->json), name, out);
}

/* Reads an array of 1 to `most` numbers; *count: their number. The first of a codebook may be null, as splat-transform
 * wrote it for a time: it continues the others. */
static pags_result read_numbers(const sog_file *f, const pags_json_value *object, const char *key, int most,
                                double *out, int *count) {
  const pags_json_value *array;
  PAGS_TRY(pags_json_array(f->json, object, key, &array));
  *count = (int)(array->count < most + 1 ? array->count : most + 1);
  if (*count < 1 || *count > most)
    return pags_json_fail(f->json, array, "expected 1 to %d numbers for '%s', found %lld", most, key,
                          (long long)array->count);
  int i = 0;
  bool first_missing = false;
  for (const pags_json_value *v = array->first; v; v = v->next, i++) {
    if (i == 0 && v->type == PAGS_JSON_NULL && *count > 2)
      first_missing = true;
    else
      PAGS_TRY(pags_json_as_number(f->json, v, key, &out[i]));
    if (!(i == 0 && first_missing) && !(fabs(out[i]) < 3.5e38)) /* of a float's range */
      return pags_json_fail(f->json, v, "expected a number within 3.5e38 of zero for '%s', found %g", key, out[i]);
  }
  if (first_missing) {
    out[0] = out[1] + (out[1] - out[*count - 1]) / (*count - 1);
    PAGS_WARN("%s: line %d: the first number of '%s' is null; taken as %g, by the others", f->source.path, array->line,
              key, out[0]);
  }
  return PAGS_OK;
}

/* Reads how the bytes of an attribute of `channels` channels become values. The bounds of version 1 may be one number
 * for all channels. */
static pags_result read_scale(const sog_file *f, const pags_json_value *object, int channels, sog_scale *out) {
  double low[256], high[256];
  int lows, highs;
  if (f->version == 2) {
    PAGS_TRY(read_numbers(f, object, "codebook", 256, low, &out->size));
    for (int i = 0; i < out->size; i++)
      for (int c = 0; c < 4; c++)
        out->book[c][i] = (float)low[i];
    return PAGS_OK;
  }
  const pags_json_value *mins = pags_json_member(object, "mins");
  if (mins && mins->type == PAGS_JSON_NUMBER) {
    PAGS_TRY(pags_json_number(f->json, object, "mins", &low[0]));
    PAGS_TRY(pags_json_number(f->json, object, "maxs", &high[0]));
    lows = highs = 1;
  } else {
    PAGS_TRY(read_numbers(f, object, "mins", 4, low, &lows));
    PAGS_TRY(read_numbers(f, object, "maxs", 4, high, &highs));
  }
  if (lows != highs || (lows != 1 && lows != channels))
    return pags_json_fail(f->json, object, "expected %d numbers for 'mins' and 'maxs', found %d and %d", channels, lows,
                          highs);
  for (int c = 0; c < channels; c++) {
    const double from = low[lows == 1 ? 0 : c], to = high[lows == 1 ? 0 : c];
    for (int i = 0; i < 256; i++)
      out->book[c][i] = (float)(from + (to - from) * i / 255);
  }
  return PAGS_OK;
}

/* Reads the count of Gaussians: a member of version 2, the first number of a shape in version 1. */
static pags_result read_count(sog_file *f, const pags_json_value *means) {
  const pags_json_value *root = pags_json_root(f->json), *shape;
  if (f->version == 2)
    return pags_json_integer(f->json, root, "count", 1, INT32_MAX, &f->count);
  PAGS_TRY(pags_json_array(f->json, means, "shape", &shape));
  double count = 0;
  if (shape->first)
    PAGS_TRY(pags_json_as_number(f->json, shape->first, "shape", &count));
  if (!(count >= 1 && count <= INT32_MAX && floor(count) == count))
    return pags_json_fail(f->json, shape, "expected the number of Gaussians first in 'shape', found %g", count);
  f->count = (int64_t)count;
  return PAGS_OK;
}

/* What a scene of version 2 was trained for: `model` (splat-transform from 3.2 on) or `antialias`. */
static pags_result read_model(sog_file *f) {
  const pags_json_value *root = pags_json_root(f->json);
  const char *model;
  bool antialias;
  PAGS_TRY(pags_json_bool_or(f->json, root, "antialias", false, &antialias));
  PAGS_TRY(pags_json_string_or(f->json, root, "model", "default", &model));
  f->facts->antialiased = antialias || strcmp(model, "antialiased") == 0;
  if (strcmp(model, "2dgs") == 0)
    PAGS_WARN("%s: 'model' is 2dgs: flat discs, which PAGS draws as thin ellipsoids", f->source.path);
  else if (strcmp(model, "default") != 0 && strcmp(model, "antialiased") != 0)
    PAGS_WARN("%s: 'model' is '%.40s', which PAGS doesn't know; taken as the default", f->source.path, model);
  return PAGS_OK;
}

/* Reads the metadata that PAGS writes: origin and up axis. */
static pags_result read_asset(sog_file *f) {
  const pags_json_value *asset = pags_json_member(pags_json_root(f->json), "asset");
  const char *generator, *up;
  if (!asset || asset->type != PAGS_JSON_OBJECT)
    return PAGS_OK;
  PAGS_TRY(pags_json_string_or(f->json, asset, "generator", "", &generator));
  if (strncmp(generator, "pags ", 5) != 0)
    return PAGS_OK;
  PAGS_TRY(pags_json_string_or(f->json, asset, "up", "", &up));
  pags_up_from_code(up, &f->facts->up); /* of another name it stays unknown */
  return pags_json_member(asset, "origin") ? pags_json_numbers(f->json, asset, "origin", 3, f->facts->origin) : PAGS_OK;
}

static pags_result read_meta(sog_file *f) {
  const pags_json_value *root = pags_json_root(f->json), *means, *scales, *sh0, *shn = pags_json_member(root, "shN");
  int64_t version;
  int lows, highs;
  PAGS_TRY(pags_json_as_object(f->json, root, "a SOG's meta.json"));
  PAGS_TRY(pags_json_integer_or(f->json, root, "version", 1, 1000, 1, &version));
  f->version = (int)version;
  if (version > 2)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: SOG version %lld; versions 1 and 2 can be read", f->source.path,
                     (long long)version);
  PAGS_TRY(member(f, "means", &means));
  PAGS_TRY(member(f, "scales", &scales));
  PAGS_TRY(member(f, "sh0", &sh0));
  PAGS_TRY(read_count(f, means));
  PAGS_TRY(read_numbers(f, means, "mins", 3, f->mins, &lows));
  PAGS_TRY(read_numbers(f, means, "maxs", 3, f->maxs, &highs));
  for (int k = 0; k < 3; k++)
    if (lows != 3 || highs != 3 || !(fabs(f->mins[k]) <= 89 && fabs(f->maxs[k]) <= 89))
      return pags_json_fail(f->json, means, "expected 3 logarithms within -89 and 89 each for 'mins' and 'maxs'");
  PAGS_TRY(read_scale(f, scales, 3, &f->scales));
  PAGS_TRY(read_scale(f, sh0, f->version == 2 ? 3 : 4, &f->sh0));
  PAGS_TRY(read_model(f));
  PAGS_TRY(read_asset(f));
  if (!shn || shn->type == PAGS_JSON_NULL)
    return PAGS_OK;
  PAGS_TRY(read_scale(f, shn, 3, &f->shn));
  if (f->version == 2) {
    int64_t bands;
    PAGS_TRY(pags_json_integer(f->json, shn, "bands", 0, 3, &bands));
    PAGS_TRY(pags_json_integer(f->json, shn, "count", 1, 65536, &f->palette));
    f->sh_degree = (int)bands;
  } else
    f->sh_degree = -1; /* follows from the size of the palette's picture */
  return PAGS_OK;
}

/* ---- Pictures ---- */

/* Reads the file `name`: *bytes is freed by the caller. */
static pags_result fetch(const sog_source *s, const char *name, char shown[MOST_SHOWN], uint8_t **bytes, size_t *size) {
  snprintf(shown, MOST_SHOWN, "%.300s: %.299s%.299s", s->path, s->inner, name);
  if (!pags_path_is_inside(name))
    return pags_fail_at(s->path, "expected names of files in the folder of meta.json, found '%.80s'", name);
  if (s->folder) {
    PAGS_AUTOFREE char *path = pags_path_join(s->folder, name);
    PAGS_CHECK_MEMORY(path, "%s: a path", s->path);
    if (!pags_file_exists(path))
      return pags_fail(PAGS_ERROR_IO, "%s: names '%.80s', which isn't in its folder", s->path, name);
    return pags_file_read(path, bytes, size);
  }
  char full[2 * MOST_NAME];
  snprintf(full, sizeof full, "%s%.299s", s->inner, name);
  const pags_zip_member *found = pags_zip_find(s->zip, full);
  if (!found)
    return pags_fail_at(s->path, "meta.json names '%.80s', which isn't in the archive", name);
  *size = found->size;
  return pags_zip_read(s->zip, found, bytes);
}

/* Decodes picture `index` of the attribute's `files`, of `least` to `most` pixels. Low bytes of positions that take
 * less than a byte for 1,024 Gaussians are refused, so that a small file asks for no large blocks of memory; other
 * pictures may be of one colour. */
static pags_result read_picture(sog_file *f, const char *attribute, int index, int64_t least, int64_t most,
                                pags_webp *out) {
  const pags_json_value *object, *files;
  const char *name;
  char shown[MOST_SHOWN];
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size = 0;
  PAGS_TRY(member(f, attribute, &object));
  PAGS_TRY(pags_json_array(f->json, object, "files", &files));
  const pags_json_value *v = files->first;
  for (int i = 0; v && i < index; i++)
    v = v->next;
  if (!v)
    return pags_json_fail(f->json, files, "expected %d names in 'files' of '%s', found %lld", index + 1, attribute,
                          (long long)files->count);
  PAGS_TRY(pags_json_as_string(f->json, v, "files", &name));
  PAGS_TRY(fetch(&f->source, name, shown, &bytes, &size));
  if (index == 0 && strcmp(attribute, "means") == 0 && least / 1024 > (int64_t)size)
    return pags_fail_at(shown, "%zu bytes are no picture of %lld Gaussians", size, (long long)f->count);
  PAGS_TRY(pags_webp_decode(shown, bytes, size, least, most, out));
  if (out->lossy)
    pags_tally_add(&f->lossy, "%.299s", name);
  return PAGS_OK;
}

/* The same for an attribute with a pixel for each Gaussian; rows or columns may be left over. */
static pags_result read_rows(sog_file *f, const char *attribute, int index, pags_webp *out) {
  return read_picture(f, attribute, index, f->count, 4 * f->count + (1 << 16), out);
}

/* Fails if a byte of R, G or B is no index of the codebook. */
static pags_result check_indices(const sog_file *f, const char *attribute, const sog_scale *scale,
                                 const pags_webp *picture, int64_t pixels) {
  for (int64_t i = 0; scale->size && i < pixels; i++)
    for (int c = 0; c < 3; c++)
      if (picture->rgba[4 * i + c] >= scale->size)
        return pags_fail_at(f->source.path,
                            "'%s': pixel %lld: expected an index of the %d values of its codebook, found %d", attribute,
                            (long long)i, scale->size, picture->rgba[4 * i + c]);
  return PAGS_OK;
}

/* ---- Attributes ---- */

static double mean_of(const sog_file *f, const pags_webp *low, const pags_webp *high, int64_t i, int k) {
  const int fixed = low->rgba[4 * i + k] | high->rgba[4 * i + k] << 8;
  const double v = f->mins[k] + (f->maxs[k] - f->mins[k]) * fixed / 65535, size = pags_exp(fabs(v)) - 1;
  return v < 0 ? -size : size;
}

/* Far from zero, positions have more digits than a float: they get an origin, by up to 1,024 of them. */
static pags_result decode_means(sog_file *f, pags_gaussians *out) {
  enum { MOST = 1024 };
  double values[MOST];
  PAGS_AUTO(pags_webp_destroy) pags_webp low = {0}, high = {0};
  PAGS_TRY(read_rows(f, "means", 0, &low));
  PAGS_TRY(read_rows(f, "means", 1, &high));
  PAGS_TRY(pags_gaussians_create(out, f->count, f->sh_degree));
  const int count = f->count < MOST ? (int)f->count : MOST;
  for (int k = 0; k < 3; k++) {
    for (int i = 0; i < count; i++)
      values[i] = mean_of(f, &low, &high, (int64_t)((double)f->count / count * i), k);
    const double off = f->facts->taken_off[k] = pags_large_origin(values, count);
    for (int64_t i = 0; i < f->count; i++)
      pags_plane(out, PAGS_MEAN + k)[i] = (float)(mean_of(f, &low, &high, i, k) - off);
  }
  return PAGS_OK;
}

static pags_result decode_quats(sog_file *f, pags_gaussians *out) {
  PAGS_AUTO(pags_webp_destroy) pags_webp picture = {0};
  int64_t without = 0, first = 0;
  PAGS_TRY(read_rows(f, "quats", 0, &picture));
  for (int64_t i = 0; i < f->count; i++) {
    const uint8_t *pixel = picture.rgba + 4 * i;
    const int largest = pixel[3] - 252;
    double q[4] = {0};
    if (largest < 0)
      first = without++ ? first : i;
    for (int k = 0, from = 0; k < 4 && largest >= 0; k++)
      if (k != largest)
        q[k] = (pixel[from++] / 127.5 - 1) * 0.70710678118654752;
    pags_splat_put_rotation(q, largest < 0 ? 0 : largest, i, out);
  }
  if (without)
    PAGS_WARN(
        "%s: %lld of %lld quaternions don't name their largest component, the first is that of Gaussian %lld; taken as "
        "no rotation",
        f->source.path, (long long)without, (long long)f->count, (long long)first);
  return PAGS_OK;
}

/* Decodes the three bytes of each pixel of an attribute to the planes from `plane` on. */
static pags_result decode_bytes(sog_file *f, const char *attribute, const sog_scale *scale, int plane,
                                pags_gaussians *out) {
  PAGS_AUTO(pags_webp_destroy) pags_webp picture = {0};
  PAGS_TRY(read_rows(f, attribute, 0, &picture));
  PAGS_TRY(check_indices(f, attribute, scale, &picture, f->count));
  for (int64_t i = 0; i < f->count; i++) {
    const uint8_t *pixel = picture.rgba + 4 * i;
    for (int k = 0; k < 3; k++)
      pags_plane(out, plane + k)[i] = scale->book[k][pixel[k]];
    if (plane == PAGS_SH)
      pags_plane(out, PAGS_OPACITY)[i] = f->version == 2 ? pags_logit_of_byte(pixel[3]) : scale->book[3][pixel[3]];
  }
  return PAGS_OK;
}

/* Reads the palette's picture: rows of 64 entries, a pixel for each coefficient. In version 1 its size says the degree
 * and how many entries there are. */
static pags_result read_palette(sog_file *f, pags_webp *out) {
  const int64_t most = 1024 * PALETTE_ROW * 15;
  PAGS_TRY(read_picture(f, "shN", 0, 1, most, out));
  const int degree = out->width == PALETTE_ROW * 3 ? 1 : out->width == PALETTE_ROW * 8 ? 2 : 3;
  if (f->sh_degree < 0) {
    f->sh_degree = degree;
    f->palette = (int64_t)PALETTE_ROW * out->height;
  }
  const int terms = pags_sh_coefficients(f->sh_degree) - 1;
  if (out->width != PALETTE_ROW * terms)
    return pags_fail_at(f->source.path, "'shN': expected a palette %d pixels wide for degree %d, found %d x %d",
                        PALETTE_ROW * terms, f->sh_degree, out->width, out->height);
  if (f->palette > (int64_t)PALETTE_ROW * out->height)
    f->palette = (int64_t)PALETTE_ROW * out->height; /* splat-transform counts entries that it didn't need */
  return check_indices(f, "shN", &f->shn, out, f->palette * terms);
}

static pags_result decode_shn(sog_file *f, const pags_webp *palette, pags_gaussians *out) {
  const int terms = pags_sh_coefficients(f->sh_degree) - 1;
  PAGS_AUTO(pags_webp_destroy) pags_webp labels = {0};
  int64_t without = 0, first = 0;
  PAGS_TRY(read_rows(f, "shN", 1, &labels));
  for (int64_t i = 0; i < f->count; i++) {
    const int64_t label = labels.rgba[4 * i] | labels.rgba[4 * i + 1] << 8;
    if (label >= f->palette) {
      first = without++ ? first : i;
      continue; /* no colour that changes with the view */
    }
    const uint8_t *entry = palette->rgba + 4 * terms * label;
    for (int k = 0; k < terms; k++)
      for (int c = 0; c < 3; c++)
        pags_plane(out, PAGS_SH + 3 * (k + 1) + c)[i] = f->shn.book[c][entry[4 * k + c]];
  }
  if (without)
    PAGS_WARN(
        "%s: %lld of %lld Gaussians name no entry of the palette of %lld, the first is Gaussian %lld; they get no "
        "colour that changes with the view",
        f->source.path, (long long)without, (long long)f->count, (long long)f->palette, (long long)first);
  return PAGS_OK;
}

static pags_result decode_all(sog_file *f, pags_gaussians *out) {
  PAGS_AUTO(pags_webp_destroy) pags_webp palette = {0};
  PAGS_TRY(read_meta(f));
  if (f->sh_degree)
    PAGS_TRY(read_palette(f, &palette));
  PAGS_TRY(decode_means(f, out));
  PAGS_TRY(decode_quats(f, out));
  PAGS_TRY(decode_bytes(f, "scales", &f->scales, PAGS_SCALE, out));
  PAGS_TRY(decode_bytes(f, "sh0", &f->sh0, PAGS_SH, out)); /* and the opacity */
  if (f->sh_degree)
    PAGS_TRY(decode_shn(f, &palette, out));
  if (f->lossy.count)
    PAGS_WARN("%s: %lld pictures are lossy WebP, the first is %s: their values aren't exact", f->source.path,
              (long long)f->lossy.count, f->lossy.first);
  return PAGS_OK;
}

static pags_result decode(const sog_source *source, const uint8_t *meta, size_t size, pags_gaussians *out,
                          pags_splat_facts *facts) {
  PAGS_AUTOFREE sog_file *f = calloc(1, sizeof *f);
  PAGS_CHECK_MEMORY(f, "%s", source->path);
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_TRY(pags_json_parse_text(source->path, (const char *)meta, size, &json));
  f->source = *source;
  f->json = json;
  f->facts = facts;
  PAGS_TRY(decode_all(f, out));
  facts->kind = f->version == 2 ? "SOG v2" : "SOG v1";
  pags_add3(facts->origin, facts->taken_off, facts->origin);
  return PAGS_OK;
}

/* ---- Folder and archive ---- */

pags_result pags_sog_decode(const char *path, const uint8_t *meta, size_t size, pags_gaussians *out,
                            pags_splat_facts *facts) {
  PAGS_AUTOFREE char *folder = pags_path_folder(path);
  PAGS_CHECK_MEMORY(folder, "%s: a path", path);
  return decode(&(sog_source){.path = path, .folder = folder}, meta, size, out, facts);
}

/* Finds meta.json: at the top of the archive, or in the only folder that has one. */
static const pags_zip_member *find_meta(const pags_zip *zip, sog_source *source) {
  const pags_zip_member *found = pags_zip_find(zip, "meta.json");
  for (int64_t i = 0; i < zip->count && !found; i++) {
    const pags_zip_member *m = &zip->members[i];
    if (m->name_length > 10 && m->name_length < MOST_NAME &&
        memcmp(m->name + m->name_length - 10, "/meta.json", 10) == 0) {
      found = m;
      memcpy(source->inner, m->name, m->name_length - 9);
    }
  }
  return found;
}

pags_result pags_sog_decode_zip(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                                pags_splat_facts *facts) {
  PAGS_AUTO(pags_zip_close) pags_zip zip = {0};
  PAGS_AUTOFREE uint8_t *meta = NULL;
  PAGS_TRY(pags_zip_open(bytes, size, path, &zip));
  sog_source source = {.path = path, .zip = &zip};
  const pags_zip_member *found = find_meta(&zip, &source);
  if (!found)
    return pags_fail_at(
        path, "a zip archive without meta.json, so no SOG: expected a splat file; unpack other archives first");
  PAGS_TRY(pags_zip_read(&zip, found, &meta));
  return decode(&source, meta, found->size, out, facts);
}
