/* SPDX-License-Identifier: Apache-2.0 */
/* What a data set differs in from the one that an interrupted run was begun with, for the message that refuses to go
 * on. */
#ifndef PAGS_TRAIN_OTHER_VIEWS_H
#define PAGS_TRAIN_OTHER_VIEWS_H

#include <pags/dataset.h>

/* Compares the data set's views with those that scene.json in `folder` records. Returns a text such as "the camera of
 * 0003.png stands 1 m from where it stood" that the caller frees; NULL if nothing is known (no scene.json) or nothing
 * differs that scene.json records. */
char *pags_other_views(const char *folder, const pags_dataset *dataset);

#endif
