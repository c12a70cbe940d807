/* SPDX-License-Identifier: Apache-2.0 */
/* Covers the surfaces of a town with Gaussians. A Gaussian's mean is a random point of a face that is chosen with a
 * probability proportional to its area times its density. The point is drawn again until at least one of eight random
 * viewpoints on the nearest street and lane sees it, because a trained scene, too, has Gaussians only where
 * photographs show the surface. The Gaussian lies flat on its face, aligned with the face's edges where the face is
 * small, and is no wider than the face. Its colour is the shading of view.c with all eight sky directions, filtered
 * over its size. */
#include "synth/surface.h"

#include <math.h>

#include "base/rng.h"
#include "base/vec3.h"
#include "maths/maths.h"
#include "synth/size_tables.h"
#include "synth/view.h"

/* The purposes of random numbers. Attempt t at Gaussian i draws from stream DRAWS * t + purpose at index i. */
enum {
  DRAW_FACE,
  DRAW_SPOT,
  DRAW_SIZE,
  DRAW_SHAPE,
  DRAW_EYES,
  DRAW_TURN = DRAW_EYES + PAGS_PACKET,
  DRAW_SHEEN,
  DRAWS = 24
};
enum { TRIES = 48, BLOCK = 4096, CHUNK = 64 };

#define EYE_HEIGHT 1.6f
#define SH_C0 ((float)PAGS_SH_C0)

static const pags_vertex *corner_of(const pags_mesh *mesh, int64_t face, int corner) {
  return &mesh->vertices[mesh->faces[4 * face + corner]];
}

/* ---- Areas of faces, weighted by density ---- */

static bool is_critical(uint8_t label) {
  return label == PAGS_CLASS_CAR || label == PAGS_CLASS_PERSON || label == PAGS_CLASS_RIDER ||
         label == PAGS_CLASS_BICYCLE;
}

static const pags_size_table *table_of(uint8_t label) {
  switch (label) {
    case PAGS_CLASS_ROAD:
    case PAGS_CLASS_SIDEWALK:
    case PAGS_CLASS_TERRAIN: return &pags_size_ground;
    case PAGS_CLASS_BUILDING: return &pags_size_fronts;
    default: return &pags_size_things;
  }
}

/* Returns the area of a face, in the mesh's frame, times the density of its Gaussians relative to
 * PAGS_TRAINED_DENSITY. The area is half the length of the cross product of the diagonals, which holds for planar
 * quads and for triangles, whose last corner is repeated. */
static double face_weight(const pags_street *town, const pags_mesh *mesh, int64_t face) {
  float first[3], second[3], normal[3];
  pags_subtract3f(corner_of(mesh, face, 2)->position, corner_of(mesh, face, 0)->position, first);
  pags_subtract3f(corner_of(mesh, face, 3)->position, corner_of(mesh, face, 1)->position, second);
  pags_cross3f(first, second, normal);
  const pags_material *material = &town->materials.list[mesh->materials[face]];
  const pags_size_table *table = table_of(material->label);
  const double density = material->finish == PAGS_FINISH_LEAF ? PAGS_TRAINED_LEAVES /* per square metre */
                         : is_critical(material->label)       ? PAGS_TRAINED_CARS
                         : table == &pags_size_fronts         ? PAGS_TRAINED_FRONTS
                         : table == &pags_size_ground         ? PAGS_TRAINED_GROUND
                                                              : PAGS_TRAINED_DENSITY;
  return 0.5 * (double)pags_length3f(normal) * density / PAGS_TRAINED_DENSITY;
}

