/* SPDX-License-Identifier: Apache-2.0 */
/* The cross-section of the street: positions y in metres, 0 on the middle line, positive to its left. Traffic keeps
 * to the right. The ego vehicle drives in the left one of its two lanes, so that a camera shifted by three metres to
 * the right is still over a lane. */
#ifndef PAGS_SYNTH_LAYOUT_H
#define PAGS_SYNTH_LAYOUT_H

#define PAGS_EGO_LANE (-1.65f)
#define PAGS_LANE_EDGE (-3.3f)
#define PAGS_RIGHT_LANE (-4.6f) /* cars in the right lane drive here, clear of cyclists */
#define PAGS_CYCLE_LINE (-6.3f)
#define PAGS_ONCOMING_LANE 1.65f
#define PAGS_PARKING_LEFT 3.3f
#define PAGS_PARKING_RIGHT (-6.6f)
#define PAGS_PARKING_BAY 6.0f /* length of one bay along x */
#define PAGS_KERB_LEFT 5.5f
#define PAGS_KERB_RIGHT (-8.8f)
#define PAGS_KERB_HEIGHT 0.13f
#define PAGS_FRONT_LEFT 9.2f /* where the house plots begin, behind the pavement */
#define PAGS_FRONT_RIGHT (-12.5f)
#define PAGS_ZEBRA 4.0f /* length of a crossing along x */

#endif
