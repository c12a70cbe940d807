/* SPDX-License-Identifier: Apache-2.0 */
/* The names under which the pictures of views are written: no two are the same, in any letter case. */
#ifndef PAGS_CLI_PICTURE_NAMES_H
#define PAGS_CLI_PICTURE_NAMES_H

#include <pags/dataset.h>
#include <pags/scene.h>

typedef struct pags_picture_names {
  int64_t count;
  char **items; /* names without folder and extension, in the order of the views */
} pags_picture_names;

/* A view's name is its photograph's without the extension: "cam0/DSC_01.JPG" is "cam0/DSC_01"; of one that would leave
 * the folder, "../DSC_01.JPG", only what follows the last slash. Where an earlier view has that name (a.jpg and a.png,
 * or A.jpg), the extension stays, "a.png"; where that is another's, too, the number of the view follows, "a.png-12". */
pags_result pags_picture_names_of_scene(const pags_scene *scene, pags_picture_names *out);
pags_result pags_picture_names_of_dataset(const pags_dataset *dataset, pags_picture_names *out);
void pags_picture_names_destroy(pags_picture_names *names);

#endif
