/* SPDX-License-Identifier: Apache-2.0 */
/* Closed blocks of buildings and walls. */
#ifndef PAGS_PROXY_BLOCKS_H
#define PAGS_PROXY_BLOCKS_H

#include "exporters/proxy/background.h"

/* Makes blocks of all buildings and walls, of LiDAR points or of their surface `joined` over all tiles, and appends
 * them as chunks "building". Each is closed, has at most 500 triangles, and reaches the ground if it begins near it. */
pags_result pags_blocks_make(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground,
                             pags_proxy_mesh *joined);

#endif