pags_result pags_surface_create(const pags_street *town, const pags_town_plan *plan, const pags_stage *stage,
                                pags_surface *out) {
  *out = (pags_surface){.town = town, .plan = plan, .stage = stage};
  out->placement_area = malloc((size_t)(town->placement_count + 1) * sizeof(double));
  out->face_area = calloc((size_t)town->mesh_count + 1, sizeof *out->face_area);
  PAGS_CHECK_MEMORY(out->placement_area && out->face_area, "the faces of a town");
  for (int i = 0; i < town->placement_count; i++) {
    const pags_stage_placement *p = &town->placements[i];
    const pags_mesh *mesh = &town->meshes[p->mesh];
    const int64_t faces = mesh->face_count;
    double **areas = &out->face_area[p->mesh], sum = 0.0;
    if (!*areas) {
      *areas = malloc((size_t)(faces + 1) * sizeof(double));
      PAGS_CHECK_MEMORY(*areas, "the faces of a town");
      for (int64_t f = 0; f < faces; f++)
        (*areas)[f] = sum += face_weight(town, mesh, f);
    }
    const double scale2 = (double)(p->pose[0] * p->pose[0] + p->pose[4] * p->pose[4] + p->pose[8] * p->pose[8]);
    out->placement_area[i] = out->area += faces ? scale2 * (*areas)[faces - 1] : 0.0;
  }
  return PAGS_OK;
}

void pags_surface_destroy(pags_surface *surface) {
  for (int i = 0; surface->face_area && i < surface->town->mesh_count; i++)
    free(surface->face_area[i]);
  free(surface->face_area);
  free(surface->placement_area);
  *surface = (pags_surface){0};
}

/* ---- Choosing a face ---- */

/* Returns the first index whose cumulative sum exceeds `value` (binary search). */
static int64_t find(const double *sums, int64_t count, double value) {
  int64_t low = 0, high = count - 1;
  while (low < high) {
    const int64_t middle = (low + high) / 2;
    if (sums[middle] > value)
      high = middle;
    else
      low = middle + 1;
  }
  return low;
}

/* A placed face with unit vectors in the world: `edge` along its first side, `side` in the face at right angles to
 * `edge`, `normal` perpendicular to the face. */
typedef struct facet {
  const pags_material *material;
  const pags_mesh *mesh;
  const pags_stage_placement *placement;
  int64_t face;
  float corner[4][3]; /* world */
  float edge[3], side[3], normal[3];
  float length, width; /* extents along `edge` and `side`, metres */
  bool triangle;
} facet;

static facet choose_facet(const pags_surface *s, double share) {
  const double value = share * s->area;
  const int64_t place = find(s->placement_area, s->town->placement_count, value);
  const pags_stage_placement *p = &s->town->placements[place];
  const double before = place ? s->placement_area[place - 1] : 0.0, own = s->placement_area[place] - before;
  const pags_mesh *mesh = &s->town->meshes[p->mesh];
  const double *sums = s->face_area[p->mesh];
  const int64_t face = find(sums, mesh->face_count, (value - before) / own * sums[mesh->face_count - 1]);
  facet out = {.material = &s->town->materials.list[mesh->materials[face]],
               .mesh = mesh,
               .placement = p,
               .face = face,
               .triangle = mesh->faces[4 * face + 2] == mesh->faces[4 * face + 3]};
  float other[3];
  for (int c = 0; c < 4; c++)
    pags_transform3f(p->pose, corner_of(mesh, face, c)->position, out.corner[c]);
  pags_subtract3f(out.corner[1], out.corner[0], out.edge);
  pags_subtract3f(out.corner[out.triangle ? 2 : 3], out.corner[0], other);
  out.length = pags_normalise3f(out.edge);
  pags_cross3f(out.edge, other, out.normal);
  out.width = pags_normalise3f(out.normal);
  pags_cross3f(out.normal, out.edge, out.side);
  return out;
}

/* ---- Choosing scales and a visible point ---- */

static float quantile(const float table[PAGS_QUANTILES], double share) {
  const float s = (float)share;
  int i = 0;
  while (i + 2 < PAGS_QUANTILES && s > pags_quantile_shares[i + 1])
    i++;
  const float t = (s - pags_quantile_shares[i]) / (pags_quantile_shares[i + 1] - pags_quantile_shares[i]);
  return table[i] + (table[i + 1] - table[i]) * (t < 0.0f ? 0.0f : t > 1.0f ? 1.0f : t);
}

/* The random choices for one Gaussian. */
typedef struct spot {
  facet face;
  float ln_sigma[3]; /* log scales along the axes below */
  float axis[3][3];  /* columns of its rotation matrix; the third is the face's normal */
  float logit;       /* of the opacity */
  pags_touch touch;  /* its mean as a surface point, for the shading */
} spot;

