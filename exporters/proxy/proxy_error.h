/* SPDX-License-Identifier: Apache-2.0 */
/* Measures the error of proxies: distances between a proxy and the surface of the Gaussians, and the overlap of their
 * silhouettes. Lists proxies with their errors in a report (proxy_report.c). */
#ifndef PAGS_PROXY_PROXY_ERROR_H
#define PAGS_PROXY_PROXY_ERROR_H

#include <pags/export.h>

#include "exporters/proxy/depth_view.h"
#include "exporters/proxy/mesh.h"

/* Appends a copy of the facts, with copies of their name and class, to the report. */
pags_result pags_proxy_report_add(pags_proxy_report *report, const pags_proxy_facts *facts);

/* The mean, the 95th percentile and the maximum of `values`, NaN without values. Sorts `values`. */
pags_proxy_distance pags_distance_summary(double *values, int64_t count);

/* Measures one proxy against the depth views of its Gaussians and fills in the distances in both directions, the
 * share observed and the silhouettes' overlap. A point of the proxy counts only if it is the first hit of a view's
 * ray whose pixel has a depth, since other points have nothing to be compared with. */
pags_result pags_proxy_compare(const pags_proxy_mesh *proxy, const pags_depth_views *depth_views, pags_tasks *tasks,
                               pags_proxy_facts *facts);

/* The share of the mesh's area that is observed: triangles weighted by area and by how many corners are observed. */
double pags_proxy_mesh_observed(const pags_proxy_mesh *mesh);

/* Measures the distances of several proxies that are joined in one mesh. `group_of` is the proxy of each triangle;
 * facts are filled in for `group_count` proxies. A distance counts for the proxy of the triangle that the ray hit or
 * that is nearest. Depths beyond `range` metres are left out. Silhouettes are not measured. */
pags_result pags_proxies_compare(const pags_proxy_mesh *proxies, const int32_t *group_of, int64_t group_count,
                                 const pags_depth_views *depth_views, double range, pags_tasks *tasks,
                                 pags_proxy_facts *facts);

#endif
