/* SPDX-License-Identifier: Apache-2.0 */
/* Draws pictures of the synthetic street by ray tracing. The colour of a surface is its reflectance times the light
 * from the sun and from eight directions of the sky, each only if a shadow ray in its direction is free, plus the
 * mirrored sky on glossy surfaces. Sample i of a pixel tests sky direction i alone, so that eight samples cover all
 * of them. */
#include "synth/view.h"

#include <math.h>

#include "base/vec3.h"
#include "maths/maths.h"
#include "synth/faults.h"

/* ---- Cameras and jobs ---- */

static const uint8_t unseen = 255; /* the class of pixels that a lens doesn't see: unknown */

enum { ROWS = 4, COLUMNS = 8 * PAGS_PACKET }; /* size in pixels of a block of parallel work */

typedef struct draw_job {
  const pags_street *street;
  const pags_stage *stage;
  pags_street_view *views;
  pags_street_window window;
  int across, blocks; /* blocks side by side, and in all, of the window of each view */
  int step;           /* of the lattice of samples in a pixel (lattice_step) */
  uint64_t seed;
} draw_job;

/* Sets `direction` to the world direction of the ray through image position (x, y), px, scaled to a camera z of 1, so
 * that distances along it are camera depths; through a fisheye, to a length of 1. Returns whether the lens sees there.
 */
static bool camera_ray(const draw_job *job, const pags_street_view *view, double x, double y, float direction[3]) {
  const pags_camera *camera = &view->camera;
  double world[3], own[3] = {(x - camera->cx) / camera->fx, (y - camera->cy) / camera->fy, 1.0};
  const bool seen = view->sensor < 0 || pags_faults_ray(job->street->options, camera, x, y, own);
  pags_rotate3(camera->world_from_camera, own, world);
  pags_narrow3(world, direction);
  return seen;
}

float pags_display_srgb(float linear) {
  const float v = linear <= 0.0f ? 0.0f : linear >= 1.0f ? 1.0f : linear;
  return v <= 0.0031308f ? 12.92f * v : 1.055f * pags_powf(v, 1.0f / 2.4f) - 0.055f;
}

/* ---- Light, reflection and shading ---- */

/* Eight unit directions spread over the sky, four 20 degrees and four 49 degrees high. `sky_norm` scales their light
 * so that a surface that faces up and sees all of them gets an ambient light of 1. */
static const float sky_ways[PAGS_PACKET][3] = {
    {0.883f, 0.318f, 0.345f}, {-0.398f, 0.849f, 0.348f}, {-0.849f, -0.398f, 0.348f}, {0.318f, -0.883f, 0.345f},
    {0.459f, 0.459f, 0.760f}, {-0.459f, 0.459f, 0.760f}, {-0.459f, -0.459f, 0.760f}, {0.459f, -0.459f, 0.760f}};
static const float sky_norm = 8.0f / (4 * 0.3465f + 4 * 0.760f);

/* Makes the shadow rays from the surface points whose bit is set in `met`, in direction ways[step * i] for point i
 * (step 0: one direction for all). They start just above the surface, on leaves 0.15 m away from it, since leaves let
 * light through. Points of other materials that face away from the light get no ray. */
static void light_rays(const draw_job *job, const pags_touch *touches, unsigned met, const float (*ways)[3], int step,
                       pags_rays *out) {
  out->active = 0;
  for (int i = 0; i < PAGS_PACKET; i++) {
    if (!(met >> i & 1u))
      continue;
    const pags_touch *touch = &touches[i];
    const float *way = ways[step * i];
    const bool leaf = job->street->materials.list[touch->material].finish == PAGS_FINISH_LEAF;
    const float gap = 4e-4f + 2e-5f * (fabsf(touch->point[0]) + fabsf(touch->point[1]));
    if (!leaf && pags_dot3f(touch->flat, way) <= 0.0f)
      continue;
    pags_along3f(touch->point, leaf ? 0.15f : gap, leaf ? way : touch->flat, out->origin[i]);
    pags_copy3f(way, out->direction[i]);
    out->active |= 1u << i;
  }
}

/* The contributions of a surface point that do not depend on shadows: the diffuse reflectance, and the mirrored
 * colour times the share of light that is mirrored. */
typedef struct surface {
  float reflectance[3], mirrored[3];
} surface;

/* Adds the mirrored surroundings to `out`. The mirrored share rises from material->gloss at a right angle towards
 * grazing angles with the fifth power, like Schlick's approximation, but half as far. */
