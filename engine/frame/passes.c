/* SPDX-License-Identifier: Apache-2.0 */
/* Cryptomattes (Friedman and Jones 2015), expected normals, motion vectors and counts of pairs of the last picture
 * (pags/passes.h).
 *
 * A second walk through each tile's list finds the weights w = alpha T of its splats, a run of entries at a time, and
 * adds them up: for each name in the tile in a plane of its own, from which each pixel then takes the largest sums; for
 * normals and motion as they are. A tile is one worker's, and its sums go in the list's order. */
#include <assert.h>
#include <math.h>
#include <pags/passes.h>
#include <string.h>

#include "base/vec3.h"
#include "frame/stages.h"

enum { RUN = 32, PIXELS = PAGS_TILE_PIXELS, MOTIONS = 4 };
/* Where the planes of each pass begin, in the order of pags_passes. */
enum {
  NORMAL_PLANE = 2 * PAGS_MATTE_PLANES,
  MOTION_PLANE = NORMAL_PLANE + 3,
  PAIR_PLANE = MOTION_PLANE + MOTIONS,
  PASS_PLANES = PAIR_PLANE + 2
};

/* Where pixel (px, py) of this picture lies in another one, for a point at depth z:
 *   (X, Y, Z) = at (px, py, 1) + shift / z,   x = X / Z, y = Y / Z */
typedef struct carrier {
  float at[9], shift[3];
  bool still; /* x = px and y = py, exactly */
} carrier;

typedef struct pass_scratch { /* of a worker; the arrays over names are those of one tile */
  float weights[RUN * PIXELS] __attribute__((aligned(64)));
  float transmittance[PIXELS] __attribute__((aligned(64)));
  float normal[3][PIXELS], weight[PIXELS], motion[MOTIONS][PIXELS], pairs[2][PIXELS];
  uint16_t blended[RUN];
  struct tile_matte {
    int32_t *slot; /* per name: its plane in `sums`; -1: none */
    int32_t *used; /* names that have a plane */
    float *sums;   /* planes of PIXELS floats */
    int32_t used_count;
  } matte[2];
} pass_scratch;

typedef struct pass_context {
  pags_frame *frame;
  const pags_pass_request *request;
  const int32_t *part_of;     /* per 16 dense indices: their part */
  float *normals;             /* [dense_count][3], of the splats that are drawn; NULL: not wanted */
  carrier *carriers[2];       /* per part, then one for what is infinitely far; before, after. NULL: no motion */
  float *planes[PASS_PLANES]; /* the results, in the order of pags_passes; NULL: not wanted */
  pass_scratch *scratch;
} pass_context;

/* ---- Normals of Gaussians ---- */

/* Block function: the normals of the drawn Gaussians of clusters [begin, end) in world axes, facing the camera. They
 * are taken to the world by the transpose of the inverse of the part's pose, by which a disc's normal stays one where
 * the pose stretches. */
static void find_normals(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const pass_context *const c = context;
  const pags_frame *const f = c->frame;
  for (int64_t i = begin; i < end; i++) {
    const view_cluster *const v = f->clusters + i;
    const float *const eye = f->projections[v->part].eye;
    row_scratch scratch;
    int64_t stride;
    const float *const rows = pags_frame_geometry(f->parts + v->part, v, &scratch, &stride);
    double m[12]; /* model from world */
    pags_affine_inverse(f->parts[v->part].world_from_model, m);
    for (int row = 0; row < v->count; row++) {
      if (f->keys[v->base + row] == UINT32_MAX)
        continue;
      double n[3], mapped[3], away = 0.0;
      pags_gaussian_normal(rows, stride, row, n);
      for (int k = 0; k < 3; k++) {
        away += n[k] * ((double)rows[(PAGS_MEAN + k) * stride + row] - (double)eye[k]);
        mapped[k] = m[k] * n[0] + m[4 + k] * n[1] + m[8 + k] * n[2];
      }
      const double length = pags_length3(mapped);
      for (int k = 0; k < 3; k++)
        c->normals[3 * (v->base + row) + k] = (float)((away > 0.0 ? -1.0 : 1.0) * mapped[k] / length);
    }
  }
}

/* ---- Motion of parts ---- */