/* Cumulative distribution function of the standard normal distribution. */
static double share_below(double z) {
  return 0.5 * pags_erfc(-z * 0.70710678118654752);
}

/* Maps a uniform `share` to a fraction of a side that stays 0.7 sigma away from both ends, so that the borders of
 * faces stay sharp. */
static float within(double share, float sigma, float side) {
  const float margin = fminf(0.5f, 0.7f * sigma / fmaxf(side, 1e-4f));
  return margin + (1.0f - 2.0f * margin) * (float)share;
}

/* Chooses the mean on the face and fills out->touch there. */
static void choose_point(const pags_surface *s, spot *out, uint64_t a, uint64_t row) {
  const facet *f = &out->face;
  const bool swap = fabsf(pags_dot3f(out->axis[0], f->side)) > 0.7f;
  double at[2];
  float weight[4];
  pags_rng_uniform2(s->town->options->seed, a + DRAW_SPOT, row, at);
  if (f->triangle) {
    const bool over = at[0] + at[1] > 1.0;
    const float u = (float)(over ? 1.0 - at[0] : at[0]), v = (float)(over ? 1.0 - at[1] : at[1]);
    memcpy(weight, (float[4]){1.0f - u - v, u, v, 0.0f}, sizeof weight);
  } else {
    const float u = within(at[0], pags_expf(out->ln_sigma[swap]), f->length),
                v = within(at[1], pags_expf(out->ln_sigma[!swap]), f->width);
    memcpy(weight, (float[4]){(1.0f - u) * (1.0f - v), u * (1.0f - v), u * v, (1.0f - u) * v}, sizeof weight);
  }
  pags_touch *touch = &out->touch;
  float smooth[3] = {0};
  *touch = (pags_touch){.placement = (int)(f->placement - s->town->placements),
                        .face = (uint32_t)f->face,
                        .material = f->mesh->materials[f->face]};
  for (int c = 0; c < 4; c++) {
    const pags_vertex *vertex = corner_of(f->mesh, f->face, c);
    pags_add_scaled3f(weight[c], f->corner[c], touch->point);
    pags_add_scaled3f(weight[c], vertex->position, touch->local);
    pags_add_scaled3f(weight[c], vertex->normal, smooth);
    touch->uv[0] += weight[c] * vertex->uv[0];
    touch->uv[1] += weight[c] * vertex->uv[1];
  }
  pags_copy3f(f->normal, touch->flat);
  pags_rotate3f(f->placement->pose, smooth, touch->normal);
  if (pags_normalise3f(touch->normal) < 0.1f)
    pags_copy3f(f->normal, touch->normal);
}

