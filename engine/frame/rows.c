/* SPDX-License-Identifier: Apache-2.0 */
/* A cluster's rows as planes: where they lie, or unpacked into the caller's scratch. */
#include "frame/stages.h"
#include "scene/packed_rows.h"

const float *pags_frame_geometry(const pags_part *part, const view_cluster *cluster, row_scratch *scratch,
                                 int64_t *stride) {
  if (!part->packed) {
    *stride = part->gaussians->stride;
    return part->gaussians->data + cluster->first;
  }
  *stride = PAGS_PACKED_ROWS;
  pags_packed_geometry(part->packed, cluster->cluster, scratch->planes);
  return scratch->planes;
}

const float *pags_frame_colours(const pags_part *part, const view_cluster *cluster, int sh_degree, row_scratch *scratch,
                                int64_t *stride) {
  if (!part->packed) {
    *stride = part->gaussians->stride;
    return part->gaussians->data + cluster->first;
  }
  *stride = PAGS_PACKED_ROWS;
  pags_packed_means(part->packed, cluster->cluster, scratch->planes);
  pags_packed_colours(part->packed, cluster->cluster, sh_degree, scratch->planes + PAGS_SH * PAGS_PACKED_ROWS);
  return scratch->planes;
}
