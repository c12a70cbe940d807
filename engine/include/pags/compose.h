/* SPDX-License-Identifier: Apache-2.0 */
/* A scene made ready for drawing at any time, with objects hidden, moved or drawn once more.
 *
 * The background is drawn always; an object with a model of its own where its track has it at that time; the Gaussians
 * of a parked object, which lie in the background, are a part of their own, so that it can be hidden and moved like the
 * others. Ids number the Gaussians as the files do: model after model, row after row.
 *
 * A composition belongs to one thread at a time. */
#ifndef PAGS_COMPOSE_H
#define PAGS_COMPOSE_H

#include <pags/base.h>
#include <pags/frame.h>
#include <pags/scene.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_composition pags_composition;

/* Takes the scene over (`scene` is zeroed, on failure as well) and brings its Gaussians into Morton order under
 * clusters. */
PAGS_API pags_result pags_composition_create(pags_scene *scene, pags_composition **out);
/* The same of a scene folder or a splat file; a packed one is opened packed. */
PAGS_API pags_result pags_composition_load(const char *path, pags_composition **out);
/* A packed splat file (pags/packed.h), mapped: a scene without views and objects whose ids are the file's rows. */
PAGS_API pags_result pags_composition_open_packed(const char *path, pags_composition **out);
/* Replaces the Gaussians by their packed form, but for those whose colour changes with time. Pictures change by what
 * packing rounds. */
PAGS_API pags_result pags_composition_pack(pags_composition *composition);
PAGS_API void pags_composition_destroy(pags_composition *composition); /* NULL is allowed */

/* The scene, whose models have no Gaussians left: they are in the composition's own order now. */
PAGS_API const pags_scene *pags_composition_scene(const pags_composition *composition);
PAGS_API int64_t pags_composition_gaussian_count(const pags_composition *composition); /* ids are 0 .. count - 1 */
PAGS_API size_t pags_composition_bytes(const pags_composition *composition); /* of Gaussians, ids and clusters */

/* Frame options as the scene asks for: origin, background, sky, antialiasing, and the near plane and the low-pass that
 * its training's configuration names. Valid as long as the composition is. */
PAGS_API pags_frame_options pags_composition_options(const pags_composition *composition);

typedef enum pags_edit_kind {
  PAGS_EDIT_HIDE,
  PAGS_EDIT_MOVE, /* drawn elsewhere; the last one of an object counts */
  PAGS_EDIT_ADD   /* drawn elsewhere as well, hidden or not */
} pags_edit_kind;

typedef struct pags_edit {
  pags_edit_kind kind;
  int64_t object;        /* index in the scene's objects */
  double translation[3]; /* metres, in the object's frame at the time drawn: forward, left, up */
  double yaw; /* degrees about the object's upward axis, counter-clockwise from above; before the translation */
} pags_edit;

/* Replaces all earlier edits. PAGS_ERROR_ARGUMENT for an object that the scene doesn't have or values that are not
 * finite, then the earlier ones stay. A moving object has its own motion after the edit, too: what is moved is moved
 * along its track. */
PAGS_API pags_result pags_composition_edit(pags_composition *composition, const pags_edit *edits, int64_t count);

/* What is to be drawn at `time` (seconds as in the scene's tracks; NaN: the scene's begin). Makes no heap call; the
 * parts are the composition's, valid until its next compose, edit or destroy. */
PAGS_API void pags_compose(pags_composition *composition, double time, const pags_part **parts, int *part_count);

/* One object drawn where the caller says. */
typedef struct pags_placement {
  int64_t object; /* index in the scene's objects; -1: everything that belongs to none of them */
  double
      world_from_object[12]; /* where the object's frame is, absolute; for -1: how the world itself is moved. Rigid */
} pags_placement;

/* What is to be drawn at `time` when a host (an editor, a simulator) keeps the objects' places: the placements and
 * nothing else, whatever tracks and edits say. An object may come several times. A parked object is carried from its
 * rest pose (pags_composition_rest_pose); `time` is for colours that change. The parts are the composition's as those
 * of pags_compose are. PAGS_ERROR_ARGUMENT for an object that the scene doesn't have or a pose that is no rigid motion;
 * PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_compose_placed(pags_composition *composition, double time, const pags_placement *placements,
                                         int64_t count, const pags_part **parts, int *part_count);

/* Where an object whose Gaussians lie in the background was when they were put there: its pose at the scene's begin, or
 * at its label nearest to it. For an object with a model of its own the same rule says where it comes in first. */
PAGS_API void pags_composition_rest_pose(const pags_composition *composition, int64_t object, double out[12]);
/* 1: the object has a model of its own and follows its track; 0: its Gaussians lie in the background. */
PAGS_API int pags_composition_is_tracked(const pags_composition *composition, int64_t object);

/* Index of the object that a part of this composition's is of; -1: of none. */
PAGS_API int64_t pags_composition_part_object(const pags_composition *composition, const pags_part *part);
/* Per id: index of the object, -1 for none. Room for gaussian_count entries. */
PAGS_API void pags_composition_objects(const pags_composition *composition, int32_t *object_of);
/* Per id: s_sem where it is known, else 1 for Gaussians of critical objects and 0 for others. Returns 0, and nothing
 * but zeros, when the scene has neither. */
PAGS_API int pags_composition_priorities(const pags_composition *composition, float *priority_of);

/* A priority as a colour, display-referred: dark violet at 0 over red to pale yellow at 1. Values beyond are held; NaN
 * is 0. */
PAGS_API void pags_colormap_heat(float value, float rgb[3]);

#ifdef __cplusplus
}
#endif
#endif
