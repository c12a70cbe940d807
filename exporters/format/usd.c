/* SPDX-License-Identifier: Apache-2.0 */
/* pags_export_usd: writes the Gaussians and the proxies of a scene as one USD stage in text (.usda).
 *
 * The stage is Z up, in metres. Each object is an Xform below /scene with its track as time samples: a kinematic
 * rigid body. Below it are its Gaussians as a ParticleField3DGaussianSplat (OpenUSD 26.03) and its proxy as an
 * invisible mesh with a collider. /scene/background holds Gaussians and meshes of the rest. Spherical harmonics are
 * written of degree 0 or of degree 3 (missing terms zero), never between: Isaac Sim hangs on degrees 1 and 2. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <pags/export.h>

#include "base/memory.h"
#include "exporters/format/bake.h"
#include "exporters/format/object_gaussians.h"
#include "exporters/format/presence.h"
#include "exporters/format/usd_text.h"
#include "exporters/proxy/background.h"
#include "exporters/proxy/objects.h"
#include "maths/maths.h"
#include "scene/object.h"

enum { NAME_SIZE = PAGS_OBJECT_NAME, PADDED_DEGREE = 3 };

typedef struct usd_export {
  const pags_proxy_options *proxies;
  const pags_splat_options *splats;
  pags_tasks *tasks;
  pags_progress_fn *progress;
  void *user;
  int64_t object_count;
  pags_built_object *objects;
  pags_background background;
  pags_composition *composition;
  pags_usd usd;
  double time_zero, rate; /* USD time code = (time - time_zero) * rate; seconds, time codes a second */
  int degree;
  int64_t gaussians; /* bytes written */
} usd_export;

static pags_result tell(const usd_export *self, double fraction, const char *what) {
  if (self->progress && !self->progress(self->user, fraction, what))
    return pags_fail(PAGS_CANCELLED, "interrupted");
  return PAGS_OK;
}

static int tell_background(void *user, double fraction, const char *what) {
  return tell(user, 0.4 + 0.4 * fraction, what) == PAGS_OK;
}

/* ---- Proxies ---- */

static int tell_objects(void *user, double fraction, const char *what) {
  return tell(user, 0.4 * fraction, what) == PAGS_OK;
}

static pags_result make_proxies(usd_export *self, const pags_scene *scene) {
  pags_proxy_maker maker;
  self->object_count = scene->object_count;
  PAGS_TRY(pags_proxy_maker_open(scene, self->proxies, self->tasks, &maker));
  pags_result result = pags_objects_make(&maker, 0, tell_objects, self, &self->objects);
  if (result == PAGS_OK && self->proxies->background)
    result = pags_background_make(&maker, tell_background, self, &self->background);
  pags_proxy_maker_close(&maker);
  return result;
}

/* Writes `extent`, the axis-aligned bounds of the points, each point widened by its `reach` in metres (NULL:
 * none). */
static void put_extent(pags_usd *usd, const float *positions, int64_t count, const float *reach) {
  float bounds[6] = {0};
  for (int64_t i = 0; i < count; i++)
    for (int k = 0; k < 3; k++) {
      float r = reach ? reach[i] : 0, p = positions[3 * i + k];
      bounds[k] = i == 0 || p - r < bounds[k] ? p - r : bounds[k];
      bounds[3 + k] = i == 0 || p + r > bounds[3 + k] ? p + r : bounds[3 + k];
    }
  pags_usd_floats(usd, "float3[] extent", bounds, 2, 3, NULL);
}

/* Writes an attribute that changes when an object comes and goes. */
static void put_presence(usd_export *self, const pags_presence *presence, const char *attribute, const char *there,
                         const char *gone) {
  pags_usd *usd = &self->usd;
  if (!presence || presence->always)
    return;
  pags_usd_line(usd, "%s.timeSamples = {", attribute);
  if (presence->spans[0][0] > self->time_zero)
    pags_usd_line(usd, "    0: %s,", gone);
  for (int64_t i = 0; i < presence->count; i++) {
    pags_usd_line(usd, "    %.9g: %s,", fmax(0, presence->spans[i][0] - self->time_zero) * self->rate, there);
    pags_usd_line(usd, "    %.9g: %s,", (presence->spans[i][1] - self->time_zero) * self->rate, gone);
  }
  pags_usd_line(usd, "}");
}