/* The carrier of points that `then_from_now` takes from this camera's axes to those of another camera. */
static carrier make_carrier(const pags_camera *now, const pags_camera *then, const double then_from_now[12]) {
  carrier c = {.still = false};
  const double focal[3] = {then->fx, then->fy, 1.0}, centre[3] = {then->cx, then->cy, 0.0};
  double rows[3][4]; /* K' [A | b], K' the other camera's matrix */
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 4; k++)
      rows[i][k] = focal[i] * then_from_now[4 * i + k] + centre[i] * then_from_now[8 + k];
  for (int i = 0; i < 3; i++) {
    const double x = rows[i][0] / now->fx, y = rows[i][1] / now->fy;
    c.at[3 * i] = (float)x;
    c.at[3 * i + 1] = (float)y;
    c.at[3 * i + 2] = (float)(rows[i][2] - x * now->cx - y * now->cy);
    c.shift[i] = (float)rows[i][3];
  }
  return c;
}

/* The pose at the moment of the frame's part p: that of the k-th part with its Gaussians, where p is the k-th in the
 * frame; its own if it has no counterpart. */
static const double *pose_then(const pags_frame *f, const pags_moment *moment, int p) {
  int before = 0;
  for (int k = 0; k < p; k++)
    before += f->parts[k].gaussians == f->parts[p].gaussians;
  for (int k = 0; k < moment->part_count; k++)
    if (moment->parts[k].gaussians == f->parts[p].gaussians && before-- == 0)
      return moment->parts[k].world_from_model;
  return f->parts[p].world_from_model;
}

static void fill_carriers(const pags_frame *f, const pags_moment *moment, carrier *out) {
  if (!moment) {
    for (int p = 0; p <= f->part_count; p++)
      out[p] = (carrier){.still = true};
    return;
  }
  double now[12], then[12], then_from_world[12];
  memcpy(now, f->camera.world_from_camera, sizeof now);
  memcpy(then, moment->camera.world_from_camera, sizeof then);
  pags_pose_subtract(now, f->options.origin);
  pags_pose_subtract(then, f->options.origin);
  pags_rigid_inverse(then, then_from_world);
  const pags_camera *const a = &f->camera, *const b = &moment->camera;
  const bool rests =
      a->fx == b->fx && a->fy == b->fy && a->cx == b->cx && a->cy == b->cy && memcmp(now, then, sizeof now) == 0;
  for (int p = 0; p < f->part_count; p++) {
    const double *const pose = pose_then(f, moment, p), *const own = f->parts[p].world_from_model;
    double model_from_world[12], carried[12], moved[12];
    pags_affine_inverse(own, model_from_world);
    pags_rigid_multiply(model_from_world, now, carried); /* model from camera */
    pags_rigid_multiply(pose, carried, moved);           /* world then, from camera */
    pags_rigid_multiply(then_from_world, moved, carried);
    out[p] = make_carrier(a, b, carried);
    out[p].still = rests && memcmp(pose, own, 12 * sizeof *pose) == 0;
  }
  double turn[12];
  pags_rigid_multiply(then_from_world, now, turn);
  turn[3] = turn[7] = turn[11] = 0.0;
  out[f->part_count] = make_carrier(a, b, turn);
  out[f->part_count].still = rests;
}

/* Adds to x and y the motion from 16 pixels at (px, py) to where a point at 1 / `inverse_depth` lies in the other
 * picture, times `sign` and the weights; y goes upwards. */
static void add_motion(const carrier *c, const float px[16], const float py[16], float inverse_depth, float sign,
                       const float weights[16], float x[16], float y[16]) {
  if (c->still)
    return;
  const float shift[3] = {c->shift[0] * inverse_depth, c->shift[1] * inverse_depth, c->shift[2] * inverse_depth};
  for (int k = 0; k < 16; k++) {
    const float bx = c->at[0] * px[k] + c->at[1] * py[k] + c->at[2] + shift[0];
    const float by = c->at[3] * px[k] + c->at[4] * py[k] + c->at[5] + shift[1];
    const float bz = c->at[6] * px[k] + c->at[7] * py[k] + c->at[8] + shift[2];
    const bool ahead = bz > 1e-6f;
    const float w = ahead ? sign * weights[k] : 0.0f, scale = 1.0f / (ahead ? bz : 1.0f);
    x[k] += w * (bx * scale - px[k]);
    y[k] -= w * (by * scale - py[k]);
  }
}

