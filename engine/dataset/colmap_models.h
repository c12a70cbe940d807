/* SPDX-License-Identifier: Apache-2.0 */
/* Which of the COLMAP models of a data set is used. The mapper writes a model for each set of pictures that it could
 * connect (sparse/0, sparse/1, ...), so that one is often a fragment. */
#ifndef PAGS_DATASET_COLMAP_MODELS_H
#define PAGS_DATASET_COLMAP_MODELS_H

#include <pags/base.h>

#include "dataset/parsed.h"

/* Finds a model below `root`: in root itself, sparse/N, sparse, colmap/sparse/N or colmap/sparse, else in the first
 * folder that has one, at most 4 levels down. Of several with the same parent it is the one with most pictures; the
 * others are named in the log, as are data sets that lie next to that folder. *out is its folder, freed by the caller;
 * NULL if not found. */
pags_result pags_colmap_find_model(const char *root, char **out);

/* Warns of pictures that lie next to those of the views but are not views. */
pags_result pags_count_unused_pictures(const pags_parsed_dataset *parsed);

#endif