/* `presence` may be NULL: it is there all the time. */
static void put_mesh(usd_export *self, const char *name, const char *label, const pags_proxy_mesh *mesh,
                     const char *approximation, const pags_presence *presence) {
  pags_usd *usd = &self->usd;
  float *colors = malloc(((size_t)mesh->vertex_count * 3 + 1) * sizeof *colors);
  pags_usd_line(usd, "def Mesh \"%s\" (", name);
  pags_usd_line(
      usd,
      "    prepend apiSchemas = [\"PhysicsCollisionAPI\", \"PhysicsMeshCollisionAPI\", \"SemanticsLabelsAPI:class\"]");
  pags_usd_line(usd, ")");
  pags_usd_line(usd, "{");
  usd->depth++;
  put_extent(usd, mesh->positions, mesh->vertex_count, NULL);
  pags_usd_repeat(usd, "int[] faceVertexCounts", 3, mesh->triangle_count);
  pags_usd_integers(usd, "int[] faceVertexIndices", mesh->triangles, 3 * mesh->triangle_count);
  pags_usd_floats(usd, "point3f[] points", mesh->positions, mesh->vertex_count, 3, NULL);
  for (int64_t i = 0; colors && i < 3 * mesh->vertex_count; i++) {
    double c = fmin(fmax((double)mesh->colors[i], 0), 1);
    colors[i] = (float)(c <= 0.04045 ? c / 12.92 : pags_pow((c + 0.055) / 1.055, 2.4));
  }
  if (colors)
    pags_usd_floats(usd, "color3f[] primvars:displayColor", colors, mesh->vertex_count, 3, "vertex");
  else
    usd->result = pags_out_of_memory("a mesh's colours");
  pags_usd_line(usd, "uniform token subdivisionScheme = \"none\"");
  pags_usd_line(usd, "token visibility = \"invisible\"");
  pags_usd_line(usd, "uniform token purpose = \"default\"");
  put_presence(self, presence, "bool physics:collisionEnabled", "1", "0");
  pags_usd_line(usd, "uniform token physics:approximation = \"%s\"", approximation);
  pags_usd_line(usd, "token[] semantics:labels:class = [\"%s\"]", label);
  pags_usd_close(usd);
  free(colors);
}

/* ---- Gaussians ---- */

/* The attributes of a splat prim, arrays in one block of memory. */
typedef struct columns {
  float *positions, *orientations, *scales, *opacities, *harmonics, *reach, *block;
} columns;

static pags_result fill_columns(const pags_gaussians *g, int degree, columns *c) {
  size_t count = (size_t)g->count, coefficients = (size_t)pags_sh_coefficients(degree);
  c->block = malloc((count * (12 + 3 * coefficients) + 1) * sizeof *c->block);
  PAGS_CHECK_MEMORY(c->block, "%lld Gaussians", (long long)g->count);
  c->positions = c->block;
  c->orientations = c->positions + 3 * count;
  c->scales = c->orientations + 4 * count;
  c->opacities = c->scales + 3 * count;
  c->reach = c->opacities + count;
  c->harmonics = c->reach + count;
  for (int64_t i = 0; i < g->count; i++) {
    double q[4], length = 0;
    for (int k = 0; k < 4; k++) {
      q[k] = (double)pags_plane(g, PAGS_ROTATION + k)[i];
      length += q[k] * q[k];
    }
    for (int k = 0; k < 4; k++) /* w x y z, as USD's text has quaternions */
      c->orientations[4 * i + k] = length > 0 ? (float)(q[k] / sqrt(length)) : (float)(k == 0);
    c->reach[i] = 0;
    for (int k = 0; k < 3; k++) {
      c->positions[3 * i + k] = pags_plane(g, PAGS_MEAN + k)[i];
      c->scales[3 * i + k] = pags_expf(pags_plane(g, PAGS_SCALE + k)[i]);
      c->reach[i] = fmaxf(c->reach[i], 3 * c->scales[3 * i + k]);
    }
    c->opacities[i] = (float)(1 / (1 + pags_exp(-(double)pags_plane(g, PAGS_OPACITY)[i])));
    for (size_t k = 0; k < 3 * coefficients; k++)
      c->harmonics[(size_t)i * 3 * coefficients + k] =
          (int)k < 3 * pags_sh_coefficients(g->sh_degree) ? pags_plane(g, PAGS_SH + (int)k)[i] : 0;
  }
  return PAGS_OK;
}

