/* SPDX-License-Identifier: Apache-2.0 */
/* Writes objects.json (docs/render.md): number, name, id, class and kind of every object. */
#include "cli/draw/picture.h"

#include <stdlib.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "scene/object.h"

static void put_object(pags_json_writer *writer, const pags_scene *scene, int64_t number) {
  const pags_scene_object *const object = &scene->objects[number];
  char name[PAGS_OBJECT_NAME];
  pags_object_plain_name(object->record.class_name, number, name);
  pags_json_begin_object(writer, NULL);
  pags_json_put_integer(writer, "number", number);
  pags_json_put_string(writer, "name", name);
  pags_json_put_string(writer, "id", object->record.id);
  pags_json_put_string(writer, "class", object->record.class_name);
  pags_json_put_string(writer, "category", pags_category_name(object->record.category));
  pags_json_put_bool(writer, "critical", object->critical);
  pags_json_put_bool(writer, "moving", object->record.moving);
  pags_json_put_numbers(writer, "size", object->record.size, 3);
  pags_json_end_object(writer);
}

pags_result pags_object_table_write(const pags_scene *scene, const char *folder) {
  pags_json_writer writer;
  pags_json_writer_init(&writer, 2);
  pags_json_begin_object(&writer, NULL);
  pags_json_put_integer(&writer, "version", 1);
  pags_json_put_string(&writer, "channel", "object");
  pags_json_put_integer(&writer, "background", -1);
  pags_json_begin_array(&writer, "objects");
  for (int64_t i = 0; i < scene->object_count; i++)
    put_object(&writer, scene, i);
  pags_json_end_array(&writer);
  pags_json_end_object(&writer);
  pags_result result = pags_json_writer_finish(&writer);
  char *const path = pags_path_join(folder, "objects.json");
  if (result == PAGS_OK)
    result = path ? pags_file_write(path, writer.data, writer.size) : pags_out_of_memory("%s: a path", folder);
  free(path);
  pags_json_writer_destroy(&writer);
  return result;
}
