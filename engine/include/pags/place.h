/* SPDX-License-Identifier: Apache-2.0 */
/* The position of a world's coordinate system on the earth. */
#ifndef PAGS_PLACE_H
#define PAGS_PLACE_H

/* Geographic position of the world point (0, 0, 0) of a world whose x axis points east, y north and z up. */
typedef struct pags_place {
  double latitude, longitude; /* degrees, WGS84, north and east positive */
  double altitude;            /* metres, in the height system of the recording's GNSS receiver */
  int known;                  /* 1: the members above are set; 0: the position is unknown */
} pags_place;

#endif