static pags_result put_splats(usd_export *self, int64_t object) {
  pags_usd *usd = &self->usd;
  pags_gaussians g;
  columns c = {0};
  PAGS_TRY(pags_object_gaussians(self->composition, object, self->splats->time, self->degree, &g));
  pags_result result = g.count ? fill_columns(&g, self->degree, &c) : PAGS_OK;
  if (result == PAGS_OK && g.count) {
    pags_usd_open(usd, "def ParticleField3DGaussianSplat \"splats\"");
    put_extent(usd, c.positions, g.count, c.reach);
    pags_usd_floats(usd, "float[] opacities", c.opacities, g.count, 1, NULL);
    pags_usd_floats(usd, "quatf[] orientations", c.orientations, g.count, 4, NULL);
    pags_usd_floats(usd, "point3f[] positions", c.positions, g.count, 3, NULL);
    pags_usd_floats(usd, "float3[] radiance:sphericalHarmonicsCoefficients", c.harmonics,
                    g.count * pags_sh_coefficients(self->degree), 3, NULL);
    pags_usd_line(usd, "uniform int radiance:sphericalHarmonicsDegree = %d", self->degree);
    pags_usd_floats(usd, "float3[] scales", c.scales, g.count, 3, NULL);
    pags_usd_close(usd);
    self->gaussians += g.count;
  }
  free(c.block);
  pags_gaussians_destroy(&g);
  return result;
}

/* ---- Objects and the stage ---- */

/* Writes an object's track as time samples: its rotations with `turns`, else its translations. */
static void put_samples(usd_export *self, const pags_object_gaussians_track *track, int turns) {
  pags_usd *usd = &self->usd;
  double before[4] = {0};
  pags_usd_line(usd, "%s = {", turns ? "quatf xformOp:orient.timeSamples" : "double3 xformOp:translate.timeSamples");
  for (int64_t i = 0; i < track->count; i++) {
    const double *p = track->poses[i];
    const double r[9] = {p[0], p[1], p[2], p[4], p[5], p[6], p[8], p[9], p[10]};
    double q[4], along = 0;
    pags_quaternion_from_rotation(r, q);
    for (int k = 0; k < 4; k++)
      along += q[k] * before[k];
    for (int k = 0; k < 4; k++)
      before[k] = along < 0 ? -q[k] : q[k]; /* q and -q are the same rotation: the nearer one turns the shorter way */
    if (turns)
      pags_usd_line(usd, "    %.9g: (%.9g, %.9g, %.9g, %.9g),", track->times[i] * self->rate, before[0], before[1],
                    before[2], before[3]);
    else
      pags_usd_line(usd, "    %.9g: (%.9g, %.9g, %.9g),", track->times[i] * self->rate, p[3], p[7], p[11]);
  }
  pags_usd_line(usd, "}");
}

/* Writes an object's pose: a track of one pose as a constant transform, a longer one as time samples. */
static void put_pose(usd_export *self, const pags_object_gaussians_track *track) {
  pags_usd *usd = &self->usd;
  const double *p = track->poses[0];
  const double r[9] = {p[0], p[1], p[2], p[4], p[5], p[6], p[8], p[9], p[10]};
  double q[4];
  pags_quaternion_from_rotation(r, q);
  if (track->count > 1) {
    put_samples(self, track, 1);
    put_samples(self, track, 0);
  } else {
    pags_usd_line(usd, "quatf xformOp:orient = (%.9g, %.9g, %.9g, %.9g)", q[0], q[1], q[2], q[3]);
    pags_usd_line(usd, "double3 xformOp:translate = (%.9g, %.9g, %.9g)", p[3], p[7], p[11]);
  }
  pags_usd_line(usd, "uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:orient\"]");
}

