/* SPDX-License-Identifier: Apache-2.0 */
/* Upright thin things in a cloud of points: trunks of trees, poles, posts of signs, lamps, bins. */
#ifndef PAGS_PROXY_COLUMNS_H
#define PAGS_PROXY_COLUMNS_H

#include "exporters/proxy/ground.h"

/* Cityscapes' train ids, the values of semantic pictures. Larger ones are ignored. */
enum {
  PAGS_LABEL_FENCE = 4,
  PAGS_LABEL_POLE,
  PAGS_LABEL_LIGHT,
  PAGS_LABEL_SIGN,
  PAGS_LABEL_VEGETATION,
  PAGS_LABEL_TERRAIN,
  PAGS_LABELS = 19
};

/* Points on and above the ground, grouped by the cells of a lattice in x and y. */
typedef struct pags_cloud {
  double x0, y0; /* lowest corner of the lattice, metres */
  int64_t nx, ny;
  int64_t *first; /* index of each cell's first point; nx * ny + 1 entries */
  float *points;  /* 4 each: x, y, z and the height above the ground; metres, the scene's frame */
} pags_cloud;

/* Takes the points (3 floats each) up to 12 m above the ground and within 60 m of a camera, in x and in y. After
 * a failure, too, the caller destroys `out`. */
pags_result pags_cloud_make(const float *points, int64_t count, const pags_ground *ground,
                            const pags_depth_views *depth_views, pags_cloud *out);
void pags_cloud_destroy(pags_cloud *cloud); /* frees and zeroes */

typedef struct pags_column {
  double foot[3];            /* where its axis meets the ground, metres */
  double lean[2];            /* metres in x and y for each metre of height */
  double radius;             /* metres */
  double top;                /* height of its highest point above the ground, metres */
  double crown;              /* points around it, more than 2.25 m above the ground, for each point on it */
  int64_t count;             /* number of points on it */
  double votes[PAGS_LABELS]; /* share of each label among the pixels that show its points; all 0: there are no labels */
} pags_column;

typedef struct pags_columns {
  int64_t count, capacity;
  pags_column *list; /* in the order of the lattice */
} pags_columns;

/* Finds the columns of a cloud. They are at least 0.75 m high, at most 0.7 m wide and stand free. After a failure,
 * too, the caller destroys `out`. */
pags_result pags_columns_find(const pags_cloud *cloud, const pags_ground *ground, const pags_depth_views *depth_views,
                              pags_columns *out);
void pags_columns_destroy(pags_columns *columns); /* frees and zeroes */

/* What a column is, by the labels of its pixels; without labels by its shape: a trunk has a crown. If the views are
 * `labelled`, but none shows it, it may be a pole, no trunk. */
typedef enum pags_column_kind { PAGS_COLUMN_OTHER, PAGS_COLUMN_TRUNK, PAGS_COLUMN_POLE } pags_column_kind;
pags_column_kind pags_column_kind_of(const pags_column *column, bool labelled);

/* The point of the axis at a height above the ground. */
void pags_column_point(const pags_column *column, double height, double out[3]);

/* Adds a closed prism about a column's axis between two heights above its foot. `foot_seen`: its lower end is observed.
 */
void pags_column_prism(const pags_column *column, int sides, double from, double to, bool foot_seen,
                       pags_proxy_mesh *mesh);

/* Points found near a column. */
typedef struct pags_near {
  int64_t count, capacity;
  double (*points)[3]; /* x, y relative to the axis at their height; height above the column's foot; metres */
} pags_near;

void pags_near_destroy(pags_near *near); /* frees and zeroes */

/* Lists the cloud's points between two distances from a column's axis and two heights above its foot. After a failure,
 * too, the caller destroys `out`. */
pags_result pags_cloud_near(const pags_cloud *cloud, const pags_column *column, const double distances[2],
                            const double heights[2], pags_near *out);

/* Adds to `votes` the labels of the pixels that show a point, one of each view in which nothing hides it. */
void pags_labels_of_point(const pags_depth_views *depth_views, const double point[3], double votes[PAGS_LABELS]);
/* Divides votes by their sum, if there are any. */
void pags_labels_share(double votes[PAGS_LABELS]);

#endif
