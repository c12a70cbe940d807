/* SPDX-License-Identifier: Apache-2.0 */
/* Frustum culling of clusters: finds the clusters that can change a pixel of the picture.
 *
 * The test is conservative, by interval arithmetic. For means in the box [x] x [y] x [z] (camera space, z cut at the
 * near plane) and sigma at most s, the per-Gaussian test of the projection kernel uses
 *   mx = fx x/z + cx       within fx [x]/[z] + cx
 *   extent_x = sqrt(reach (J0 W Sigma W' J0' + low_pass)) <= sqrt(reach_max (s^2 (fx/z)^2 (1 + tx^2) + low_pass))
 * with reach_max = log2(255 o)/k for the largest opacity o (1, or the part's largest factor) and |tx| at most its
 * clamp; likewise for y. The row norm of J W is that of J times the stretch of W, which is 1 where W is a rotation.
 * Boxes are padded for the rounding of the float transform. So a cluster that fails the test holds no Gaussian that
 * would pass the kernel's test, and the picture does not depend on how the Gaussians are grouped into clusters.
 *
 * With a rolling shutter (simd/scan.h) a mean is drawn where it is at some u in [-1, 1], at c0 + u c1 + u^2 c2. All
 * three are affine in the mean, so that over the box each coordinate of c1 and of c2 is bounded by its value in the
 * middle and the half sizes. [x], [y] and [z] are widened by |c1| + |c2|, and the velocity is at most |c1| + 2 |c2|.
 * The shear adds to a row of J at most |m'| / q times |(x, y) J|, with
 *   |m'_x| <= fx/z0 (|v_x| + |x/z| |v_z|) and at most a pixel a line,
 *   q >= max(0.1, 1 - |x m'_x| - |y m'_y|),
 * and W = r + u r1 + u^2 r2 stretches by at most what r does plus the Frobenius norms of r1 and r2. */
#include <math.h>
#include <string.h>

#include "frame/lens_view.h"
#include "maths/maths.h"

enum { RUN = 64 };                   /* clusters that one entry of pags_clusters.runs bounds */
enum { CULLED_AT_A_TIME = 2 * RUN }; /* a worker's block, of one part */

enum { SEEN = 1, SEAM };

typedef struct cull_context {
  pags_frame *frame;
  const pags_clusters *clusters;
  const pags_projection *view;
  uint8_t *seen;         /* per cluster: SEEN where it is in view */
  bool seams;            /* SEAM where it also reaches over the seam of an equirectangular picture */
  cluster_bound *bounds; /* per cluster, set for those in view; NULL: not wanted */
  float stretch;         /* by which the part's pose lengthens a sigma at most */
  float lim2_x, lim2_y;  /* 1 + tx^2 and 1 + ty^2 at the largest clamp */
  float reach_max;       /* largest squared distance at which alpha reaches 1/255, sigma^2 */
} cull_context;

/* ---- Bounds of a cluster on the screen ---- */

typedef struct interval { /* range of x or of y, px, in which a cluster's members can change pixels */
  float lo, hi;
} interval;

/* The pixels along one axis that Gaussians can change whose means lie in [lo, hi] on that axis and in [z0, z1] in
 * depth (camera space, z0 > 0), by the formulas above. */
static interval axis_reach(float lo, float hi, float z0, float z1, float focal, float centre, float sigma, float lim2,
                           float low_pass, float reach_max) {
  const float j = focal / z0;
  const float extent = 1.0001f * sqrtf(reach_max * (sigma * sigma * j * j * lim2 + low_pass)) + 1e-3f;
  /* Range of x/z for x in [lo, hi], z in [z0, z1], z0 > 0. */
  const float right = focal * (hi > 0.0f ? hi / z0 : hi / z1) + centre,
              left = focal * (lo < 0.0f ? lo / z0 : lo / z1) + centre;
  const float slack = 1e-5f * (fabsf(right) + fabsf(left)) + extent;
  return (interval){left - slack, right + slack};
}

/* Whether the interval lies outside of [0, size]. False for NaN, so that the cluster is kept. */
static bool is_outside(interval reach, float size) {
  return reach.hi <= 0.0f || reach.lo >= size;
}

/* The range [*first, *end) of 4-pixel blocks along an axis that have a pixel centre in the interval; all for NaN. */
static void reach_blocks(interval reach, float size, uint16_t *first, uint16_t *end) {
  const float blocks = ceilf(size * 0.25f);
  const float lo = floorf((reach.lo + 0.5f) * 0.25f), hi = floorf((reach.hi - 0.5f) * 0.25f) + 1.0f;
  *first = (uint16_t)(lo > 0.0f ? lo < blocks ? lo : blocks : 0.0f);
  *end = (uint16_t)(hi < blocks ? hi > 0.0f ? hi : 0.0f : blocks);
}