static void put_custom(usd_export *self, const pags_scene_object *o, int64_t number) {
  pags_usd *usd = &self->usd;
  char track[NAME_SIZE];
  pags_usd_name(o->record.id, track, sizeof track);
  pags_usd_line(usd, "    customData = {");
  pags_usd_line(usd, "        bool critical = %d", o->critical != 0);
  pags_usd_line(usd, "        string level = \"%s\"",
                pags_proxy_level_name(self->objects[number].levels[0].facts.level));
  pags_usd_line(usd, "        bool moving = %d", o->record.moving != 0);
  pags_usd_line(usd, "        int number = %lld", (long long)number);
  pags_usd_line(usd, "        double3 size = (%.9g, %.9g, %.9g)", o->record.size[0], o->record.size[1],
                o->record.size[2]);
  pags_usd_line(usd, "        string track = \"%s\"", track);
  pags_usd_line(usd, "    }");
}

static const char *const approximations[PAGS_PROXY_LEVELS] = {"none", "none", "convexHull", "boundingCube",
                                                              "convexHull"};

static pags_result put_object(usd_export *self, int64_t object) {
  const pags_scene_object *o = &pags_composition_scene(self->composition)->objects[object];
  pags_usd *usd = &self->usd;
  pags_object_gaussians_track track;
  char plain[NAME_SIZE], label[NAME_SIZE], name[NAME_SIZE];
  pags_class_plain_name(o->record.class_name, plain);
  pags_usd_name(plain, label, sizeof label - 16);
  snprintf(name, sizeof name, "%.60s_%04lld", label, (long long)object);
  PAGS_TRY(pags_object_gaussians_track_make(self->composition, object, self->time_zero, &track));
  pags_usd_line(usd, "def Xform \"%s\" (", name);
  put_custom(self, o, object);
  pags_usd_line(usd, "    prepend apiSchemas = [\"PhysicsRigidBodyAPI\", \"SemanticsLabelsAPI:class\"]");
  pags_usd_line(usd, ")");
  pags_usd_line(usd, "{");
  usd->depth++;
  pags_usd_line(usd, "bool physics:kinematicEnabled = 1");
  pags_usd_line(usd, "token[] semantics:labels:class = [\"%s\"]", label);
  put_pose(self, &track);
  pags_object_gaussians_track_destroy(&track);
  pags_presence presence;
  pags_result result = pags_presence_find(pags_composition_scene(self->composition), object, &presence);
  if (result == PAGS_OK)
    put_presence(self, &presence, "token visibility", "\"inherited\"", "\"invisible\"");
  if (result == PAGS_OK)
    result = put_splats(self, object);
  const pags_built_level *built = &self->objects[object].levels[0];
  if (result == PAGS_OK && !built->parts.count)
    put_mesh(self, "proxy", label, &built->mesh, approximations[built->facts.level], &presence);
  for (int i = 0; i < built->parts.count && result == PAGS_OK; i++) {
    pags_proxy_mesh part;
    result = pags_convex_part(&built->mesh, &built->parts, i, &part);
    if (result != PAGS_OK)
      break;
    snprintf(name, sizeof name, "proxy_%02d", i);
    put_mesh(self, name, label, &part, approximations[built->facts.level], &presence);
    pags_proxy_mesh_destroy(&part);
  }
  pags_presence_destroy(&presence);
  pags_usd_close(usd);
  return result;
}

static pags_result put_background(usd_export *self) {
  pags_usd *usd = &self->usd;
  char name[NAME_SIZE];
  pags_usd_open(usd, "def Xform \"background\"");
  pags_result result = put_splats(self, -1);
  for (int64_t i = 0; i < self->background.chunk_count && result == PAGS_OK; i++) {
    const pags_chunk *chunk = &self->background.chunks[i];
    snprintf(name, sizeof name, "%s_%03d", chunk->class_name, chunk->number);
    put_mesh(self, name, chunk->class_name, &chunk->mesh, approximations[chunk->level], NULL);
  }
  pags_usd_close(usd);
  return result;
}

