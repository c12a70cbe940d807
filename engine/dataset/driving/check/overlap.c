/* SPDX-License-Identifier: Apache-2.0 */
/* Tells by two sweeps whether their poses belong to them: what stands still is met twice.
 *
 * Two sweeps between which the car has driven some metres are put into the world, and the share of the points of one
 * that lie in a voxel of the other is measured. It is measured again with the points left where they are, which fits
 * better if they are in the world's frame already, with the inverse poses, and with the points turned about z. Points
 * near the ground don't count, since a road fits a road anywhere. */
#include "dataset/driving/check/checks.h"
#include "dataset/driving/reader.h"

#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"

#include <pags/camera.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_POINTS = 1500, MOST_HEIGHTS = 256, SLOTS = 4096 };

/* Metres: side of a voxel, distance driven between the sweeps (least, best), height above the ground and distance from
 * the car of the points that count. */
static const double voxel = 1, least_way = 2, best_way = 6, above_ground = 0.7, reach = 60;
/* Another reading of the poses is reported if its share is larger by the first number and at least the second. */
static const double least_ratio = 1.4, least_share = 0.35;

typedef struct points {
  int64_t count;
  float xyz[MOST_POINTS][3];
  double pose[12];
} points;

typedef struct work {
  points a, b;
  uint64_t slots[SLOTS]; /* the voxels of one sweep */
} work;

/* Takes at most MOST_POINTS points of a sweep that are above the ground, which is where a fifth of all are below. */
static pags_result take(const pags_driving *driving, int64_t index, points *out) {
  float heights[MOST_HEIGHTS];
  PAGS_AUTOFREE float *xyz = NULL;
  int64_t count, looked = 0;
  PAGS_TRY(pags_sweep_read(driving, index, &count, &xyz, NULL));
  for (int64_t i = 0; i < MOST_HEIGHTS && count > 0; i++)
    heights[looked++] = xyz[3 * (i * count / MOST_HEIGHTS) + 2];
  pags_sort_floats(heights, looked);
  const double ground = looked ? (double)heights[looked / 5] + above_ground : 0;
  const int64_t step = count / (2 * MOST_POINTS) + 1;
  out->count = 0;
  for (int64_t i = 0; i < count && out->count < MOST_POINTS; i += step) {
    const float *p = xyz + 3 * i;
    if ((double)p[2] > ground)
      memcpy(out->xyz[out->count++], p, sizeof out->xyz[0]);
  }
  memcpy(out->pose, driving->sweeps[index].world_from_sweep, sizeof out->pose);
  return PAGS_OK;
}

/* Whether a point, moved by the pose, can be counted; *key: its voxel. */
static bool voxel_of(const points *from, int64_t index, const double pose[12], uint64_t *key) {
  double p[3], world[3];
  pags_widen3(from->xyz[index], p);
  pags_rigid_point(pose, p, world);
  *key = 0;
  for (int k = 0; k < 3; k++) {
    const double at = floor(world[k] / voxel);
    if (!(fabs(at) < 1e9))
      return false;
    *key = *key * 2000003 + (uint64_t)(int64_t)at;
  }
  *key |= (uint64_t)1 << 63; /* no key is zero */
  return true;
}

static int64_t slot_of(const uint64_t *slots, uint64_t key) {
  int64_t slot = (int64_t)((key * 0x9E3779B97F4A7C15u) >> 52);
  while (slots[slot] && slots[slot] != key)
    slot = (slot + 1) % SLOTS;
  return slot;
}

/* Returns the share of b's points that lie in a voxel of a's, each moved by its pose. */
static double overlap(const points *a, const double pose_a[12], const points *b, const double pose_b[12],
                      uint64_t *slots) {
  int64_t hits = 0;
  uint64_t key;
  memset(slots, 0, SLOTS * sizeof *slots);
  for (int64_t i = 0; i < a->count; i++)
    if (voxel_of(a, i, pose_a, &key))
      slots[slot_of(slots, key)] = key;
  for (int64_t i = 0; i < b->count; i++)
    hits += voxel_of(b, i, pose_b, &key) && slots[slot_of(slots, key)] == key;
  return b->count ? (double)hits / (double)b->count : 0;
}