/* The values of an affine function over a box: middle plus or minus reach. `size` bounds its terms. */
typedef struct spread {
  float middle, reach, size;
} spread;

static spread row_spread(const float row[3], float shift, float moved, const float centre[3], const float half[3]) {
  spread s = {shift, moved, fabsf(shift) + moved};
  for (int b = 0; b < 3; b++) {
    s.middle += row[b] * centre[b];
    s.reach += fabsf(row[b]) * half[b];
    s.size += fabsf(row[b]) * (fabsf(centre[b]) + half[b]);
  }
  return s;
}

/* The largest motion and velocity of the means of a box along the camera's axes while the picture is read. */
static void motion_bound(const pags_scan *s, const float centre[3], const float half[3], float moved[3],
                         float speed[3]) {
  const float *const turn[2] = {s->r1, s->r2}, *const shift[2] = {s->t1, s->t2};
  for (int a = 0; a < 3; a++) {
    float most[2]; /* of |c1|, of |c2| */
    for (int i = 0; i < 2; i++) {
      const spread c = row_spread(turn[i] + 3 * a, shift[i][a], 0.0f, centre, half);
      most[i] = fabsf(c.middle) + c.reach + 4e-6f * c.size;
    }
    moved[a] = most[0] + most[1];
    speed[a] = most[0] + 2.0f * most[1];
  }
}

/* The most by which the pose's stretch while the picture is read exceeds its value at mid-exposure. */
static float turn_bound(const cull_context *c) {
  const pags_scan *const s = c->view->scan;
  float first = 0.0f, second = 0.0f;
  for (int k = 0; k < 9; k++) {
    first += s->r1[k] * s->r1[k];
    second += s->r2[k] * s->r2[k];
  }
  return 1.0001f + 1.0001f * (sqrtf(first) + sqrtf(second)) / c->stretch;
}

/* The factors by which the shear and the turn of a rolling shutter widen Gaussians along x and y at most; lo, hi
 * and z0: the box of their means in camera space. */
static void shear_bound(const cull_context *c, const float lo[3], const float hi[3], float z0, const float speed[3],
                        float widened[2]) {
  const pags_projection *const v = c->view;
  const float turned = turn_bound(c);
  const float x = fmaxf(fabsf(lo[0]), fabsf(hi[0])) / z0, y = fmaxf(fabsf(lo[1]), fabsf(hi[1])) / z0;
  const float across = fabsf(v->scan->x), down = fabsf(v->scan->y), most = 1.0001f * PAGS_SCAN_MOST / (across + down);
  const float drift[2] = {fminf(most, v->fx / z0 * (speed[0] + x * speed[2])),
                          fminf(most, v->fy / z0 * (speed[1] + y * speed[2]))};
  const float row[2] = {v->fx * sqrtf(c->lim2_x), v->fy * sqrtf(c->lim2_y)};
  const float q = fmaxf(PAGS_SCAN_LEAST, 1.0f - across * drift[0] - down * drift[1]);
  for (int i = 0; i < 2; i++)
    widened[i] = turned * (1.0f + drift[i] / q * (across * row[0] + down * row[1]) / row[i]);
}

/* Whether entry i of `k` lies outside of the view; if not, *bound receives the bounds of its members' depth and
 * pixels. `k` may be clusters or runs of clusters: a run's box and sigma bound those of its clusters, so a run that
 * is outside holds no cluster that would be in view. */
