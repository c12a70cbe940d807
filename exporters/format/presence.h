/* SPDX-License-Identifier: Apache-2.0 */
/* When an object is there: objects that come late, leave or were lost for a while. */
#ifndef PAGS_FORMAT_PRESENCE_H
#define PAGS_FORMAT_PRESENCE_H

#include <pags/scene.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_presence {
  bool always;        /* it is there all the time that the scene lasts */
  int64_t count;      /* else how often it comes */
  double (*spans)[2]; /* seconds of the scene's clock: when it comes, when it is gone */
} pags_presence;

/* Finds when object `object` has a pose (pags_object_pose). What is parked in the background is
 * always there. */
pags_result pags_presence_find(const pags_scene *scene, int64_t object, pags_presence *out);
void pags_presence_destroy(pags_presence *presence);

/* Logs how many objects aren't there all the time, which glTF can't show, and names the first. PAGS_ERROR_MEMORY. */
pags_result pags_presence_tell(const pags_scene *scene);

#ifdef __cplusplus
}
#endif
#endif
