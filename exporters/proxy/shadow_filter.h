/* SPDX-License-Identifier: Apache-2.0 */
/* Removes the shadow under a vehicle and the ground around it from the vehicle's depth views. */
#ifndef PAGS_PROXY_SHADOW_FILTER_H
#define PAGS_PROXY_SHADOW_FILTER_H

#include "exporters/proxy/depth_view.h"

#ifdef __cplusplus
extern "C" {
#endif

/* In a depth view of a vehicle drawn alone, in the frame of its box, marks pixels that show its shadow or the ground
 * beside it: their rays become free up to that depth. `size` is the box's, in metres. Fails only when out of
 * memory. */
pags_result pags_depth_view_filter_shadow(pags_depth_view *depth_view, const double size[3]);

#ifdef __cplusplus
}
#endif
#endif
