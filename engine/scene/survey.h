/* SPDX-License-Identifier: Apache-2.0 */
/* Surveys Gaussians of which no photographs are known: the box of what is there, and where in it a camera may stand. */
#ifndef PAGS_SCENE_SURVEY_H
#define PAGS_SCENE_SURVEY_H

#include <pags/scene.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Positions are in the scene's frame, relative to its origin. */
typedef struct pags_survey {
  double lo[3], hi[3]; /* box of what is there, without floaters and what is far away from most */
  double surrounded;   /* cells that are free and hemmed in on five sides, for each solid cell */
  bool inside;         /* whether such cells make up a room: cameras belong there, not outside */
  double middle[3];    /* mean of the cells of the largest such room; the middle of the box if there is none */
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

#ifdef __cplusplus
}
#endif
#endif
