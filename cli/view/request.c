/* SPDX-License-Identifier: Apache-2.0 */
/* Parses the messages of pages. */
#include "cli/view/request.h"

#include <math.h>

#include "base/json.h"
#include "base/text.h"

static const int64_t most_serial = (int64_t)1 << 52;

static pags_result read_camera(const pags_json *json, const pags_json_value *object, pags_camera *out) {
  int64_t width, height;
  PAGS_TRY(pags_json_integer(json, object, "width", 1, PAGS_VIEW_SIDE, &width));
  PAGS_TRY(pags_json_integer(json, object, "height", 1, PAGS_VIEW_SIDE, &height));
  out->width = (int)width;
  out->height = (int)height;
  PAGS_TRY(pags_json_number(json, object, "fx", &out->fx));
  PAGS_TRY(pags_json_number(json, object, "fy", &out->fy));
  PAGS_TRY(pags_json_number(json, object, "cx", &out->cx));
  PAGS_TRY(pags_json_number(json, object, "cy", &out->cy));
  PAGS_TRY(pags_json_numbers(json, object, "pose", 12, out->world_from_camera));
  PAGS_TRY(pags_json_number_or(json, object, "time", (double)NAN, &out->time));
  /* Bounds far beyond any camera, which keep later arithmetic in the range of floats. */
  if (!(out->fx > 1e-3 && out->fx < 1e7 && out->fy > 1e-3 && out->fy < 1e7 && fabs(out->cx) < 1e7 &&
        fabs(out->cy) < 1e7))
    return pags_json_fail(json, object, "a lens out of bounds: expected fx and fy from 0.001 to 10,000,000 pixels");
  for (int i = 3; i < 12; i += 4)
    if (!(fabs(out->world_from_camera[i]) < 1e12))
      return pags_json_fail(json, object, "a position out of bounds");
  return pags_camera_check(out, "message: the camera");
}

static pags_result read_hidden(const pags_json *json, const pags_json_value *root, pags_view_look *look) {
  const pags_json_value *list = pags_json_member(root, "hidden");
  look->hidden_count = 0;
  if (!list)
    return PAGS_OK;
  if (list->type != PAGS_JSON_ARRAY || list->count > PAGS_VIEW_HIDDEN)
    return pags_json_fail(json, list, "'hidden': expected at most %d indices of objects", PAGS_VIEW_HIDDEN);
  for (const pags_json_value *item = list->first; item; item = item->next) {
    double index;
    PAGS_TRY(pags_json_as_number(json, item, "an index of 'hidden'", &index));
    if (!(index >= 0 && index < 2147483647) || index != floor(index))
      return pags_json_fail(json, item, "'hidden': expected indices of objects");
    look->hidden[look->hidden_count++] = (int32_t)index;
  }
  return PAGS_OK;
}

static pags_result read_look(const pags_json *json, const pags_json_value *root, pags_view_look *look) {
  static const char *const channels[PAGS_VIEW_CHANNELS] = {"color",  "depth", "priority",   "critical",
                                                           "object", "size",  "photograph", "difference"};
  const pags_json_value *camera;
  const char *name;
  PAGS_TRY(pags_json_object(json, root, "camera", &camera));
  PAGS_TRY(read_camera(json, camera, &look->camera));
  PAGS_TRY(pags_json_string_or(json, root, "channel", "color", &name));
  const int channel = pags_text_find(name, channels, PAGS_VIEW_CHANNELS);
  if (channel < 0)
    return pags_json_fail(json, root, "no channel is called '%.40s'", name);
  look->channel = (pags_view_channel)channel;
  PAGS_TRY(pags_json_integer_or(json, root, "view", -1, 2147483647, -1, &look->view));
  PAGS_TRY(pags_json_integer_or(json, root, "solo", -1, 2147483647, -1, &look->solo));
  PAGS_TRY(pags_json_bool_or(json, root, "full", false, &look->full));
  PAGS_TRY(pags_json_bool_or(json, root, "earlyZ", true, &look->early_z));
  return read_hidden(json, root, look);
}

static pags_result read_root(const pags_json *json, pags_view_request *out) {
  static const char *const kinds[] = {"look", "pick", "got", "run", "checkpoint", "stop"}; /* as pags_view_kind */
  const pags_json_value *root = pags_json_root(json);
  const char *name;
  PAGS_TRY(pags_json_as_object(json, root, "a message"));
  PAGS_TRY(pags_json_string(json, root, "type", &name));
  PAGS_TRY(pags_json_integer(json, root, "serial", 0, most_serial, &out->serial));
  const int kind = pags_text_find(name, kinds, sizeof kinds / sizeof *kinds);
  if (kind < 0)
    return pags_json_fail(json, root, "no message is of type '%.40s'", name);
  out->kind = (pags_view_kind)kind;
  if (out->kind == PAGS_VIEW_LOOK) {
    out->look.serial = out->serial;
    return read_look(json, root, &out->look);
  }
  if (out->kind == PAGS_VIEW_PICK) {
    PAGS_TRY(pags_json_number(json, root, "x", &out->x));
    PAGS_TRY(pags_json_number(json, root, "y", &out->y));
    return fabs(out->x) < 1e6 && fabs(out->y) < 1e6 ? PAGS_OK : pags_json_fail(json, root, "no such pixel");
  }
  if (out->kind == PAGS_VIEW_RUN) {
    PAGS_TRY(pags_json_integer(json, root, "edition", 0, most_serial, &out->edition));
    return pags_json_integer(json, root, "from", 0, most_serial, &out->from);
  }
  return PAGS_OK;
}

pags_result pags_view_request_parse(const char *text, size_t size, pags_view_request *out) {
  memset(out, 0, sizeof *out);
  if (size > PAGS_VIEW_MESSAGE)
    return pags_fail(PAGS_ERROR_LIMIT, "a message of %zu bytes: expected at most %d", size, PAGS_VIEW_MESSAGE);
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_TRY(pags_json_parse_text("message", text, size, &json));
  return read_root(json, out);
}