/* ---- One tile ---- */

static void block_centres(int x0, int y0, int block, float px[16], float py[16]) {
  for (int k = 0; k < 16; k++) {
    px[k] = (float)(x0 + 4 * (block & 3) + (k & 3)) + 0.5f;
    py[k] = (float)(y0 + 4 * (block >> 2) + (k >> 2)) + 0.5f;
  }
}

/* Adds what one entry of the list, with weights[PIXELS], is worth. */
static void add_entry(const pass_context *c, pass_scratch *s, const float *weights, unsigned blended, uint32_t splat,
                      int x0, int y0) {
  const int32_t part = c->part_of[splat / 16];
  const float z = c->frame->splats[splat].z;
  float *sums[2] = {NULL, NULL}; /* of the part's name in this tile */
  for (int m = 0; m < 2; m++) {
    const int32_t name = c->request->matte[m] && blended ? c->request->matte[m]->name_of_part[part] : -1;
    if (name < 0)
      continue;
    struct tile_matte *const matte = &s->matte[m];
    const bool first = matte->slot[name] < 0;
    if (first) {
      matte->slot[name] = matte->used_count;
      matte->used[matte->used_count++] = name;
    }
    sums[m] = matte->sums + (int64_t)matte->slot[name] * PIXELS;
    if (first)
      memset(sums[m], 0, PIXELS * sizeof *sums[m]);
  }
  for (; blended; blended &= blended - 1) {
    const int b = __builtin_ctz(blended), at = 16 * b;
    const float *const w = weights + at;
    for (int m = 0; m < 2; m++)
      for (int k = 0; k < 16 && sums[m]; k++)
        sums[m][at + k] += w[k];
    if (c->normals)
      for (int k = 0; k < 16; k++) {
        s->weight[at + k] += w[k];
        for (int axis = 0; axis < 3; axis++)
          s->normal[axis][at + k] += w[k] * c->normals[3 * (int64_t)splat + axis];
      }
    if (c->carriers[0]) {
      float px[16], py[16];
      block_centres(x0, y0, b, px, py);
      add_motion(c->carriers[0] + part, px, py, 1.0f / z, 1.0f, w, s->motion[0] + at, s->motion[1] + at);
      add_motion(c->carriers[1] + part, px, py, 1.0f / z, -1.0f, w, s->motion[2] + at, s->motion[3] + at);
    }
  }
}

/* Writes a tile's plane of sums, which is in the order of blocks, to the picture's plane at the tile's first pixel. */
static void put_plane(const float *sums, float *plane, int64_t stride) {
  for (int i = 0; i < PIXELS; i++)
    plane[(4 * (i >> 6) + (i >> 2 & 3)) * stride + 4 * (i >> 4 & 3) + (i & 3)] = sums[i];
}

/* Finds the largest sums of each pixel and writes values and sums to the matte's planes. Names are looked at in
 * ascending order, so that the smaller of two with equal sums comes first. */
static void put_matte(const pass_context *c, pass_scratch *s, int m, int64_t at) {
  struct tile_matte *const matte = &s->matte[m];
  const int32_t count = matte->used_count;
  int32_t *const used = matte->used;
  for (int32_t i = 1; i < count; i++) { /* sorted by insertion: a tile shows few names */
    const int32_t name = used[i];
    int32_t k = i;
    for (; k > 0 && used[k - 1] > name; k--)
      used[k] = used[k - 1];
    used[k] = name;
  }
  float best[PAGS_MATTE_PLANES][PIXELS];
  memset(best, 0, sizeof best);
  for (int32_t i = 0; i < count; i++) {
    const float *const sums = matte->sums + (int64_t)matte->slot[used[i]] * PIXELS;
    for (int p = 0; p < PIXELS; p++) {
      int rank = PAGS_MATTE_RANKS;
      while (rank > 0 && sums[p] > best[2 * rank - 1][p])
        rank--;
      if (rank == PAGS_MATTE_RANKS)
        continue;
      for (int k = PAGS_MATTE_RANKS - 1; k > rank; k--) {
        best[2 * k][p] = best[2 * k - 2][p];
        best[2 * k + 1][p] = best[2 * k - 1][p];
      }
      best[2 * rank][p] = c->request->matte[m]->values[used[i]];
      best[2 * rank + 1][p] = sums[p];
    }
  }
  for (int k = 0; k < PAGS_MATTE_PLANES; k++)
    put_plane(best[k], c->planes[m * PAGS_MATTE_PLANES + k] + at, c->frame->stride);
  for (int32_t i = 0; i < count; i++)
    matte->slot[used[i]] = -1;
  matte->used_count = 0;
}

