/* SPDX-License-Identifier: Apache-2.0 */
/* The growing lists of a street's meshes, placements and actors, and the motion and the cameras of the ego
 * vehicle. */
#include "synth/street.h"

#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

#define TWO_PI 6.283185307179586

int pags_street_mesh(pags_street *street) {
  street->failed |= !pags_grow(&street->meshes, street->mesh_count + 1, &street->mesh_capacity, sizeof *street->meshes);
  if (street->failed)
    return 0;
  street->meshes[street->mesh_count] = (pags_mesh){0};
  return street->mesh_count++;
}

int pags_street_place(pags_street *street, int mesh, int actor, float x, float y, float z, float yaw, float scale) {
  street->failed |= !pags_grow(&street->placements, street->placement_count + 1, &street->placement_capacity,
                               sizeof *street->placements);
  if (street->failed)
    return 0;
  const float c = scale * pags_cosf(yaw), s = scale * pags_sinf(yaw);
  street->placements[street->placement_count] =
      (pags_stage_placement){.mesh = mesh, .actor = actor, .pose = {c, -s, 0, x, s, c, 0, y, 0, 0, scale, z}};
  return street->placement_count++;
}

int pags_street_actor(pags_street *street, const pags_actor *actor) {
  street->failed |=
      !pags_grow(&street->actors, street->actor_count + 1, &street->actor_capacity, sizeof *street->actors);
  if (street->failed)
    return 0;
  street->actors[street->actor_count] = *actor;
  return street->actor_count++;
}

bool pags_street_is_complete(const pags_street *street) {
  bool failed = street->failed || street->materials.failed;
  for (int i = 0; i < street->mesh_count; i++)
    failed |= street->meshes[i].failed;
  return !failed;
}

void pags_street_destroy(pags_street *street) {
  for (int i = 0; i < street->mesh_count; i++)
    pags_mesh_destroy(&street->meshes[i]);
  free(street->meshes);
  free(street->placements);
  free(street->actors);
  pags_materials_destroy(&street->materials);
  *street = (pags_street){0};
}

/* How the ego vehicle's way at 10 m/s and its place in the lane vary: waves of metres, their radians a second, and the
 * product of both, metres a second. */
typedef struct drive {
  double ahead, ahead_rate, ahead_speed, aside, aside_rate, aside_speed;
} drive;

/* Steadily, its speed varies by a tenth; lively, it brakes and speeds up by 3.2 m/s2 and turns by 6 degrees to either
 * side. */
static drive drive_of(const pags_street_options *options) {
  return options->lively ? (drive){4.0, 0.9, 3.6, 0.8, 1.3, 1.04} : (drive){0.9, 1.1, 0.99, 0.22, 0.9, 0.198};
}

double pags_street_ego_x(const pags_street_options *options, double time) {
  const drive d = drive_of(options);
  return 10.0 * time + d.ahead * pags_sin(d.ahead_rate * time);
}

void pags_street_ego(const pags_street_options *options, double time, double pose[12]) {
  const drive d = drive_of(options);
  const double forward = 10.0 + d.ahead_speed * pags_cos(d.ahead_rate * time),
               aside = d.aside_speed * pags_cos(d.aside_rate * time + 0.4);
  const double yaw = pags_atan2(aside, forward), pitch = 0.003 * pags_sin(5.0 * time),
               roll = 0.003 * pags_sin(3.7 * time + 1.0);
  const double cy = pags_cos(yaw), sy = pags_sin(yaw), cp = pags_cos(pitch), sp = pags_sin(pitch), cr = pags_cos(roll),
               sr = pags_sin(roll);
  const double out[12] = {cy * cp,
                          cy * sp * sr - sy * cr,
                          cy * sp * cr + sy * sr,
                          pags_street_ego_x(options, time),
                          sy * cp,
                          sy * sp * sr + cy * cr,
                          sy * sp * cr - cy * sr,
                          PAGS_EGO_LANE + d.aside * pags_sin(d.aside_rate * time + 0.4),
                          -sp,
                          cp * sr,
                          cp * cr,
                          0.0};
  memcpy(pose, out, sizeof out);
}

void pags_street_mount(int camera, double pose[12]) {
  static const double yaws[3] = {0.0, 50.0, -50.0},
                      places[3][3] = {{1.6, 0.0, 1.6}, {1.5, 0.25, 1.6}, {1.5, -0.25, 1.6}};
  const double yaw = yaws[camera] * TWO_PI / 360.0, pitch = 0.02; /* radians, downwards */
  const double c = pags_cos(yaw), s = pags_sin(yaw), cp = pags_cos(pitch), sp = pags_sin(pitch);
  const double out[12] = {s,   -c * sp, c * cp, places[camera][0], /* columns: right, down, forward, position */
                          -c,  -s * sp, s * cp, places[camera][1], /* of the camera, in the ego frame */
                          0.0, -cp,     -sp,    places[camera][2]};
  memcpy(pose, out, sizeof out);
}

pags_camera pags_street_camera(const pags_street_options *options, double time, int camera, double right, double up) {
  double ego[12], mount[12];
  pags_camera out = {.width = options->width, .height = options->height, .time = time};
  out.fx = out.fy = 0.8 * options->width;
  out.cx = 0.5 * options->width;
  out.cy = 0.5 * options->height;
  pags_street_ego(options, time, ego);
  pags_street_mount(camera, mount);
  pags_rigid_multiply(ego, mount, out.world_from_camera);
  for (int k = 0; k < 3; k++)
    out.world_from_camera[4 * k + 3] += right * out.world_from_camera[4 * k] + up * ego[4 * k + 2];
  return out;
}
