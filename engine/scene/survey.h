/* SPDX-License-Identifier: Apache-2.0 */
/* Surveys scenes without photographs: the box of their Gaussians, and possible camera positions in it.
 * Also finds cameras far from all others of a capture, as those of failed registrations are. */
#ifndef PAGS_SCENE_SURVEY_H
#define PAGS_SCENE_SURVEY_H

#include <stdbool.h>
#include <stdint.h>

#include <pags/base.h>
#include <pags/scene.h>

/* Positions are in the scene's frame, relative to its origin. */
typedef struct pags_survey {
  double lo[3], hi[3]; /* box of the Gaussians, without floaters and distant ones */
  double surrounded;   /* cells that are free and hemmed in on five sides, for each solid cell */
  bool inside;         /* whether such cells make up a room: cameras belong there, not outside */
  double middle[3];    /* mean of the cells of the largest such room; without one, the middle of the box */
  double step;         /* side of a cell */
  int n[3];            /* cells along x, y, z */
  double origin[3];    /* corner of the first cell */
  uint8_t *cells;      /* one of the codes below for each cell; x runs fastest, then y, then z */
} pags_survey;

enum { PAGS_CELL_SOLID, PAGS_CELL_FREE, PAGS_CELL_ROOM }; /* room: free, hemmed in, and clear of what is solid */

/* Surveys the background and the objects as they are at the scene's begin. An empty scene gives an empty box of side
 * 1 about 0. PAGS_ERROR_MEMORY. */
pags_result pags_survey_make(const pags_scene *scene, pags_survey *out);
void pags_survey_destroy(pags_survey *survey); /* frees and zeroes; a zeroed struct is allowed */

/* The code of the cell that a point is in; PAGS_CELL_FREE outside of all cells. */
int pags_survey_cell(const pags_survey *survey, const double point[3]);

/* Chooses up to `most` cells of the room, spread evenly: each next one is the cell farthest from those chosen. Writes
 * their middles and returns how many. */
int pags_survey_places(const pags_survey *survey, int most, double (*places)[3]);

typedef struct pags_far_cameras {
  int64_t count;    /* of the far cameras; 0: `far` is false everywhere */
  double middle[3]; /* the median of the positions, axis by axis */
  double near;      /* the distance from there that three quarters of the cameras are within */
} pags_far_cameras;

/* Sets far[i] for each of `count` cameras at positions (3 numbers each) that is more than 20 times as far from the
 * median position as three quarters of the cameras and than `size`, that of the scene or 0. Where these are more than
 * an eighth of the cameras (of fewer than eight, more than one), the capture has several parts, and none is far. */
pags_result pags_far_cameras_find(const double *positions, int64_t count, double size, bool *far,
                                  pags_far_cameras *out);

#endif
