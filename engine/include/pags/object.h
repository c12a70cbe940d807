/* SPDX-License-Identifier: Apache-2.0 */
/* Objects of a scene: labelled boxes, their tracks, and their poses at any time.
 *
 * Object frame: x forward, y left, z up, origin at the centre of the box. Poses are `world_from_object`, rigid
 * 3x4 row-major, in absolute world coordinates (the scene's origin is not subtracted). Data sets and scenes share
 * the record pags_object: a data set fills it from its labels, a scene adds the pose increments found in
 * training. */
#ifndef PAGS_OBJECT_H
#define PAGS_OBJECT_H

#include <pags/base.h>

PAGS_BEGIN_C

typedef enum pags_category {
  PAGS_CATEGORY_OTHER, /* signs, cones, animals, ... */
  PAGS_CATEGORY_VEHICLE,
  PAGS_CATEGORY_PEDESTRIAN,
  PAGS_CATEGORY_CYCLIST /* riders with their bicycle or motorcycle */
} pags_category;

/* Returns "other", "vehicle", "pedestrian" or "cyclist", a static string. */
PAGS_API const char *pags_category_name(pags_category category);

/* Returns the category of a label's class name in the vocabulary of Waymo, KITTI, PandaSet, nuScenes, Argoverse 2,
 * nuPlan, DGP or CARLA ("Car", "Pedestrian with Object", "Van", "REGULAR_VEHICLE", ...), in upper or lower case;
 * unknown names are PAGS_CATEGORY_OTHER. The label of a parked bicycle is PAGS_CATEGORY_CYCLIST if its data set doesn't
 * distinguish parked bicycles from ridden ones. */
PAGS_API pags_category pags_category_of(const char *class_name);

/* Returns whether the paper calls a category critical: vehicles, pedestrians and cyclists are. */
static inline int pags_category_is_critical(pags_category category) {
  return category != PAGS_CATEGORY_OTHER;
}

/* One labelled pose of a track, with the increment that training adds to it. The pose of a trained keyframe is
 * world_from_object * exp(increment), which maps a point of the object as
 *
 *     p_world = R (Exp(rotation) p + translation) + t        with world_from_object = [R|t] */
typedef struct pags_keyframe {
  int32_t frame;                /* time step of the data set */
  int32_t trained;              /* 1: this frame was trained on, so that its increment counts; 0: held out */
  double time;                  /* seconds; ascending along the track */
  double world_from_object[12]; /* as labelled */
  double rotation[3];           /* increment: axis times angle, radians, in the object's frame */
  double translation[3];        /* increment: metres, in the object's frame */
} pags_keyframe;

/* Deprecated names, as are the members knot_count and knots. */
#define pags_knot pags_keyframe
#define pags_object_knot pags_object_keyframe

typedef struct pags_object {
  char *id;         /* the data set's name of the track, unique */
  char *class_name; /* the class name as the data set spells it */
  pags_category category;
  double size[3]; /* full extents along the object's x, y, z: length, width, height; metres, > 0 */
  int moving;     /* 1: moves, by the rule of pags_object_classify_motion; 0: parked */
  union {
    int64_t keyframe_count; /* at least 1 */
    int64_t knot_count;     /* deprecated name */
  };
  union {
    pags_keyframe *keyframes;
    pags_keyframe *knots; /* deprecated name */
  };
  double
      time_step; /* seconds between the time steps of the scene or data set: the spacing of a track of one keyframe */
} pags_object;

/* Frees the strings and the keyframes, and zeroes the struct. A zeroed struct is allowed. */
PAGS_API void pags_object_destroy(pags_object *object);

/* Sets object->moving from the labelled poses by the rule of Street Gaussians: 1 if the first and the last
 * position are more than 2 m apart, or if the standard deviation of the positions exceeds 0.5 m on an axis of the
 * world. For short tracks of three labels or more, also 1 if the object moves along a straight line: a pedestrian or
 * cyclist by 0.8 m at 0.5 m/s or more, a vehicle by 1.2 m at 1 m/s. 0 if six labels or more scatter about one place:
 * neighbouring labels differ as much as all labels do, or those of a vehicle wander back and forth. Uses the times and
 * the category.
 */
PAGS_API void pags_object_classify_motion(pags_object *object);

/* Returns the keyframe of a time step, owned by the object; NULL if the track has none at that step. */
PAGS_API const pags_keyframe *pags_object_keyframe(const pags_object *object, int64_t frame);

/* Computes the pose of an object at `time` (seconds). Returns 1; or 0, with `out` unchanged, if the object isn't
 * present at that time.
 *
 * The labelled pose: at a keyframe (within 1e-6 s) the label itself; between two keyframes at most 1.5 median spacings
 * of the track apart the interpolated labels (translation linear, rotation along the shorter arc); up to half a median
 * spacing beyond an end of the track, or into a longer gap, the label of the nearest keyframe. Otherwise the object
 * isn't present. A track of one keyframe has the spacing `time_step`, so that the object is present for a whole time
 * step.
 *
 * Increments: without increments the pose is the labelled pose. If the nearest trained keyframes before and after
 * `time` are at most 2.5 median spacings apart and at least one of them has an increment, the pose lies on the
 * cubic through the trained poses, and a held-out keyframe between them is ignored (docs/scene-folder.md, "Pose at a
 * time"). Otherwise the labelled pose is multiplied by the increment, which is interpolated linearly between
 * these two keyframes; before the first and after the last trained keyframe, that keyframe's increment holds. */
PAGS_API int pags_object_pose(const pags_object *object, double time, double out[12]);

/* Computes the velocity of an object at `time` in its own frame: (w, v) of pags_shutter, radians/s and metres/s,
 * the mean over a tenth of a second; zeros where the object isn't present. */
PAGS_API void pags_object_velocity(const pags_object *object, double time, double velocity[6]);

/* Computes the rigid motion exp(increment) = [Exp(rotation) | translation], 3x4; `rotation` is axis times angle
 * in radians (Rodrigues). */
PAGS_API void pags_increment_matrix(const double rotation[3], const double translation[3], double out[12]);

/* Computes the rotation vector (axis times angle, radians, angle 0..pi) of the rotation of `m`: the inverse of
 * pags_increment_matrix for rotations. */
PAGS_API void pags_increment_rotation(const double m[12], double rotation[3]);

PAGS_END_C
#endif
