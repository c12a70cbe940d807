/* SPDX-License-Identifier: Apache-2.0 */
/* Owners that destroy at the end of a scope (base/memory.h), for data sets and their photographs:
 *
 *   PAGS_AUTO(pags_dataset_close_auto) pags_dataset *dataset = NULL;
 *   PAGS_TRY(pags_dataset_open(path, NULL, &dataset)); */
#ifndef PAGS_DATASET_OWNERS_H
#define PAGS_DATASET_OWNERS_H

#include <pags/dataset.h>

#include "base/memory.h"

PAGS_DEFINE_AUTO(pags_dataset, pags_dataset_close)
PAGS_DEFINE_AUTO(pags_photo_cache, pags_photo_cache_destroy)

#endif
