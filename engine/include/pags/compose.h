/* SPDX-License-Identifier: Apache-2.0 */
/* A composition: a scene prepared for drawing at any time, with objects hidden, moved or duplicated.
 *
 * The background is always drawn. An object with a model of its own is drawn at the pose that its track has
 * at that time. The Gaussians of a parked object lie in the background; a composition makes them a part of their own,
 * so that the object can be hidden and moved like the others. Ids number the Gaussians as the scene's files do: model
 * after model, row after row.
 *
 * A composition may be used by one thread at a time. */
#ifndef PAGS_COMPOSE_H
#define PAGS_COMPOSE_H

#include <pags/base.h>
#include <pags/frame.h>
#include <pags/scene.h>

PAGS_BEGIN_C

typedef struct pags_composition pags_composition;

/* Creates a composition of a scene: splits the background by object, sorts the Gaussians in Morton order and
 * computes the bounds of their clusters. It takes over what the scene owns; `scene` is zeroed, on failure as
 * well. PAGS_ERROR_LIMIT beyond 2^31 - 65 Gaussians; PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_composition_create(pags_scene *scene, pags_composition **out);

/* Creates a composition that copies nothing, for a scene whose Gaussians change: those of model m, with their
 * clusters clusters[m], stay where they are, and the scene owns them and everything else as before; all of it must
 * stay unchanged until pags_composition_destroy, which frees none of it. The background isn't split by object, so that
 * parked objects can't be hidden or moved. PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_composition_borrow(const pags_scene *scene, const pags_clusters *const *clusters,
                                             pags_composition **out);

/* Creates a composition of a scene folder or a splat file (pags_scene_load). A packed file is opened by
 * pags_composition_open_packed. Errors as these functions and pags_composition_create; then *out is NULL. */
PAGS_API pags_result pags_composition_load(const char *path, pags_composition **out);

/* Creates a composition of a packed splat file (pags/packed.h), which is mapped into memory: a scene without
 * views and objects, in which the id of a Gaussian is its row in the file. Errors as pags_packed_open. */
PAGS_API pags_result pags_composition_open_packed(const char *path, pags_composition **out);

/* Replaces the Gaussians by their packed form (pags/packed.h), except those whose colour changes with time.
 * Pictures change by the rounding errors of packing. PAGS_ERROR_MEMORY; then part of the Gaussians may be packed
 * already. */
PAGS_API pags_result pags_composition_pack(pags_composition *composition);

/* Frees a composition with its scene. NULL is allowed. */
PAGS_API void pags_composition_destroy(pags_composition *composition);

/* Returns the scene, owned by the composition. Its models are empty: their Gaussians have moved into the
 * composition. */
PAGS_API const pags_scene *pags_composition_scene(const pags_composition *composition);

/* Returns the number of Gaussians; ids are 0 .. count - 1. */
PAGS_API int64_t pags_composition_gaussian_count(const pags_composition *composition);

/* Returns the bytes that Gaussians, ids and cluster bounds take, in planes and packed. */
PAGS_API size_t pags_composition_bytes(const pags_composition *composition);

/* Returns the default frame options with the values of the scene: origin, background, sky and
 * antialiasing, and the near plane and low-pass of the training configuration, if the scene has one. The options
 * are valid as long as the composition is, which owns the sky. */
PAGS_API pags_frame_options pags_composition_options(const pags_composition *composition);

typedef enum pags_edit_kind {
  PAGS_EDIT_HIDE, /* the object isn't drawn */
  PAGS_EDIT_MOVE, /* the object is drawn elsewhere; the last move of an object counts */
  PAGS_EDIT_ADD   /* the object is also drawn elsewhere, even if it is hidden */
} pags_edit_kind;

typedef struct pags_edit {
  pags_edit_kind kind;
  int64_t object;        /* index in the scene's objects */
  double translation[3]; /* metres forward, left and up, in the object's frame at the time drawn */
  double yaw; /* degrees about the object's z axis, counter-clockwise from above; applied before translation */
} pags_edit;

/* Replaces all earlier edits; count 0 removes them. The translation and yaw of an edit are relative to the
 * object's pose at the time drawn, so that a moved object keeps following its track. PAGS_ERROR_ARGUMENT for an
 * object that the scene doesn't have or values that are not finite; PAGS_ERROR_MEMORY. On failure the earlier
 * edits stay. */