/* Finds the sweep before or after the middle one to which the car's way is nearest to best_way; -1: it stands. */
static int64_t find_partner(const pags_driving *driving, int64_t middle) {
  int64_t best = -1;
  double nearest = (double)INFINITY;
  for (int64_t i = 0; i < driving->sweep_count; i++) {
    const double way =
        pags_pose_distance(driving->sweeps[middle].world_from_sweep, driving->sweeps[i].world_from_sweep);
    if (way < least_way || way > reach || fabs(way - best_way) >= nearest)
      continue;
    nearest = fabs(way - best_way);
    best = i;
  }
  return best;
}

/* Returns the largest overlap with the points turned about z by 90, 180 or 270 degrees before they are moved; *degrees
 * is the turn. */
static double best_turn(const points *a, const points *b, uint64_t *slots, int *degrees) {
  static const double turns[3][12] = {{0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0},
                                      {-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0},
                                      {0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0}};
  double best = 0;
  for (int i = 0; i < 3; i++) {
    double pose_a[12], pose_b[12];
    pags_rigid_multiply(a->pose, turns[i], pose_a);
    pags_rigid_multiply(b->pose, turns[i], pose_b);
    const double share = overlap(a, pose_a, b, pose_b, slots);
    *degrees = share > best ? 90 * (i + 1) : *degrees;
    best = fmax(best, share);
  }
  return best;
}

static void warn(const pags_driving *driving, const points *a, const points *b, uint64_t *slots) {
  static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  double back_a[12], back_b[12];
  int degrees = 0;
  pags_rigid_inverse(a->pose, back_a);
  pags_rigid_inverse(b->pose, back_b);
  const double as_read = overlap(a, a->pose, b, b->pose, slots);
  if (least_ratio * as_read > 1) /* nothing meets better */
    return;
  const double world = overlap(a, identity, b, identity, slots), inverse = overlap(a, back_a, b, back_b, slots);
  const double turned = best_turn(a, b, slots, &degrees), better = fmax(fmax(world, inverse), turned);
  const char *folder = driving->rules.lidar_frame ? "lidar_pose" : "ego_pose";
  if (better < least_share || better < least_ratio * as_read)
    return;
  if (turned > world && turned > inverse)
    PAGS_WARN(
        "%s/lidar: %.0f %% of the points of two sweeps meet if they are turned by %d degrees about z, %.0f %% as they "
        "are: their axes may be wrong; expected those of %s",
        driving->root, 100 * turned, degrees, 100 * as_read, folder);
  else if (world >= inverse)
    PAGS_WARN(
        "%s/lidar: %.0f %% of the points of two sweeps meet without %s, %.0f %% with it: lidar_frame may be wrong; "
        "points in the world's frame want \"lidar_frame\": \"world\" in dataset.json",
        driving->root, 100 * world, folder, 100 * as_read);
  else
    PAGS_WARN(
        "%s/%s: %.0f %% of the points of two sweeps meet with the inverse poses, %.0f %% with those read: the poses "
        "may be wrong; expected car-to-world, not world-to-car",
        driving->root, folder, 100 * inverse, 100 * as_read);
}

pags_result pags_sweep_poses_check(const pags_driving *driving) {
  const int64_t middle = driving->sweep_count / 2;
  const bool sure = !driving->rules.lidar_world && !driving->poses_leap; /* else the poses say nothing of the frame */
  const int64_t partner = sure ? find_partner(driving, middle) : -1;
  if (partner < 0)
    return PAGS_OK;
  PAGS_AUTOFREE work *w = malloc(sizeof *w);
  PAGS_CHECK_MEMORY(w, "%s", driving->root);
  PAGS_TRY(take(driving, middle, &w->a));
  PAGS_TRY(take(driving, partner, &w->b));
  if (w->a.count >= 100 && w->b.count >= 100)
    warn(driving, &w->a, &w->b, w->slots);
  return PAGS_OK;
}
