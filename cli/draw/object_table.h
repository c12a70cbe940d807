/* SPDX-License-Identifier: Apache-2.0 */
/* The table of a scene's objects that lies beside pictures of --channel object: which number is which object. */
#ifndef PAGS_CLI_OBJECT_TABLE_H
#define PAGS_CLI_OBJECT_TABLE_H

#include <pags/scene.h>

/* Writes `folder`/objects.json. */
pags_result pags_object_table_write(const pags_scene *scene, const char *folder);

#endif