PAGS_API pags_result pags_composition_edit(pags_composition *composition, const pags_edit *edits, int64_t count);

/* Computes the parts to draw at `time` (seconds, as in the scene's tracks; NaN: the beginning of the scene), with
 * the edits applied. A part's label is the index of its object, or -1. Never allocates memory and never fails. The
 * array *parts belongs to the composition and is valid until its next pags_compose, pags_compose_placed, edit, pack or
 * destroy. */
PAGS_API void pags_compose(pags_composition *composition, double time, const pags_part **parts, int *part_count);

/* One object drawn at a pose that the caller gives. */
typedef struct pags_placement {
  int64_t object; /* index in the scene's objects; -1: the background, without the objects in it */
  /* 3x4 pose of the object's frame, metres, absolute (the origin is not subtracted); it may scale, stretch and
   * mirror. For object -1: the motion applied to the world, the identity for none. */
  double world_from_object[12];
} pags_placement;

/* Computes the parts to draw at `time` for a host (an editor, a simulator) that keeps the poses of objects itself:
 * exactly the placements are drawn, and tracks and edits are ignored. An object may occur several times. A parked
 * object is carried from its rest pose (pags_composition_rest_pose) to the given pose. `time` only matters to
 * colours that change with time; NaN is the beginning of the scene. A part's label is the index of its placement. The
 * array *parts belongs to the composition and is valid until its next pags_compose, pags_compose_placed, edit, pack or
 * destroy.
 *
 * PAGS_ERROR_ARGUMENT for an object that the scene doesn't have, PAGS_ERROR_FORMAT for a pose that can't be inverted
 * (pags_affine_check), PAGS_ERROR_LIMIT beyond 2^31 - 1 parts, PAGS_ERROR_MEMORY; then *part_count is 0. */
PAGS_API pags_result pags_compose_placed(pags_composition *composition, double time, const pags_placement *placements,
                                         int64_t count, const pags_part **parts, int *part_count);

/* Computes the rest pose of an object, absolute: its pose at the beginning of the scene, or at its label nearest
 * in time to it. The Gaussians of a parked object lie in the background at this pose; an object with a model of
 * its own starts at it. */
PAGS_API void pags_composition_rest_pose(const pags_composition *composition, int64_t object, double out[12]);

/* Returns 1 if the object has a model of its own and follows its track, 0 if its Gaussians lie in the background. */
PAGS_API int pags_composition_is_tracked(const pags_composition *composition, int64_t object);

/* Returns the index of the object that a part of this composition belongs to; -1: none. */
PAGS_API int64_t pags_composition_part_object(const pags_composition *composition, const pags_part *part);

/* Writes the index of each Gaussian's object, -1 for none, to object_of[id]. `object_of` has room for
 * pags_composition_gaussian_count entries. */
PAGS_API void pags_composition_objects(const pags_composition *composition, int32_t *object_of);

/* Copies all Gaussians in the order of their ids: row i of `out` has the values that were loaded for id i, those of
 * packed ones unpacked. Means of objects that follow a track are in the object's frame, all others relative to the
 * scene's origin. `out` is overwritten, belongs to the caller and gets the highest SH degree of all Gaussians (missing
 * terms are 0), and s_sem, object_id and Fourier planes if any of them have these. Composes: earlier parts of
 * pags_compose_placed become invalid. PAGS_ERROR_MEMORY; then `out` is empty. */
PAGS_API pags_result pags_composition_gaussians(pags_composition *composition, pags_gaussians *out);

/* Writes the semantic priority of each Gaussian, 0..1, to priority_of[id]: s_sem where it is known, otherwise 1
 * for Gaussians of critical objects and 0 for others. Returns 0, with all priorities 0, if the scene has neither
 * s_sem nor objects; otherwise 1. `priority_of` has room for pags_composition_gaussian_count entries. */
PAGS_API int pags_composition_priorities(const pags_composition *composition, float *priority_of);

/* Computes a colour for a priority, display-referred sRGB 0..1: from dark violet at 0 over red to pale yellow at
 * 1. Values outside of 0..1 are clamped; NaN counts as 0. */
PAGS_API void pags_colormap_heat(float value, float rgb[3]);

PAGS_END_C
#endif