/* Adds the motion of what is infinitely far, by the transmittance that is left. */
static void add_far_motion(const pass_context *c, pass_scratch *s, int x0, int y0) {
  const pags_frame *const f = c->frame;
  const float *const left = frame_plane(f, PLANE_T) + (int64_t)y0 * f->stride + x0;
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
    float px[16], py[16], w[16];
    block_centres(x0, y0, b, px, py);
    for (int k = 0; k < 16; k++)
      w[k] = left[(int64_t)(4 * (b >> 2) + (k >> 2)) * f->stride + 4 * (b & 3) + (k & 3)];
    for (int side = 0; side < 2; side++)
      add_motion(c->carriers[side] + f->part_count, px, py, 0.0f, side ? -1.0f : 1.0f, w, s->motion[2 * side] + 16 * b,
                 s->motion[2 * side + 1] + 16 * b);
  }
}

static void pass_tile(const pass_context *c, int64_t tile, pass_scratch *s) {
  const pags_frame *const f = c->frame;
  const int x0 = frame_tile_x(f, tile), y0 = frame_tile_y(f, tile);
  const int64_t start = f->tile_start[tile], end = f->tile_start[tile + 1], at = frame_tile_offset(f, tile);
  memset(s->normal, 0, sizeof s->normal);
  memset(s->weight, 0, sizeof s->weight);
  memset(s->motion, 0, sizeof s->motion);
  memset(s->pairs, 0, sizeof s->pairs);
  for (int64_t run = start; run < end; run += RUN) {
    const int64_t count = end - run < RUN ? end - run : RUN;
    const pags_raster_weights in = {.splats = f->splats,
                                    .entries = f->entries + run,
                                    .block_masks = f->block_masks + run,
                                    .count = count,
                                    .x0 = x0,
                                    .y0 = y0,
                                    .width = f->camera.width,
                                    .height = f->camera.height,
                                    .exp_degree = f->options.exp_degree,
                                    .first = run == start,
                                    .transmittance = s->transmittance,
                                    .weights = s->weights,
                                    .blended = s->blended};
    f->kernels->raster_weights(&in);
    for (int64_t k = 0; k < count; k++)
      add_entry(c, s, s->weights + k * PIXELS, s->blended[k], f->entries[run + k].splat, x0, y0);
    for (int64_t k = 0; k < count && c->request->pairs; k++)
      for (unsigned computed = in.block_masks[k]; computed; computed &= computed - 1) {
        const int b = __builtin_ctz(computed);
        for (int i = 16 * b; i < 16 * b + 16; i++) { /* blended where it has a weight */
          s->pairs[0][i] += (s->blended[k] >> b & 1) && s->weights[k * PIXELS + i] > 0.0f ? 1.0f : 0.0f;
          s->pairs[1][i] += 1.0f;
        }
      }
  }
  for (int m = 0; m < 2; m++)
    if (c->request->matte[m])
      put_matte(c, s, m, at);
  for (int axis = 0; axis < 3 && c->normals; axis++) {
    for (int i = 0; i < PIXELS; i++)
      s->normal[axis][i] = s->weight[i] > 0.0f ? s->normal[axis][i] / s->weight[i] : 0.0f;
    put_plane(s->normal[axis], c->planes[NORMAL_PLANE + axis] + at, f->stride);
  }
  if (c->carriers[0])
    add_far_motion(c, s, x0, y0);
  for (int k = 0; k < MOTIONS && c->carriers[0]; k++)
    put_plane(s->motion[k], c->planes[MOTION_PLANE + k] + at, f->stride);
  for (int k = 0; k < 2 && c->request->pairs; k++)
    put_plane(s->pairs[k], c->planes[PAIR_PLANE + k] + at, f->stride);
}