static bool try_spot(const pags_surface *s, uint64_t attempt, uint64_t row, spot *out) {
  const uint64_t a = attempt * DRAWS;
  out->face = choose_facet(s, pags_rng_uniform(s->town->options->seed, a + DRAW_FACE, row));

  /* Scales come from the table. On small faces the longer axis lies along the longer side; on all faces a sigma is at
   * most half of the face's extent. */
  const uint64_t seed = s->town->options->seed;
  const facet *f = &out->face;
  const pags_size_table *table = table_of(f->material->label);
  double draw[2], other[2];
  pags_rng_normal2(seed, a + DRAW_SIZE, row, draw);
  pags_rng_normal2(seed, a + DRAW_SHAPE, row, other);

  /* The log scales of the longest and the middle axis and the logit of opacity are drawn jointly: the standard normal
   * deviates, combined by the table's correlations, choose the quantiles (Gaussian copula). */
  const double with_long = (double)table->opacity_with_long, with_middle = (double)table->opacity_with_middle;
  const double own = sqrt(1.0 - with_long * with_long - with_middle * with_middle);
  const float ln_long = quantile(table->ln_long, share_below(draw[0]));
  const float ln_middle = ln_long + quantile(table->ln_middle_by_long, share_below(draw[1]));
  out->logit =
      quantile(table->logit_opacity, share_below(with_long * draw[0] + with_middle * draw[1] + own * other[0]));
  const bool small = fminf(f->length, f->width) < 3.0f, swap = small && f->width > f->length;
  const float turn = small ? 0.0f : 6.2831853f * (float)pags_rng_uniform(seed, a + DRAW_TURN, row);
  const float c = pags_cosf(turn), d = pags_sinf(turn);
  for (int k = 0; k < 3; k++) {
    const float u = swap ? f->side[k] : f->edge[k], v = swap ? -f->edge[k] : f->side[k];
    out->axis[0][k] = c * u + d * v;
    out->axis[1][k] = c * v - d * u;
    out->axis[2][k] = f->normal[k];
  }
  const float room = f->material->finish == PAGS_FINISH_LEAF ? 1.0f : 0.5f; /* a Gaussian covers several leaves */
  const float most = pags_logf(fmaxf(room * fmaxf(f->length, f->width), 0.004f)),
              least = pags_logf(fmaxf(room * fminf(f->length, f->width), 0.004f));
  out->ln_sigma[0] = fminf(ln_long, most);
  out->ln_sigma[1] = fminf(ln_middle, least);
  out->ln_sigma[2] = out->ln_sigma[1] + quantile(table->ln_short_by_middle, share_below(other[1]));

  choose_point(s, out, a, row);

  /* Does any of eight viewpoints see the point? If so, its normals are turned towards the first one that does. */
  float eyes[PAGS_PACKET][3];
  pags_touch *touch = &out->touch;
  pags_rays rays = {.active = (1u << PAGS_PACKET) - 1u};

  /* The viewpoints, at eye height: half of them on the nearest street, half in the nearest lane, all within 30 m
   * along it. */
  const float pitch = pags_town_pitch(), length = pags_town_length(s->plan), cell = s->plan->block + PAGS_TOWN_LANE;
  const float street = fminf(fmaxf(floorf(touch->point[1] / pitch + 0.5f), 0.0f), (float)(s->plan->streets - 1));
  const float lane = fminf(fmaxf(floorf(touch->point[0] / cell), 0.0f), (float)(s->plan->columns - 2));
  const float top = (float)(s->plan->streets - 1) * pitch;
  for (int i = 0; i < PAGS_PACKET; i++) {
    double at[2];
    pags_rng_uniform2(s->town->options->seed, a + (uint64_t)(DRAW_EYES + i), row, at);
    const float wide = (float)at[0], far = 60.0f * ((float)at[1] - 0.5f);
    if (i % 2 == 0 || s->plan->streets < 2) {
      eyes[i][0] = fminf(fmaxf(touch->point[0] + far, 1.0f), length - 1.0f);
      eyes[i][1] = street * pitch + PAGS_KERB_RIGHT + 1.0f + wide * (PAGS_KERB_LEFT - PAGS_KERB_RIGHT - 2.0f);
    } else {
      eyes[i][0] = pags_town_lane_x(s->plan, (int)lane) + 5.0f * (wide - 0.5f);
      eyes[i][1] = fminf(fmaxf(touch->point[1] + far, 0.0f), top);
    }
    eyes[i][2] = EYE_HEIGHT;
  }

  for (int i = 0; i < PAGS_PACKET; i++) { /* the point lies at ray distance 1 */
    pags_copy3f(eyes[i], rays.origin[i]);
    pags_subtract3f(touch->point, eyes[i], rays.direction[i]);
  }
  pags_touch met[PAGS_PACKET];
  const unsigned hit = pags_stage_trace(s->stage, &rays, met);
  for (int i = 0; i < PAGS_PACKET; i++) {
    if (hit >> i & 1u && met[i].distance < 0.999f)
      continue;
    const float away = -pags_dot3f(touch->flat, rays.direction[i]) < 0.0f ? -1.0f : 1.0f;
    pags_scale3f(away, touch->flat, touch->flat);
    const float facing = pags_dot3f(touch->normal, touch->flat) < 0.0f ? -1.0f : 1.0f;
    pags_scale3f(facing, touch->normal, touch->normal);
    return true;
  }
  return false;
}

/* ---- Writing the Gaussians ---- */

