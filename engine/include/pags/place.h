/* SPDX-License-Identifier: Apache-2.0 */
/* Where on the earth a world lies. */
#ifndef PAGS_PLACE_H
#define PAGS_PLACE_H

#ifdef __cplusplus
extern "C" {
#endif

/* Of a world whose x points east, y north, z up. */
typedef struct pags_place {
  double latitude, longitude; /* of its zero: degrees, WGS84, north and east positive */
  double altitude;            /* metres, in the height system of the recording's GNSS receiver */
  int known;                  /* 0: nothing is known of it */
} pags_place;

#ifdef __cplusplus
}
#endif
#endif
