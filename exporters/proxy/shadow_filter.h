/* SPDX-License-Identifier: Apache-2.0 */
/* What the views show under a vehicle and beside its wheels. */
#ifndef PAGS_PROXY_SHADOW_FILTER_H
#define PAGS_PROXY_SHADOW_FILTER_H

#include "exporters/proxy/depth_view.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Rays of a view of a vehicle, drawn alone in its box's frame, that meet its shadow or the ground beside it are free as
 * far as that. `size` is the box's, metres. Fails for want of memory alone. */
pags_result pags_depth_view_filter_shadow(pags_depth_view *depth_view, const double size[3]);

#ifdef __cplusplus
}
#endif
#endif
