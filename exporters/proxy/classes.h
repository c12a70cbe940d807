/* SPDX-License-Identifier: Apache-2.0 */
/* Classes of the background's surface: by the data set's semantic pictures, else by shape and colour. */
#ifndef PAGS_PROXY_CLASSES_H
#define PAGS_PROXY_CLASSES_H

#include "exporters/proxy/object_proxy.h"

/* PAGS_CLASS_SURFACE: all of a scene without photographs. */
enum { PAGS_CLASS_SURFACE = 6, PAGS_CLASSES };
extern const char *const pags_class_names[PAGS_CLASSES]; /* "road", "sidewalk", "building", ... */

/* Loads the data set's semantic picture of a view, if there is one, as classes at the depth view's size. */
void pags_classes_load(const pags_proxy_maker *maker, const pags_scene_view *view, pags_depth_view *depth_view);

/* Finds the class of each vertex: of the pictures with `labelled`, else guessed. */
pags_result pags_classes_find(const pags_proxy_maker *maker, const pags_depth_views *depth_views, bool labelled,
                              const pags_proxy_mesh *mesh, uint8_t *class_of);

#endif