static void pass_tiles(void *context, int64_t begin, int64_t end, int worker) {
  const pass_context *const c = context;
  for (int64_t tile = begin; tile < end; tile++)
    pass_tile(c, tile, c->scratch + worker);
}

/* ---- Memory ---- */

static pags_result reserve(pass_context *c, int32_t **part_of) {
  pags_frame *const f = c->frame;
  const int workers = pags_tasks_workers(f->tasks);
  PAGS_TRY(pags_frame_alloc(f, &c->scratch, workers, sizeof *c->scratch, "pass sums"));
  PAGS_TRY(pags_frame_alloc(f, part_of, f->dense_count / 16, sizeof **part_of, "drawn parts"));
  if (c->request->normal)
    PAGS_TRY(pags_frame_alloc(f, &c->normals, 3 * f->dense_count, sizeof *c->normals, "normals of Gaussians"));
  for (int side = 0; side < 2 && c->request->motion; side++)
    PAGS_TRY(pags_frame_alloc(f, &c->carriers[side], f->part_count + 1, sizeof *c->carriers[side], "motions"));
  for (int k = 0; k < PASS_PLANES; k++)
    if (k < NORMAL_PLANE   ? c->request->matte[k / PAGS_MATTE_PLANES] != NULL
        : k < MOTION_PLANE ? c->request->normal != 0
        : k < PAIR_PLANE   ? c->request->motion != 0
                           : c->request->pairs != 0)
      PAGS_TRY(pags_frame_alloc(f, &c->planes[k], f->plane_size, sizeof *c->planes[k], "planes of passes"));
  for (int i = 0; i < 2 * workers; i++) {
    struct tile_matte *const matte = &c->scratch[i / 2].matte[i % 2];
    const int64_t names = c->request->matte[i % 2] ? c->request->matte[i % 2]->name_count : 0;
    matte->used_count = 0;
    if (names == 0)
      continue;
    PAGS_TRY(pags_frame_alloc(f, &matte->slot, names, sizeof *matte->slot, "names of a tile"));
    PAGS_TRY(pags_frame_alloc(f, &matte->used, names, sizeof *matte->used, "names of a tile"));
    PAGS_TRY(pags_frame_alloc(f, &matte->sums, names * PIXELS, sizeof *matte->sums, "names of a tile"));
    memset(matte->slot, 0xFF, (size_t)names * sizeof *matte->slot); /* -1 */
  }
  return PAGS_OK;
}

pags_result pags_frame_passes(pags_frame *frame, const pags_pass_request *request, pags_passes *out) {
  assert(frame->rendered && frame->options.keep_for_passes);
  pass_context c = {.frame = frame, .request = request};
  int32_t *part_of;
  *out = (pags_passes){0};
  if (frame->lens && request->motion)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "motion vectors are those of a pinhole; this camera has a lens");
  PAGS_TRY(reserve(&c, &part_of));
  for (int64_t i = 0; i < frame->cluster_count; i++)
    for (int64_t k = 0; k < frame->clusters[i].count; k += 16)
      part_of[(frame->clusters[i].base + k) / 16] = frame->clusters[i].part;
  c.part_of = part_of;
  if (c.normals)
    PAGS_TRY(pags_frame_for(frame, frame->cluster_count, 8, find_normals, &c));
  if (c.carriers[0]) {
    fill_carriers(frame, request->before, c.carriers[0]);
    fill_carriers(frame, request->after, c.carriers[1]);
  }
  PAGS_TRY(pags_frame_for(frame, (int64_t)frame->tiles_x * frame->tiles_y, 1, pass_tiles, &c));
  for (int k = 0; k < PAGS_MATTE_PLANES; k++)
    for (int m = 0; m < 2; m++)
      out->matte[m][k] = c.planes[m * PAGS_MATTE_PLANES + k];
  for (int k = 0; k < 3; k++)
    out->normal[k] = c.planes[NORMAL_PLANE + k];
  for (int k = 0; k < MOTIONS; k++)
    out->motion[k] = c.planes[MOTION_PLANE + k];
  for (int k = 0; k < 2; k++)
    out->pairs[k] = c.planes[PAIR_PLANE + k];
  return PAGS_OK;
}
