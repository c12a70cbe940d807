/* SPDX-License-Identifier: Apache-2.0 */
/* Objects of a scene: labelled boxes, and where they are at any time.
 *
 * Object frame: x forward, y left, z up, origin at the middle of the box. Poses are `world_from_object`, rigid 3x4
 * row-major, absolute (the scene's origin not subtracted). A record is shared by data sets, which fill it from labels,
 * and by scenes, which add what training found out. */
#ifndef PAGS_OBJECT_H
#define PAGS_OBJECT_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pags_category {
  PAGS_CATEGORY_OTHER, /* signs, cones, animals, ... */
  PAGS_CATEGORY_VEHICLE,
  PAGS_CATEGORY_PEDESTRIAN,
  PAGS_CATEGORY_CYCLIST /* riders with their bicycle or motorcycle */
} pags_category;

/* "other", "vehicle", "pedestrian", "cyclist"; static. */
PAGS_API const char *pags_category_name(pags_category category);
/* From a label's class name of Waymo, KITTI, PandaSet, nuScenes, Argoverse 2 or nuPlan, any case ("Car", "Pedestrian
 * with Object", "Van", "REGULAR_VEHICLE", ...); what none of them knows is PAGS_CATEGORY_OTHER. A parked bicycle's
 * label is a CYCLIST's where its data set makes no difference. */
PAGS_API pags_category pags_category_of(const char *class_name);
/* Vehicles, pedestrians and cyclists: what the paper calls critical. */
static inline int pags_category_is_critical(pags_category category) {
  return category != PAGS_CATEGORY_OTHER;
}

/* One labelled pose of a track and what training adds to it. A trained knot's pose is world_from_object *
 * exp(increment): p_world = R (Exp(rotation) p + translation) + t. */
typedef struct pags_knot {
  int32_t frame;                /* time step of the data set */
  int32_t trained;              /* 1: this frame was trained on, so its increment counts; 0: held out */
  double time;                  /* seconds; ascending */
  double world_from_object[12]; /* as labelled */
  double rotation[3];           /* increment: axis times angle, radians, in the object's frame */
  double translation[3];        /* increment: metres, in the object's frame */
} pags_knot;

typedef struct pags_object {
  char *id;         /* the data set's, unique */
  char *class_name; /* the data set's own word */
  pags_category category;
  double size[3]; /* full extents along the object's x, y, z: length, width, height; metres, > 0 */
  int moving;     /* 1: travels more than 2 m or its positions spread more than 0.5 m on an axis */
  int64_t knot_count;
  pags_knot *knots; /* at least one */
} pags_object;

PAGS_API void pags_object_destroy(pags_object *object); /* frees what it owns and zeroes */

/* Sets object->moving by the rule above from the labelled poses. */
PAGS_API void pags_object_classify_motion(pags_object *object);

/* The knot of a time step, NULL where it has none. */
PAGS_API const pags_knot *pags_object_knot(const pags_object *object, int64_t frame);

/* Where the object is at `time`; returns 0, and leaves `out` alone, when it isn't there.
 * At a knot (within 1e-6 s) the label is taken as it stands, between two knots at most 1.5 times the track's median
 * spacing apart the labels are interpolated (translation linear, rotation along the shorter arc); up to half a median
 * spacing beyond an end or into a longer gap the nearest knot holds. That is the pose where no increment is. Where one
 * of the trained knots on either side has an increment, these at most 2.5 median spacings apart, the pose is on the
 * cubic through the trained poses, whatever a held-out knot between them says (docs/scene-folder.md, "Pose at a time");
 * otherwise the label is multiplied by the increment, interpolated linearly between them (beyond them: the nearest
 * trained one's). */
PAGS_API int pags_object_pose(const pags_object *object, double time, double out[12]);

/* out = exp(increment): 3x4 [Exp(rotation) | translation]. */
PAGS_API void pags_increment_matrix(const double rotation[3], const double translation[3], double out[12]);
/* Its inverse for rotations: the axis times the angle, 0 to pi, of m's rotation. */
PAGS_API void pags_increment_rotation(const double m[12], double rotation[3]);

#ifdef __cplusplus
}
#endif
#endif