static void mirror(const pags_material *material, const pags_touch *touch, const float unit[3], uint64_t seed,
                   surface *out) {
  const float facing = -pags_dot3f(unit, touch->normal), away = 1.0f - (facing > 0.0f ? facing : 0.0f);
  const float share = material->gloss + 0.5f * (1.0f - material->gloss) * away * away * away * away * away;
  float direction[3];
  pags_along3f(unit, 2.0f * facing, touch->normal, direction);
  pags_sky_mirrored(direction, seed, out->mirrored);
  pags_scale3f(1.0f - share, out->reflectance, out->reflectance);
  pags_scale3f(share, out->mirrored, out->mirrored);
}

/* Returns the footprint on the surface of a sample that is `side` wide at distance 1 and is seen along the unit
 * vector `unit`. On surfaces seen at a slant it is longer in the viewing direction. */
static pags_footprint footprint_of(const pags_touch *touch, const float unit[3], float side) {
  const float slant = fmaxf(fabsf(pags_dot3f(unit, touch->flat)), 0.03f), across = touch->distance * side,
              along = across / slant;
  const float level = sqrtf(unit[0] * unit[0] + unit[1] * unit[1]) + 1e-6f;
  const float x = fabsf(unit[0]) / level, y = fabsf(unit[1]) / level;
  return (pags_footprint){.mean = across / sqrtf(slant), .x = along * x + across * y, .y = along * y + across * x};
}

/* Sets `light` to the light on a surface point. `sunny`: no shadow ray to the sun is blocked; `open`: nor is the one
 * along the sky direction `way`, else that direction brings light bounced off houses. Leaves are lit from both
 * sides. */
static void light_on(const pags_touch *touch, bool leaf, bool sunny, bool open, const float way[3], float light[3]) {
  static const float above[3] = {0.45f, 0.52f, 0.65f}, bounced[3] = {0.17f, 0.155f, 0.135f},
                     below[3] = {0.16f, 0.15f, 0.14f};
  float sun = pags_dot3f(touch->normal, pags_sun), sky = pags_dot3f(touch->normal, way);
  sun = !sunny ? 0.0f : leaf ? 0.25f + 0.75f * fabsf(sun) : sun > 0.0f ? sun : 0.0f;
  sky = (leaf ? 0.3f + 0.5f * fabsf(sky) : sky > 0.0f ? sky : 0.0f) * sky_norm;
  for (int c = 0; c < 3; c++)
    light[c] =
        pags_sun_light[c] * sun + (open ? above[c] : bounced[c]) * sky + below[c] * (0.5f - 0.5f * touch->normal[2]);
}

/* Bit i: point i of a packet sees the sun; sees the sky in its direction. */
typedef struct lighting {
  unsigned sunny, open;
} lighting;

static lighting find_light(const draw_job *job, const pags_touch *touches, unsigned met) {
  pags_rays rays;
  lighting out;
  light_rays(job, touches, met, &pags_sun, 0, &rays);
  out.sunny = rays.active & ~pags_stage_blocked(job->stage, &rays, true);
  light_rays(job, touches, met, sky_ways, 1, &rays);
  out.open = rays.active & ~pags_stage_blocked(job->stage, &rays, false);
  return out;
}

/* Adds to `sum` the colours of the packet's samples that hit a surface, times the share `bright` of their light. An odd
 * sample reuses the reflectance of the even one before it if both lie on one face. Textures are filtered over half a
 * pixel's width. */
static void add_surfaces(const draw_job *job, const pags_camera *camera, float bright, const pags_rays *rays,
                         const pags_touch *touches, unsigned met, float sum[3]) {
  static const float haze[3] = {0.62f, 0.68f, 0.75f};
  const lighting light = find_light(job, touches, met);
  surface seen = {{0}, {0}};
  for (int i = 0; i < PAGS_PACKET; i++) {
    const pags_touch *touch = &touches[i];
    float color[3];
    if (!(met >> i & 1u))
      continue;
    const pags_material *material = &job->street->materials.list[touch->material];
    const float length = pags_length3f(rays->direction[i]);
    const bool borrowed =
        i & 1 && met >> (i - 1) & 1u && touch->face == touch[-1].face && touch->placement == touch[-1].placement;
    if (!borrowed) {
      /* Evaluate the material at this sample. */
      float unit[3];
      pags_copy3f(rays->direction[i], unit);
      pags_divide3f(unit, length);
      const pags_footprint footprint = footprint_of(touch, unit, (float)(0.5 / camera->fx));
      seen = (surface){{0}, {0}};
      pags_material_color(material, &job->street->markings, touch, &footprint, job->seed, seen.reflectance);
      if (material->gloss > 0.0f)
        mirror(material, touch, unit, job->seed, &seen);
    }
    const bool leaf = material->finish == PAGS_FINISH_LEAF;
    light_on(touch, leaf, light.sunny >> i & 1u, light.open >> i & 1u, sky_ways[i], color);
    const float clear = pags_expf(-(touch->distance * length) / 900.0f);
    for (int c = 0; c < 3; c++) {
      color[c] = color[c] * seen.reflectance[c] + seen.mirrored[c];
      color[c] = bright * (color[c] * clear + haze[c] * (1.0f - clear));
      sum[c] += color[c] < 1.0f ? color[c] : 1.0f;
    }
  }
}

