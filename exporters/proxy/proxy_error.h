/* SPDX-License-Identifier: Apache-2.0 */
/* How far a proxy is from what it stands for. */
#ifndef PAGS_PROXY_PROXY_ERROR_H
#define PAGS_PROXY_PROXY_ERROR_H

#include <pags/export.h>

#include "exporters/proxy/depth_view.h"
#include "exporters/proxy/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Mean, 95th percentile and largest; sorts `values`. NaN where there are none. */
pags_proxy_distance pags_distance_summary(double *values, int64_t count);

/* Fills distances both ways, the share observed and the silhouette's overlap. Only points of the proxy that a view sees
 * count, since the rest has nothing to be compared with: a ray of the view meets it first, and the view has a depth
 * there. */
pags_result pags_proxy_compare(const pags_proxy_mesh *proxy, const pags_depth_views *depth_views, pags_tasks *tasks,
                               pags_proxy_facts *facts);

/* Share of the area whose corners are observed. */
double pags_proxy_mesh_observed(const pags_proxy_mesh *mesh);

/* The same of several proxies in one mesh, `group_of` its triangles (`group_count` facts), depths beyond `range` left
 * out; a distance belongs to the group of the triangle met or nearest. Silhouettes are not measured. */
pags_result pags_proxies_compare(const pags_proxy_mesh *proxies, const int32_t *group_of, int64_t group_count,
                                 const pags_depth_views *depth_views, double range, pags_tasks *tasks,
                                 pags_proxy_facts *facts);

#ifdef __cplusplus
}
#endif
#endif