static void put_head(usd_export *self, const pags_scene *scene) {
  pags_usd *usd = &self->usd;
  pags_usd_line(usd, "(");
  pags_usd_line(usd, "    customLayerData = {");
  pags_usd_line(usd, "        bool antialiased = %d", scene->antialiased != 0);
  pags_usd_line(usd, "        double3 origin = (%.17g, %.17g, %.17g)", scene->origin[0], scene->origin[1],
                scene->origin[2]);
  if (scene->place.known)
    pags_usd_line(usd, "        double3 geographicOrigin = (%.17g, %.17g, %.17g)", scene->place.latitude,
                  scene->place.longitude, scene->place.altitude);
  pags_usd_line(usd, "        double timeZero = %.17g", self->time_zero);
  pags_usd_line(usd, "    }");
  pags_usd_line(usd, "    defaultPrim = \"scene\"");
  pags_usd_line(usd, "    endTimeCode = %.9g", fmax(0, (scene->time_end - self->time_zero) * self->rate));
  pags_usd_line(usd, "    framesPerSecond = %.9g", self->rate);
  pags_usd_line(usd, "    metersPerUnit = 1");
  pags_usd_line(usd, "    startTimeCode = 0");
  pags_usd_line(usd, "    timeCodesPerSecond = %.9g", self->rate);
  pags_usd_line(usd, "    upAxis = \"Z\"");
  pags_usd_line(usd, ")");
}

static pags_result put_stage(usd_export *self) {
  const pags_scene *scene = pags_composition_scene(self->composition);
  pags_usd *usd = &self->usd;
  put_head(self, scene);
  pags_usd_line(usd, "def Xform \"scene\" (");
  pags_usd_line(usd, "    kind = \"assembly\"");
  pags_usd_line(usd, ")");
  pags_usd_line(usd, "{");
  usd->depth++;
  if (scene->up != PAGS_UP_Z) { /* worlds with -y up are turned by -90 degrees about x to z up, those with y up by 90 */
    pags_usd_line(usd, "float xformOp:rotateX = %d", scene->up == PAGS_UP_Y ? 90 : -90);
    pags_usd_line(usd, "uniform token[] xformOpOrder = [\"xformOp:rotateX\"]");
  }
  pags_usd_open(usd, "def PhysicsScene \"physics\"");
  pags_usd_line(usd, "vector3f physics:gravityDirection = (0, 0, -1)");
  pags_usd_line(usd, "float physics:gravityMagnitude = 9.81");
  pags_usd_close(usd);
  pags_result result = self->proxies->background ? put_background(self) : PAGS_OK;
  for (int64_t i = 0; i < scene->object_count && result == PAGS_OK; i++) {
    result = tell(self, 0.8 + 0.2 * (double)i / (double)scene->object_count, "writing");
    if (result == PAGS_OK && self->objects[i].level_count)
      result = put_object(self, i);
  }
  pags_usd_close(usd);
  return result;
}

static pags_result write_stage(usd_export *self, const char *path) {
  const pags_scene *scene = pags_composition_scene(self->composition);
  self->time_zero = scene->time_begin;
  for (int64_t i = 0; i < scene->object_count; i++)
    self->time_zero = fmin(self->time_zero, scene->objects[i].record.keyframes[0].time);
  self->rate = scene->fps > 0 ? scene->fps : 24;
  PAGS_TRY(pags_object_gaussians_degree(self->composition, self->splats->sh_degree, &self->degree));
  self->degree = self->degree > 0 ? PADDED_DEGREE : 0;
  pags_usd_begin(&self->usd, path);
  pags_result result = put_stage(self);
  if (result != PAGS_OK)
    self->usd.result = result;
  return pags_usd_end(&self->usd);
}

pags_result pags_export_usd(pags_scene *scene, const char *path, const pags_proxy_options *proxies,
                            const pags_splat_options *splats, pags_tasks *tasks, pags_progress_fn *progress, void *user,
                            int64_t *count) {
  pags_proxy_options plain = *proxies; /* names of programs and textures are for glTF */
  plain.naming = PAGS_NAMING_PLAIN;
  plain.texture = 0;
  usd_export self = {.proxies = &plain, .splats = splats, .tasks = tasks, .progress = progress, .user = user};
  pags_result result = make_proxies(&self, scene);
  if (result == PAGS_OK)
    result = pags_composition_create(scene, &self.composition);
  if (result == PAGS_OK)
    result = write_stage(&self, path);
  if (count)
    *count = self.gaussians;
  pags_objects_destroy(self.objects, self.object_count);
  pags_background_destroy(&self.background);
  pags_composition_destroy(self.composition);
  return result;
}