/* The surface is shaded as seen along its normal, because a Gaussian's base colour is the same from every
 * direction. */
void pags_street_shade(const pags_street *street, const pags_stage *stage, const pags_touch *touch,
                       const pags_footprint *footprint, float color[3]) {
  const draw_job job = {.street = street, .stage = stage, .seed = street->options->seed};
  const pags_material *material = &street->materials.list[touch->material];
  const bool leaf = material->finish == PAGS_FINISH_LEAF;
  const float towards[3] = {-touch->normal[0], -touch->normal[1], -touch->normal[2]};
  pags_touch copies[PAGS_PACKET], texture = *touch;
  surface seen = {{0}, {0}};
  for (int i = 0; i < PAGS_PACKET; i++)
    copies[i] = *touch;
  const lighting light = find_light(&job, copies, (1u << PAGS_PACKET) - 1u);
  if (material->finish == PAGS_FINISH_ASPHALT || material->finish == PAGS_FINISH_PAVING)
    pags_copy3f(touch->local, texture.point); /* a town's streets share one mesh */
  pags_material_color(material, &street->markings, &texture, footprint, job.seed, seen.reflectance);
  if (material->gloss > 0.0f)
    mirror(material, touch, towards, job.seed, &seen);
  pags_copy3f(seen.mirrored, color);
  for (int i = 0; i < PAGS_PACKET; i++) {
    float share[3];
    light_on(touch, leaf, light.sunny >> i & 1u, light.open >> i & 1u, sky_ways[i], share);
    for (int c = 0; c < 3; c++)
      color[c] += seen.reflectance[c] * share[c] / PAGS_PACKET;
  }
}

/* ---- Pixels and pictures ---- */

/* Returns the step s of the lattice of n samples in a pixel whose sample i lies in column i and row i * s mod n. The
 * step is near 0.618 n (golden section) and coprime to n, so that each of the n rows and n columns holds one sample
 * and the samples' mean is the pixel's centre. */
static int lattice_step(int n) {
  for (int step = (int)(0.618 * n); step > 1; step--) {
    int a = n, b = step;
    while (b) {
      const int rest = a % b;
      a = b;
      b = rest;
    }
    if (a == 1)
      return step;
  }
  return 1;
}

static void draw_pixel(const draw_job *job, const pags_street_view *view, int x, int y, pags_rays *rays) {
  const pags_street_options *o = job->street->options;
  const int samples = o->samples;
  const float bright = view->sensor < 0 ? 1.0f : pags_faults_vignette(o, x + 0.5, y + 0.5);
  const float power = view->sensor < 0 ? 1.0f : pags_faults_response(o, view->sensor);
  uint8_t *out = view->rgb + 3 * ((int64_t)y * view->camera.width + x);
  float sum[3] = {0};
  for (int first = 0; first < samples; first += PAGS_PACKET) {
    rays->active = 0;
    for (int i = 0; i < PAGS_PACKET && first + i < samples; i++) {
      const int row = (int)((int64_t)(first + i) * job->step % samples);
      if (camera_ray(job, view, x + (first + i + 0.5) / samples, y + (row + 0.5) / samples, rays->direction[i]))
        rays->active |= 1u << i;
    }

    /* Trace up to eight samples and add their colours. */
    pags_touch touches[PAGS_PACKET];
    const unsigned met = pags_stage_trace(job->stage, rays, touches);
    if (met)
      add_surfaces(job, &view->camera, bright, rays, touches, met, sum);
    if (met != rays->active) {
      /* The sky changes little within a pixel: its colour in the mean direction of these rays counts for all of
       * them. */
      unsigned sky = rays->active & ~met;
      float mean[3] = {0}, color[3], count = 0.0f;
      for (int i = 0; i < PAGS_PACKET; i++)
        if (sky >> i & 1u) {
          count += 1.0f;
          pags_add3f(mean, rays->direction[i], mean);
        }
      pags_normalise3f(mean);
      pags_sky_color(mean, job->seed, color);
      for (int c = 0; c < 3; c++)
        sum[c] += count * (bright * color[c] < 1.0f ? bright * color[c] : 1.0f);
    }
  }
  for (int c = 0; c < 3; c++) {
    const float value = pags_display_srgb(sum[c] / (float)samples);
    out[c] = (uint8_t)((power == 1.0f ? value : pags_powf(value, power)) * 255.0f + 0.5f);
  }
}