static bool cluster_outside(const cull_context *c, const pags_clusters *k, int64_t i, cluster_bound *bound) {
  const pags_projection *const v = c->view;
  float lo[3], hi[3], centre[3], half[3];
  for (int a = 0; a < 3; a++) {
    centre[a] = 0.5f * (k->lo[a][i] + k->hi[a][i]);
    half[a] = 0.5f * (k->hi[a][i] - k->lo[a][i]);
  }
  float moved[3] = {0.0f, 0.0f, 0.0f}, speed[3] = {0.0f, 0.0f, 0.0f}, widened[2] = {1.0f, 1.0f};
  if (v->scan)
    motion_bound(v->scan, centre, half, moved, speed);
  for (int a = 0; a < 3; a++) {
    const spread s = row_spread(v->r + 3 * a, v->t[a], moved[a], centre, half);
    /* Error bound: six roundings, each of relative error 2^-24, here and in the kernel, on terms of at most `size`. */
    const float slack = 4e-6f * s.size + 1e-20f;
    lo[a] = s.middle - s.reach - slack;
    hi[a] = s.middle + s.reach + slack;
  }
  if (c->frame->lens)
    return pags_frame_lens_misses(c->frame->lens, v, lo, hi, speed,
                                  k->sigma[i] * c->stretch * (v->scan ? turn_bound(c) : 1.0f), c->reach_max, bound);
  if (hi[2] <= v->near_plane)
    return true;
  const float z0 = lo[2] > v->near_plane ? lo[2] : v->near_plane, z1 = hi[2];
  /* Until more is known: any depth from 0 on, all blocks of the picture. */
  const interval all = {-INFINITY, INFINITY};
  *bound = (cluster_bound){.near = 0.0f};
  reach_blocks(all, v->width, &bound->reach.x0, &bound->reach.x1);
  reach_blocks(all, v->height, &bound->reach.y0, &bound->reach.y1);
  if (!(z0 > 0.0f))
    return false;
  if (v->scan)
    shear_bound(c, lo, hi, z0, speed, widened);
  const float sigma = k->sigma[i] * c->stretch;
  const interval x =
      axis_reach(lo[0], hi[0], z0, z1, v->fx, v->cx, widened[0] * sigma, c->lim2_x, v->low_pass, c->reach_max);
  const interval y =
      axis_reach(lo[1], hi[1], z0, z1, v->fy, v->cy, widened[1] * sigma, c->lim2_y, v->low_pass, c->reach_max);
  if (is_outside(x, v->width) || is_outside(y, v->height))
    return true;
  bound->near = z0;
  reach_blocks(x, v->width, &bound->reach.x0, &bound->reach.x1);
  reach_blocks(y, v->height, &bound->reach.y0, &bound->reach.y1);
  return false;
}

/* ---- Culling the clusters ---- */

/* The parts, cut into blocks of CULLED_AT_A_TIME clusters; a part's first block, and the number of all of them. A scene
 * may have many small parts: all are culled in one loop. */
typedef struct cull_parts {
  const cull_context *parts;
  const int64_t *first_block;
} cull_parts;

/* Block function: culls the blocks [begin, end), whole runs of clusters first. */
static void cull_blocks(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const cull_parts *const all = context;
  cluster_bound bound;
  int part = 0;
  for (int64_t block = begin; block < end; block++) {
    while (all->first_block[part + 1] <= block)
      part++;
    const cull_context *const c = all->parts + part;
    const int64_t first = (block - all->first_block[part]) * CULLED_AT_A_TIME, left = c->clusters->count - first,
                  last = first + (left < CULLED_AT_A_TIME ? left : CULLED_AT_A_TIME);
    for (int64_t i = first; i < last; i++) {
      if (c->clusters->runs && i % RUN == 0 && i + RUN <= last &&
          cluster_outside(c, c->clusters->runs, i / RUN, &bound)) {
        memset(c->seen + i, 0, RUN);
        i += RUN - 1;
        continue;
      }
      c->seen[i] = !cluster_outside(c, c->clusters, i, &bound) ? SEEN : 0;
      if (c->seams && c->seen[i] && bound.seam)
        c->seen[i] = SEAM;
      if (c->bounds && c->seen[i])
        c->bounds[i] = bound;
    }
  }
}

static void touch_block(void *context, int64_t begin, int64_t end, int worker) {
  const pags_frame *const f = context;
  for (int64_t i = begin; i < end; i++)
    if (!f->clusters[i].turned)
      f->touch(f->touch_user, f->clusters[i].part, f->clusters[i].cluster, worker);
}

static float largest_square(float a, float b) {
  return 1.0f + (a * a > b * b ? a * a : b * b);
}

/* Appends the clusters of a part whose flag is `seen` to the frame's list, and gives each its range of dense indices.
 */
static void append_seen(const cull_context *c, int part, uint8_t seen) {
  pags_frame *const frame = c->frame;
  const pags_clusters *const clusters = c->clusters;
  const int64_t gaussians = frame->parts[part].gaussians->count;
  for (int64_t i = 0; i < clusters->count; i++) {
    if (c->seen[i] < seen)
      continue;
    const int64_t first = i * clusters->size;
    const int64_t left = gaussians - first;
    const int32_t count = (int32_t)(left < clusters->size ? left : clusters->size);
    if (c->bounds)
      frame->bounds[frame->cluster_count] = c->bounds[i];
    frame->clusters[frame->cluster_count++] = (view_cluster){part, count, i, first, frame->dense_count, seen == SEAM};
    frame->dense_count += (count + 15) / 16 * 16;
    frame->stats.in_view += count;
  }
}

