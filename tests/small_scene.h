/* SPDX-License-Identifier: Apache-2.0 */
/* A driving scene of ten Gaussians for tests: a parked and a moving object, a sky, a camera, and a value for
 * everything that scene.json can hold. */
#ifndef PAGS_TESTS_SMALL_SCENE_H
#define PAGS_TESTS_SMALL_SCENE_H

#include <pags/scene.h>

/* Makes the scene; aborts if memory runs out. */
void small_scene_make(pags_scene *scene);

#endif