/* Fills pixels [first, end) of row y of the view's depth, labels and actors from rays through the pixels' centres,
 * eight neighbours at a time. */
static void draw_truth(const draw_job *job, const pags_street_view *view, int first, int end, int y, pags_rays *rays) {
  pags_touch touches[PAGS_PACKET];
  for (; first < end; first += PAGS_PACKET) {
    rays->active = 0;
    for (int i = 0; i < PAGS_PACKET && first + i < end; i++) {
      if (camera_ray(job, view, first + i + 0.5, y + 0.5, rays->direction[i]))
        rays->active |= 1u << i;
    }
    const unsigned met = pags_stage_trace(job->stage, rays, touches);
    for (int i = 0; i < PAGS_PACKET && first + i < end; i++) {
      int64_t at = (int64_t)y * view->camera.width + first + i;
      const pags_touch *touch = met >> i & 1u ? &touches[i] : NULL;
      view->depth[at] = touch ? touch->distance : 0.0f;
      view->labels[at] = touch                    ? job->street->materials.list[touch->material].label
                         : rays->active >> i & 1u ? PAGS_CLASS_SKY
                                                  : unseen;
      view->actors[at] = touch ? job->street->placements[touch->placement].actor : -1;
    }
  }
}

static void draw_blocks(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const draw_job *job = context;
  const pags_street_window *w = &job->window;
  for (int64_t b = begin; b < end; b++) {
    const pags_street_view *view = &job->views[b / job->blocks];
    const int block = (int)(b % job->blocks);
    const int left = w->x[0] + COLUMNS * (block % job->across), top = w->y[0] + ROWS * (block / job->across);
    const int right = left + COLUMNS < w->x[1] ? left + COLUMNS : w->x[1];
    pags_rays rays = {0};
    double eye[3];
    pags_pose_position(view->camera.world_from_camera, eye);
    for (int i = 0; i < PAGS_PACKET; i++)
      pags_narrow3(eye, rays.origin[i]);
    for (int y = top; y < top + ROWS && y < w->y[1]; y++) {
      for (int x = left; x < right; x++)
        draw_pixel(job, view, x, y, &rays);
      if (view->depth)
        draw_truth(job, view, left, right, y, &rays);
    }
  }
}

pags_result pags_street_draw(const pags_street *street, const pags_stage *stage, pags_street_view *views, int count,
                             const pags_street_window *window, pags_tasks *tasks) {
  const pags_street_options *o = street->options;
  draw_job job = {.street = street, .stage = stage, .views = views, .seed = o->seed};
  job.window = window ? *window : (pags_street_window){.x = {0, o->width}, .y = {0, o->height}};
  job.step = lattice_step(o->samples);
  job.across = (job.window.x[1] - job.window.x[0] + COLUMNS - 1) / COLUMNS;
  job.blocks = job.across * ((job.window.y[1] - job.window.y[0] + ROWS - 1) / ROWS);
  return pags_parallel_for(tasks, (int64_t)job.blocks * count, 1, draw_blocks, &job)
             ? PAGS_OK
             : pags_fail(PAGS_CANCELLED, "cancelled");
}

/* ---- Exposures ---- */

pags_result pags_street_expose(pags_street *street, pags_stage *stage, int frame, pags_street_view *views,
                               pags_tasks *tasks) {
  const pags_street_options *o = street->options;
  const bool rolls = o->faults.rolling > 0.0;
  const int lines = pags_faults_lines(o), together = o->faults.delay > 0.0 ? 1 : o->cameras;
  for (int first = 0; first < o->cameras; first += together) { /* cameras that expose at one time */
    for (int line = 0; line < lines; line++) {
      /* The pixels of a line that a shutter reads at one time. */
      pags_street_window window = {.x = {0, o->width}, .y = {0, o->height}};
      if (rolls) {
        int *side = pags_faults_reads_rows(o) ? window.y : window.x;
        side[0] = line;
        side[1] = line + 1;
      }
      for (int c = first; c < first + together; c++) {
        views[c].sensor = c;
        views[c].camera = pags_faults_camera(o, frame, c, rolls ? line : -1);
      }
      pags_street_set_time(street, views[first].camera.time);
      PAGS_TRY(pags_stage_commit(stage, street->first_moving, street->placement_count - street->first_moving));
      PAGS_TRY(pags_street_draw(street, stage, views + first, together, &window, tasks));
    }
  }
  return PAGS_OK;
}
