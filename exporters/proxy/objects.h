/* SPDX-License-Identifier: Apache-2.0 */
/* The proxies of all chosen objects, made and measured, several objects at once. */
#ifndef PAGS_PROXY_OBJECTS_H
#define PAGS_PROXY_OBJECTS_H

#include "exporters/proxy/object_proxy.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_built_level {
  pags_proxy_mesh mesh;   /* in the object's frame */
  pags_proxy_facts facts; /* name and class are not set */
} pags_built_level;

typedef struct pags_built_object {
  int level_count; /* 0: not chosen; 1, or with options->lod all levels, finest first */
  pags_built_level levels[PAGS_PROXY_LEVELS];
  pags_result result;
  char message[256]; /* of a failure: messages belong to threads */
} pags_built_object;

/* One a scene's object. With `measure` facts have distances and overlap. Same results for any number of threads. `tell`
 * is called with 0..1 by the calling thread alone; may be NULL. */
pags_result pags_objects_make(const pags_proxy_maker *maker, int measure, pags_progress_fn *tell, void *user,
                              pags_built_object **out);
void pags_objects_destroy(pags_built_object *objects, int64_t count); /* NULL is allowed */

#ifdef __cplusplus
}
#endif
#endif