double pags_surface_seen(const pags_surface *surface, int tries) {
  int seen = 0;
  for (int i = 0; i < tries; i++) {
    spot one;
    seen += try_spot(surface, TRIES, (uint64_t)i, &one);
  }
  return surface->area * seen / tries;
}

static void put_row(const pags_surface *s, const spot *at, pags_gaussians *g, int64_t row) {
  const uint64_t seed = s->town->options->seed;
  double sheen[2], offset[2], r[9], q[4];
  float srgb[3];

  /* Textures are filtered over a footprint two sigma wide along each axis. */
  const float wide = 2.0f * pags_expf(at->ln_sigma[0]), high = 2.0f * pags_expf(at->ln_sigma[1]);
  const pags_footprint print = {.mean = sqrtf(wide * high),
                                .x = fabsf(at->axis[0][0]) * wide + fabsf(at->axis[1][0]) * high,
                                .y = fabsf(at->axis[0][1]) * wide + fabsf(at->axis[1][1]) * high};
  float light[3];
  pags_street_shade(s->town, s->stage, &at->touch, &print, light);
  for (int c = 0; c < 3; c++)
    srgb[c] = pags_display_srgb(light[c]);

  pags_rng_normal2(seed, DRAW_SHEEN, (uint64_t)row, sheen);
  pags_rng_normal2(seed, DRAWS + DRAW_SHEEN, (uint64_t)row, offset);
  const float spread = fminf(PAGS_TRAINED_SPREAD, 0.25f * fminf(at->face.length, at->face.width)) * (float)offset[1];
  for (int k = 0; k < 3; k++) {
    pags_plane(g, PAGS_MEAN + k)[row] = at->touch.point[k] + spread * at->touch.flat[k];
    pags_plane(g, PAGS_SCALE + k)[row] = at->ln_sigma[k];
    pags_plane(g, PAGS_SH + k)[row] = (srgb[k] - 0.5f) / SH_C0;
    for (int j = 0; j < 3; j++)
      r[3 * k + j] = (double)at->axis[j][k];
    const double band = k == 0 ? sheen[0] : k == 1 ? sheen[1] : offset[0]; /* equal in all channels: a grey sheen */
    for (int c = 0; c < 3; c++)
      pags_plane(g, PAGS_SH + 3 * (1 + k) + c)[row] = PAGS_TRAINED_DEGREE_1 * (float)band;
  }
  pags_quaternion_from_rotation(r, q);
  for (int k = 0; k < 4; k++)
    pags_plane(g, PAGS_ROTATION + k)[row] = (float)q[k];
  pags_plane(g, PAGS_OPACITY)[row] = at->logit;
  g->s_sem[row] = is_critical(at->face.material->label) ? 1.0f : 0.0f;
}

typedef struct sample_job {
  const pags_surface *surface;
  pags_gaussians *gaussians;
  int64_t first;
} sample_job;

/* Where all TRIES points are hidden, the last one is used: with a quarter of the surface visible, that happens to one
 * Gaussian in a million. */
static void sample_rows(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const sample_job *job = context;
  for (int64_t i = job->first + begin; i < job->first + end; i++) {
    spot one;
    for (uint64_t t = 0; t < TRIES && !try_spot(job->surface, t, (uint64_t)i, &one); t++) {
    }
    put_row(job->surface, &one, job->gaussians, i);
  }
}

pags_result pags_surface_sample(const pags_surface *surface, pags_gaussians *gaussians, pags_tasks *tasks,
                                pags_progress_fn *progress, void *user) {
  const int64_t step = (int64_t)BLOCK * 16;
  for (int64_t first = 0; first < gaussians->count; first += step) {
    const int64_t rows = gaussians->count - first < step ? gaussians->count - first : step;
    sample_job job = {surface, gaussians, first};
    if (progress && !progress(user, (double)first / (double)gaussians->count, "Gaussians"))
      return pags_fail(PAGS_CANCELLED, "cancelled");
    if (!pags_parallel_for(tasks, rows, CHUNK, sample_rows, &job))
      return pags_fail(PAGS_CANCELLED, "cancelled");
  }
  return PAGS_OK;
}
