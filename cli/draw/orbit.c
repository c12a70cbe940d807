/* SPDX-License-Identifier: Apache-2.0 */
/* Orbits: closed paths around the centre of a scene. Distance and height of the camera vary with azimuth: it stays near
 * the training cameras; without photographs, at a distance that shows the whole object, or inside the room
 * (scene/survey.h); and outside of walls. World coordinates are absolute, in double. */
#include <math.h>

#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "cli/draw/camera_paths.h"
#include "maths/maths.h"
#include "scene/survey.h"

enum { AZIMUTHS = 72, SPREAD = 4 }; /* SPREAD: azimuths on either side that are smoothed over */
enum { DEFAULT_WIDTH = 1280, DEFAULT_HEIGHT = 720, OBJECT_FOCAL = 1000, ROOM_FOCAL = 700 };

static const double pi = 3.14159265358979323846;
static const double closed =
    1; /* room cells per solid cell: a lower ratio is a street or a corner, which is better seen from outside */

/* ---- Vectors by value, and columns of a camera's pose ---- */

typedef struct vec3 {
  double x, y, z;
} vec3;

static vec3 vec_add(vec3 a, vec3 b) {
  return (vec3){a.x + b.x, a.y + b.y, a.z + b.z};
}
static vec3 vec_scale(vec3 a, double s) {
  return (vec3){a.x * s, a.y * s, a.z * s};
}
static vec3 vec_sub(vec3 a, vec3 b) {
  return (vec3){a.x - b.x, a.y - b.y, a.z - b.z};
}
static double vec_dot(vec3 a, vec3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
static double vec_length(vec3 a) {
  return sqrt(vec_dot(a, a));
}
static vec3 vec_cross(vec3 a, vec3 b) {
  return (vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static vec3 vec_normalized(vec3 a) {
  double l = vec_length(a);
  return l > 0 ? vec_scale(a, 1 / l) : a;
}

/* Returns column `c` of world_from_camera: 0 right, 1 down, 2 forward, 3 position. */
static vec3 column_of(const pags_camera *camera, int c) {
  const double *m = camera->world_from_camera;
  return (vec3){m[c], m[4 + c], m[8 + c]};
}

static void set_column(pags_camera *camera, int c, vec3 v) {
  double *m = camera->world_from_camera;
  m[c] = v.x;
  m[4 + c] = v.y;
  m[8 + c] = v.z;
}

/* ---- Orbits ---- */

/* An orbit's geometry and lens. */
typedef struct orbit {
  vec3 centre, up, u, v;                     /* u, v: axes of the horizontal plane */
  double radius[AZIMUTHS], height[AZIMUTHS]; /* horizontal distance of the eye from the centre; height above it */
  double middle_angle, half_arc;             /* of the azimuths covered; half_arc = pi: a full turn */
  pags_camera lens;
} orbit;

static vec3 scene_up(const pags_scene *scene) {
  return scene->up == PAGS_UP_Z ? (vec3){0, 0, 1} : (vec3){0, scene->up == PAGS_UP_Y ? 1 : -1, 0};
}

/* The mean of the cameras' up axes if they agree; else the up axis of the scene. */
static vec3 cameras_up(const pags_scene *scene) {
  vec3 sum = {0, 0, 0};
  for (int64_t i = 0; i < scene->view_count; i++)
    sum = vec_sub(sum, column_of(&scene->views[i].camera, 1));
  return vec_length(sum) > 0.3 * (double)scene->view_count ? vec_normalized(sum) : scene_up(scene);
}

void pags_cameras_up(const pags_scene *scene, double out[3]) {
  const vec3 up = cameras_up(scene);
  pags_copy3((const double[3]){up.x, up.y, up.z}, out);
}

static pags_camera default_lens(double focal) {
  return (pags_camera){.width = DEFAULT_WIDTH,
                       .height = DEFAULT_HEIGHT,
                       .fx = focal,
                       .fy = focal,
                       .cx = DEFAULT_WIDTH / 2.0,
                       .cy = DEFAULT_HEIGHT / 2.0,
                       .time = (double)NAN};
}

static void stand_up(orbit *o, vec3 up) {
  o->up = up;
  o->u = vec_normalized(vec_cross(up, fabs(up.x) < 0.9 ? (vec3){1, 0, 0} : (vec3){0, 1, 0}));
  o->v = vec_cross(up, o->u);
}

/* ---- The eye ---- */

/* Interpolates radius or height of the camera at an azimuth (radians). */
static double at_azimuth(const double values[AZIMUTHS], double angle) {
  const double turn = angle / (2 * pi), place = (turn - floor(turn)) * AZIMUTHS;
  const int i = (int)place % AZIMUTHS;
  const double t = place - floor(place);
  return (1 - t) * values[i] + t * values[(i + 1) % AZIMUTHS];
}

static vec3 eye_at(const orbit *o, double angle, double radius, double height) {
  const vec3 across = vec_add(vec_scale(o->u, pags_cos(angle)), vec_scale(o->v, pags_sin(angle)));
  return vec_add(o->centre, vec_add(vec_scale(across, radius), vec_scale(o->up, height)));
}

/* Orients a camera from `eye` towards the centre, with its picture as upright as possible. */
static void look_from(const orbit *o, vec3 eye, pags_camera *camera) {
  const vec3 forward = vec_normalized(vec_sub(o->centre, eye));
  vec3 right = vec_cross(forward, o->up);
  if (vec_length(right) < 1e-6) /* looking straight up or down: any right axis will do */
    right = vec_cross(forward, fabs(forward.x) < 0.9 ? (vec3){1, 0, 0} : (vec3){0, 1, 0});
  right = vec_normalized(right);
  *camera = o->lens;
  set_column(camera, 0, right);
  set_column(camera, 1, vec_cross(forward, right));
  set_column(camera, 2, forward);
  set_column(camera, 3, eye);
}

/* Smooths distances along the circle without increasing any: minimum over the neighbours, then mean of the minima. */
static void smooth_down(double values[AZIMUTHS]) {
  double least[AZIMUTHS];
  for (int i = 0; i < AZIMUTHS; i++) {
    least[i] = values[i];
    for (int j = -SPREAD; j <= SPREAD; j++)
      least[i] = fmin(least[i], values[(i + j + AZIMUTHS) % AZIMUTHS]);
  }
  for (int i = 0; i < AZIMUTHS; i++) {
    values[i] = 0;
    for (int j = -SPREAD; j <= SPREAD; j++)
      values[i] += least[(i + j + AZIMUTHS) % AZIMUTHS] / (2 * SPREAD + 1);
  }
}

/* A point of the survey, which is relative to the scene's origin, in absolute coordinates. */
static vec3 from_origin(const pags_scene *scene, double x, double y, double z) {
  return (vec3){x + scene->origin[0], y + scene->origin[1], z + scene->origin[2]};
}

static int cell_of(const pags_scene *scene, const pags_survey *survey, vec3 p) {
  const double own[3] = {p.x - scene->origin[0], p.y - scene->origin[1], p.z - scene->origin[2]};
  return pags_survey_cell(survey, own);
}

/* ---- Without photographs ---- */

/* Whether all corners of the box show, with some margin, from all azimuths at this distance. */
static bool shows_box(const orbit *o, const vec3 corners[8], double radius, double slope) {
  for (int a = 0; a < AZIMUTHS; a += 3) {
    pags_camera camera;
    look_from(o, eye_at(o, 2 * pi * a / AZIMUTHS, radius, slope * radius), &camera);
    for (int i = 0; i < 8; i++) {
      const vec3 p = vec_sub(corners[i], column_of(&camera, 3));
      const double z = vec_dot(p, column_of(&camera, 2)), margin = 0.94;
      if (!(z > 0.05 * radius) || fabs(vec_dot(p, column_of(&camera, 0))) * camera.fx > margin * camera.cx * z ||
          fabs(vec_dot(p, column_of(&camera, 1))) * camera.fy > margin * camera.cy * z)
        return false;
    }
  }
  return true;
}

/* Orbit around an object, as near as possible with the whole box in the picture. */
static void orbit_of_box(const pags_scene *scene, const pags_survey *survey, orbit *o) {
  static const double slope = 0.25; /* looking a little down */
  const double *lo = survey->lo, *hi = survey->hi;
  vec3 corners[8];
  for (int i = 0; i < 8; i++)
    corners[i] = from_origin(scene, i & 1 ? hi[0] : lo[0], i & 2 ? hi[1] : lo[1], i & 4 ? hi[2] : lo[2]);
  const double diagonal = fmax(vec_length(vec_sub(corners[7], corners[0])), 1e-3);
  double near = 0.3 * diagonal, far = 8 * diagonal;
  o->centre = vec_scale(vec_add(corners[0], corners[7]), 0.5);
  o->lens = default_lens(OBJECT_FOCAL);
  for (int i = 0; i < 24; i++) {
    const double between = 0.5 * (near + far);
    if (shows_box(o, corners, between, slope))
      far = between;
    else
      near = between;
  }
  for (int a = 0; a < AZIMUTHS; a++) {
    o->radius[a] = far;
    o->height[a] = slope * far;
  }
}

/* Orbit inside a room: looks from its sides across the centre, at 7/8 of the distance to the wall. */
static void orbit_of_room(const pags_scene *scene, const pags_survey *survey, orbit *o) {
  double sorted[AZIMUTHS];
  const double *m = survey->middle, reach = survey->step * (survey->n[0] + survey->n[1] + survey->n[2]);
  o->centre = from_origin(scene, m[0], m[1], m[2]);
  o->lens = default_lens(ROOM_FOCAL);
  for (int a = 0; a < AZIMUTHS; a++) {
    double begins = 0, ends = 0;
    for (double r = 0; r < reach; r += 0.5 * survey->step) {
      const int cell = cell_of(scene, survey, eye_at(o, 2 * pi * a / AZIMUTHS, r, 0));
      if (cell != PAGS_CELL_ROOM && ends > 0)
        break;
      if (cell == PAGS_CELL_ROOM && ends == 0)
        begins = r;
      if (cell == PAGS_CELL_ROOM)
        ends = r;
    }
    sorted[a] = o->radius[a] = fmax(0.875 * ends, begins);
    o->height[a] = 0;
  }
  pags_sort_doubles(sorted, AZIMUTHS);
  const double usual = fmax(sorted[AZIMUTHS / 2], survey->step);
  for (int a = 0; a < AZIMUTHS; a++)
    o->radius[a] = fmin(o->radius[a], 1.5 * usual);
  smooth_down(o->radius);
}

/* ---- With photographs ---- */

/* Solves the symmetric 3x3 system a x = b by Cramer's rule; returns false if the determinant is nearly 0 relative to
 * the trace. */
static bool solve3(const double a[6], vec3 b, vec3 *x) { /* a: xx xy xz yy yz zz */
  vec3 r0 = {a[0], a[1], a[2]}, r1 = {a[1], a[3], a[4]}, r2 = {a[2], a[4], a[5]};
  double determinant = vec_dot(r0, vec_cross(r1, r2)), trace = (a[0] + a[3] + a[5]) / 3;
  if (!(fabs(determinant) > 1e-4 * trace * trace * trace))
    return false;
  vec3 sum = vec_add(vec_add(vec_scale(vec_cross(r1, r2), b.x), vec_scale(vec_cross(r2, r0), b.y)),
                     vec_scale(vec_cross(r0, r1), b.z));
  *x = vec_scale(sum, 1 / determinant);
  return true;
}

/* Finds the point with the least sum of squared distances to the views' optical axes: sum (I - d d') (x - p) = 0.
 * Returns false if the axes are nearly parallel or the point isn't in front of most cameras. */
static bool nearest_to_axes(const pags_scene *scene, vec3 *out) {
  double a[6] = {0};
  vec3 b = {0, 0, 0}, base = column_of(&scene->views[0].camera, 3);
  int64_t ahead = 0;
  for (int64_t i = 0; i < scene->view_count; i++) {
    vec3 d = column_of(&scene->views[i].camera, 2), p = vec_sub(column_of(&scene->views[i].camera, 3), base);
    double m[6] = {1 - d.x * d.x, -d.x * d.y, -d.x * d.z, 1 - d.y * d.y, -d.y * d.z, 1 - d.z * d.z};
    for (int k = 0; k < 6; k++)
      a[k] += m[k];
    b = vec_add(b, vec_sub(p, vec_scale(d, vec_dot(d, p))));
  }
  if (!solve3(a, b, out))
    return false;
  *out = vec_add(*out, base);
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_camera *camera = &scene->views[i].camera;
    ahead += vec_dot(vec_sub(*out, column_of(camera, 3)), column_of(camera, 2)) > 0;
  }
  /* for cameras that look outwards, the point nearest to their axes lies behind them */
  return ahead * 10 >= scene->view_count * 8;
}

/* Keeps the camera near the training cameras: distance and height are weighted means, with a Gaussian weight in
 * azimuth. */
static void follow_cameras(const double *angles, const double *radii, const double *heights, int64_t count, orbit *o) {
  static const double like = 0.25; /* radians */
  for (int a = 0; a < AZIMUTHS; a++) {
    double weight = 1e-12, radius = 0, height = 0;
    for (int64_t i = 0; i < count; i++) {
      const double turn = (angles[i] - 2 * pi * a / AZIMUTHS) / (2 * pi), off = 2 * pi * (turn - floor(turn + 0.5));
      const double w = 1e-9 + pags_exp(-0.5 * off * off / (like * like));
      weight += w;
      radius += w * radii[i];
      height += w * heights[i];
    }
    o->radius[a] = fmax(radius / weight, 1e-3);
    o->height[a] = height / weight;
  }
}

/* Finds the arc that the sorted azimuths cover: everything but the widest gap between two of them. */
static void find_arc(double *angles, int64_t count, orbit *o) {
  pags_sort_doubles(angles, count);
  double widest = angles[0] + 2 * pi - angles[count - 1], start = angles[0];
  for (int64_t i = 1; i < count; i++)
    if (angles[i] - angles[i - 1] > widest) {
      widest = angles[i] - angles[i - 1];
      start = angles[i];
    }
  o->half_arc = widest < pi / 2 ? pi : (2 * pi - widest) / 2;
  o->middle_angle = start + (2 * pi - widest) / 2;
}

static pags_result orbit_of_views(const pags_scene *scene, const pags_survey *survey, orbit *o) {
  const size_t count = (size_t)scene->view_count;
  PAGS_AUTOFREE double *radii = malloc(3 * count * sizeof *radii);
  PAGS_CHECK_MEMORY(radii, NULL);
  double *const heights = radii + count, *const angles = heights + count;
  if (!nearest_to_axes(scene, &o->centre))
    o->centre = from_origin(scene, survey->middle[0], survey->middle[1], survey->middle[2]);
  stand_up(o, cameras_up(scene));
  for (size_t i = 0; i < count; i++) {
    const vec3 offset = vec_sub(column_of(&scene->views[i].camera, 3), o->centre);
    heights[i] = vec_dot(offset, o->up);
    radii[i] = pags_hypot(vec_dot(offset, o->u), vec_dot(offset, o->v));
    angles[i] = pags_atan2(vec_dot(offset, o->v), vec_dot(offset, o->u));
  }
  follow_cameras(angles, radii, heights, scene->view_count, o);
  find_arc(angles, scene->view_count, o);
  o->lens = scene->views[0].camera;
  o->lens.lens = (pags_lens_model){0}; /* pictures of an orbit are pinholes' */

  /* Moves the camera towards the centre where it would be inside something solid. */
  for (int a = 0; a < AZIMUTHS; a++)
    for (int k = 0; k < 40; k++) {
      const vec3 eye = eye_at(o, 2 * pi * a / AZIMUTHS, o->radius[a], o->height[a]);
      const vec3 beyond = eye_at(o, 2 * pi * a / AZIMUTHS, o->radius[a] + 2 * survey->step, o->height[a]);
      if (cell_of(scene, survey, eye) != PAGS_CELL_SOLID && cell_of(scene, survey, beyond) != PAGS_CELL_SOLID)
        break;
      o->radius[a] *= 0.96;
    }
  smooth_down(o->radius);
  return PAGS_OK;
}

/* The same without outlying cameras. */
static pags_result orbit_of_near_views(const pags_scene *scene, const pags_survey *survey, orbit *o) {
  const size_t count = (size_t)scene->view_count;
  const double *lo = survey->lo, *hi = survey->hi;
  pags_far_cameras found;
  pags_scene near = *scene;
  PAGS_AUTOFREE double *positions = malloc(3 * count * sizeof *positions);
  PAGS_AUTOFREE bool *far = malloc(count * sizeof *far);
  PAGS_AUTOFREE pags_scene_view *views = malloc(count * sizeof *views);
  PAGS_CHECK_MEMORY(positions && far && views, NULL);
  for (size_t i = 0; i < count; i++)
    pags_pose_position(scene->views[i].camera.world_from_camera, positions + 3 * i);
  PAGS_TRY(pags_far_cameras_find(positions, scene->view_count,
                                 fmax(fmax(hi[0] - lo[0], hi[1] - lo[1]), hi[2] - lo[2]) / 2, far, &found));
  near.views = views;
  near.view_count = 0;
  for (size_t i = 0; i < count; i++)
    if (!far[i])
      views[near.view_count++] = scene->views[i];
  return orbit_of_views(&near, survey, o);
}

/* Orbit for a drive, whose cameras look along a street and have no common centre: circles above a place ahead of the
 * mean camera position, nearer where something is in the way. */
static void orbit_of_drive(const pags_scene *scene, const pags_survey *survey, orbit *o) {
  enum { AHEAD = 6, RADIUS = 14, HEIGHT = 9 }; /* metres; low enough to show the sides that the cameras saw */
  const vec3 base = column_of(&scene->views[0].camera, 3);
  vec3 sum = {0, 0, 0};
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_camera *camera = &scene->views[i].camera;
    sum = vec_add(sum, vec_add(vec_sub(column_of(camera, 3), base), vec_scale(column_of(camera, 2), AHEAD)));
  }
  o->centre = vec_add(base, vec_scale(sum, 1.0 / (double)scene->view_count));
  o->lens = scene->views[0].camera;
  o->lens.lens = (pags_lens_model){0}; /* pictures of an orbit are pinholes' */
  for (int a = 0; a < AZIMUTHS; a++) {
    double share = 0.35; /* anything nearer to the centre is the subject */
    while (share < 1 &&
           cell_of(scene, survey, eye_at(o, 2 * pi * a / AZIMUTHS, share * RADIUS, share * HEIGHT)) != PAGS_CELL_SOLID)
      share += 0.02;
    o->radius[a] = RADIUS * fmin(share < 1 ? share - 0.06 : 1, 1);
  }
  smooth_down(o->radius);
  for (int a = 0; a < AZIMUTHS; a++)
    o->height[a] = o->radius[a] * HEIGHT / RADIUS;
}

/* ---- The path ---- */

pags_result pags_camera_path_orbit(const pags_scene *scene, int64_t frames, pags_stand stand, pags_camera_path *out) {
  orbit o = {.half_arc = pi};
  PAGS_AUTO(pags_survey_destroy) pags_survey survey = {0};
  if (!scene->view_count && !pags_scene_gaussian_count(scene))
    return pags_fail(PAGS_ERROR_ARGUMENT, "an orbit needs at least one Gaussian or camera; the scene has none");
  PAGS_TRY(pags_survey_make(scene, &survey));
  stand_up(&o, scene_up(scene));
  if (stand == PAGS_STAND_AUTO && pags_scene_is_drive(scene))
    orbit_of_drive(scene, &survey, &o);
  else if (stand == PAGS_STAND_AUTO && scene->view_count > 1)
    PAGS_TRY(orbit_of_near_views(scene, &survey, &o));
  else if (stand == PAGS_STAND_INSIDE || (stand == PAGS_STAND_AUTO && survey.inside && survey.surrounded > closed))
    orbit_of_room(scene, &survey, &o);
  else
    orbit_of_box(scene, &survey, &o);
  PAGS_TRY(pags_camera_path_create(frames, out));
  for (int64_t i = 0; i < frames; i++) {
    const double turn = 2 * pi * (double)i / (double)frames;
    const double angle = o.middle_angle + (o.half_arc >= pi ? turn : o.half_arc * pags_sin(turn));
    look_from(&o, eye_at(&o, angle, at_azimuth(o.radius, angle), at_azimuth(o.height, angle)), &out->cameras[i]);
  }
  return PAGS_OK;
}
