/* SPDX-License-Identifier: Apache-2.0 */
/* Tells motion that a car can make from faults of its poses and labels. */
#ifndef PAGS_DATASET_DRIVING_MOTION_H
#define PAGS_DATASET_DRIVING_MOTION_H

#include <pags/object.h>
#include <stdbool.h>

/* What doesn't fit among the poses of a car. */
typedef struct pags_leaps {
  int64_t count;                   /* steps from one pose to the next that no car makes */
  int64_t first;                   /* the first of them leads from pose `first` to the next */
  double metres, degrees, seconds; /* of that step: how far it is off the motion around it, and its length in time */
  int64_t repeats, first_repeat;   /* steps to the same pose while the car drives on, and the first of them */
} pags_leaps;

/* Compares the step from each pose to the next with the median of the six steps around it. A step is a leap if its
 * speed differs by more than a car's can, which is 30 m/s^2 plus 0.8 m of noise, or if it turns faster than 90 degrees
 * a second plus 4 degrees of noise; where poses are smooth, also if it is off by 12 m/s^2 plus 0.3 m, or by 30 degrees
 * a second plus 2 degrees, and by ten times the median of all steps. It is a repeat if it goes nowhere, to a
 * micrometre, and the steps around it go 0.3 m on average, as those of a car that comes to a stop don't. `times`:
 * seconds, ascending; `poses`: 3x4, world from car or camera. */
pags_leaps pags_find_leaps(const double (*poses)[12], const double *times, int64_t count);

/* The first step of a track, from keyframe `keyframe` to the next, whose speed differs by more than 30 m/s^2 and 0.8 m
 * of noise from the steps around it: how far it is off and its length in time. `metres` 0: none exists. */
typedef struct pags_track_leap {
  int64_t keyframe;
  double metres, seconds;
} pags_track_leap;
pags_track_leap pags_track_find_leap(const pags_object *object);

/* Bits that state what was done to a label. */
enum { PAGS_MENDED_NOT = 0, PAGS_MENDED_TURNED = 1, PAGS_MENDED_MOVED = 2 };

/* Mends the labelled poses of a track, whose keyframes are sorted by time. Labels that face the other way than most of
 * their track are turned by half a turn; a label that lies aside or is turned, while those around it agree on where it
 * ought to be, is put there. `mended` has a byte per keyframe: PAGS_MENDED_MOVED for labels that are known to lie
 * aside, and becomes PAGS_MENDED_*. */
void pags_track_mend(const pags_object *object, uint8_t *mended);

/* Finds the things that the labels of one id follow: an id that a tracker hands to another car leaps there and stays.
 * `part` becomes the number of the thing that each label is of, 0 for the one with most labels; its labels that lie
 * aside, at most a quarter, become PAGS_MENDED_MOVED in `mended`, the others PAGS_MENDED_NOT. Returns the number of
 * things. `scratch` has room for two numbers a label. */
int pags_track_split(const pags_object *object, int *part, uint8_t *mended, double *scratch);

#endif