pags_result pags_stage_cull(pags_frame *frame, bool bounded) {
  pags_tasks_mark(frame->tasks, NULL, "cull");
  int64_t all = 0, blocks = 0;
  for (int p = 0; p < frame->part_count; p++)
    all += frame->parts[p].clusters->count;
  /* The gradients of a cluster are handed over once, so it is drawn once. */
  const bool seams = frame->lens && frame->lens->sphere && !frame->options.keep_for_backward;
  const int64_t most = seams ? 2 * all : all;
  cull_context *parts;
  int64_t *first_block;
  uint8_t *seen;
  cluster_bound *bounds = NULL;
  PAGS_TRY(pags_frame_alloc(frame, &parts, frame->part_count, sizeof *parts, "parts"));
  PAGS_TRY(pags_frame_alloc(frame, &first_block, frame->part_count + 1, sizeof *first_block, "parts"));
  PAGS_TRY(pags_frame_alloc(frame, &seen, all, 1, "cluster flags"));
  PAGS_TRY(pags_frame_alloc(frame, &frame->clusters, most, sizeof *frame->clusters, "clusters in view"));
  frame->bounds = NULL;
  frame->counts = NULL;
  if (bounded) {
    PAGS_TRY(pags_frame_alloc(frame, &bounds, all, sizeof *bounds, "cluster bounds"));
    PAGS_TRY(pags_frame_alloc(frame, &frame->bounds, most, sizeof *frame->bounds, "cluster bounds"));
  }
  if (frame->scans || frame->lens) {
    PAGS_TRY(pags_frame_alloc(frame, &frame->counts, most, sizeof *frame->counts, "clusters in view"));
    memset(frame->counts, 0, (size_t)most * sizeof *frame->counts);
  }
  frame->cluster_count = frame->dense_count = 0;
  for (int64_t p = 0, at = 0; p < frame->part_count; p++) {
    const pags_part *const part = frame->parts + p;
    const pags_projection *const view = frame->projections + p;
    /* The largest distance of a member: log2(o / a)/k, plus the kernel's slack, for the part's largest opacity o and
     * least alpha a; k = log2(e)/2. With antialiasing a may be as low as 1/255 (simd/projection.h). */
    const bool boosted = part->opacity_factor && part->opacity_factor_most > 1.0f;
    const float deepest = view->antialiased ? PAGS_LOG2_255 : view->alpha.lift - view->alpha.cut;
    parts[p] = (cull_context){
        .frame = frame,
        .clusters = part->clusters,
        .view = view,
        .seen = seen + at,
        .seams = seams,
        .bounds = bounded ? bounds + at : NULL,
        .stretch = (float)pags_affine_stretch(part->world_from_model),
        .lim2_x = largest_square(view->lim_x0, view->lim_x1),
        .lim2_y = largest_square(view->lim_y0, view->lim_y1),
        .reach_max =
            (deepest + PAGS_CUT_SLACK + (boosted ? pags_log2f(part->opacity_factor_most) : 0.0f)) / 0.72134752f};
    at += part->clusters->count;
    first_block[p] = blocks;
    blocks += (part->clusters->count + CULLED_AT_A_TIME - 1) / CULLED_AT_A_TIME;
  }
  first_block[frame->part_count] = blocks;
  PAGS_TRY(pags_frame_for(frame, blocks, 1, cull_blocks, &(cull_parts){parts, first_block}));
  for (int p = 0; p < frame->part_count; p++)
    append_seen(parts + p, p, SEEN);
  for (int p = 0; seams && p < frame->part_count; p++)
    append_seen(parts + p, p, SEAM);
  frame->stats.clusters = frame->cluster_count;
  if (frame->dense_count >= INT64_C(1) << 31)
    return pags_fail(PAGS_ERROR_LIMIT, "%lld Gaussians in view; at most 2^31 - 1 can be drawn",
                     (long long)frame->dense_count);
  return PAGS_OK;
}

pags_result pags_stage_touch(pags_frame *frame) {
  frame->stats.loaded = frame->stats.in_view;
  if (!frame->touch)
    return PAGS_OK;
  pags_tasks_mark(frame->tasks, NULL, "touch");
  return pags_frame_for(frame, frame->cluster_count, 4, touch_block, frame);
}
