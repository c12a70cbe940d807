/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxies of all chosen objects and measures their errors, several objects in parallel. */
#ifndef PAGS_PROXY_OBJECTS_H
#define PAGS_PROXY_OBJECTS_H

#include "exporters/proxy/object_proxy.h"

typedef struct pags_built_object {
  int level_count; /* levels made: 0 if the object is not chosen, else 1; with options->lod mesh to box, finest first;
                      with the names of a program the mesh and what it collides with, unless that is the mesh */
  pags_built_level levels[PAGS_PROXY_LEVELS];
} pags_built_object;

/* Makes an array with an entry for each of the scene's objects. With `measure`, facts have the measured distances and
 * the silhouettes' overlap. The results are the same for any number of threads. `tell` (may be NULL) is called with
 * fractions 0..1, by the calling thread only. After a failure, too, the caller destroys them. */
pags_result pags_objects_make(const pags_proxy_maker *maker, bool measure, pags_progress_fn *tell, void *user,
                              pags_built_object **out);
void pags_objects_destroy(pags_built_object *objects, int64_t count); /* NULL is allowed */

#endif
