/* SPDX-License-Identifier: Apache-2.0 */
/* Renders looks under the deadline controller, colours the channels and encodes the pictures. */
#include "cli/view/renderer.h"

#include "cli/common/photographs.h"
#include "cli/draw/picture.h"

#include <math.h>
#include <pags/eval.h>
#include <pags/image.h>
#include <pags/pick.h>
#include "base/file.h"
#include "base/psnr.h"
#include "base/vec3.h"
#include "image/formats.h"
#include "maths/maths.h"

struct pags_renderer {
  pags_renderer_settings settings;
  pags_deadline *deadline;
  float *priority_of; /* per id; all 0 if the scene has no priorities */
  int32_t *object_of; /* per id */
  float *size_of;     /* per id, metres: geometric mean of the sigmas; only for the channel of sizes */
  int64_t id_room;    /* capacity of these arrays */
  pags_part *parts;   /* the visible parts of the current look */
  int64_t part_room;
  pags_photographs photographs; /* zeros until a page asks for one */
};

/* ---- Start and end ---- */

pags_result pags_renderer_set_scene(pags_renderer *renderer, pags_composition *composition) {
  const int64_t count = pags_composition_gaussian_count(composition);
  int64_t rooms[3] = {renderer->id_room, renderer->id_room, renderer->id_room};
  renderer->settings.composition = NULL;
  PAGS_CHECK_MEMORY(pags_grow(&renderer->priority_of, count + 1, &rooms[0], sizeof *renderer->priority_of) &&
                        pags_grow(&renderer->object_of, count + 1, &rooms[1], sizeof *renderer->object_of) &&
                        pags_grow(&renderer->size_of, count + 1, &rooms[2], sizeof *renderer->size_of),
                    "the channels of %lld Gaussians", (long long)count);
  renderer->id_room = rooms[0];
  memset(renderer->priority_of, 0, (size_t)count * sizeof *renderer->priority_of);
  memset(renderer->object_of, 0, (size_t)count * sizeof *renderer->object_of);
  pags_composition_priorities(composition, renderer->priority_of);
  pags_composition_objects(composition, renderer->object_of);
  PAGS_TRY(pags_deadline_set_priorities(renderer->deadline, renderer->priority_of, count));
  renderer->settings.composition = composition;
  return PAGS_OK;
}

pags_result pags_renderer_create(const pags_renderer_settings *settings, pags_renderer **out) {
  pags_renderer *renderer = calloc(1, sizeof *renderer);
  *out = renderer;
  PAGS_CHECK_MEMORY(renderer, NULL);
  renderer->settings = *settings;
  PAGS_TRY(pags_deadline_create(settings->tasks, NULL, 0, &renderer->deadline));
  return settings->composition ? pags_renderer_set_scene(renderer, settings->composition) : PAGS_OK;
}

void pags_renderer_destroy(pags_renderer *renderer) {
  if (!renderer)
    return;
  pags_photographs_close(&renderer->photographs);
  pags_deadline_destroy(renderer->deadline);
  free(renderer->priority_of);
  free(renderer->object_of);
  free(renderer->size_of);
  free(renderer->parts);
  free(renderer);
}

pags_deadline_controller pags_renderer_controller(const pags_renderer *renderer) {
  return pags_deadline_controller_begin_live(renderer->settings.budget_ms);
}

/* ---- Parts ---- */

static bool is_shown(const pags_view_look *look, int64_t object) {
  if (look->solo >= 0 && object != look->solo)
    return false;
  for (int i = 0; i < look->hidden_count; i++)
    if (look->hidden[i] == object)
      return false;
  return true;
}

/* Composes the scene at `time` and selects the visible parts of the look. */
static pags_result compose(pags_renderer *renderer, const pags_view_look *look, double time, int *count) {
  const pags_part *all;
  int all_count;
  pags_compose(renderer->settings.composition, time, &all, &all_count);
  PAGS_CHECK_MEMORY(pags_grow(&renderer->parts, all_count, &renderer->part_room, sizeof *renderer->parts), NULL);
  *count = 0;
  for (int i = 0; i < all_count; i++)
    if (is_shown(look, all[i].label))
      renderer->parts[(*count)++] = all[i];
  return PAGS_OK;
}

/* ---- Colours of channels ---- */

/* Colour of an object; neighbouring indices differ in hue (steps of the golden ratio). */
static void object_color(int64_t object, float rgb[3]) {
  const double hue = 0.61803398875 * (double)(object + 1), turn = 6 * (hue - floor(hue));
  for (int c = 0; c < 3; c++) {
    const double far = fabs(fmod(turn + 6 - 2 * c, 6) - 3) - 1;
    rgb[c] = (float)(0.25 + 0.75 * fmin(fmax(far, 0), 1));
  }
}

static void measure_sizes(pags_renderer *renderer, int count) {
  for (int k = 0; k < count; k++) {
    const pags_part *part = &renderer->parts[k];
    const pags_gaussians *g = part->gaussians;
    for (int64_t row = 0; row < g->count; row++) {
      const float sum =
          pags_plane(g, PAGS_SCALE)[row] + pags_plane(g, PAGS_SCALE + 1)[row] + pags_plane(g, PAGS_SCALE + 2)[row];
      renderer->size_of[part->id ? part->id[row] : part->first_id + row] = (float)pags_exp((double)sum / 3);
    }
  }
}

static void color_pixel(const pags_renderer *renderer, const pags_picture *p, pags_view_channel channel, size_t i,
                        float rgb[3]) {
  const int32_t id = p->id[i];
  const float grey = 0.2126F * p->rgb[0][i] + 0.7152F * p->rgb[1][i] + 0.0722F * p->rgb[2][i];
  const int64_t object = id < 0 ? -1 : renderer->object_of[id];
  for (int c = 0; c < 3; c++)
    rgb[c] = p->rgb[c][i];
  if (channel == PAGS_VIEW_DEPTH) {
    /* 1 m is the brightest, 256 m is black; half the distance adds one eighth */
    const double z = p->depth[i], bright = z > 0 ? 1 - pags_log(fmax(z, 1)) / pags_log(256) : 0;
    pags_colormap_heat((float)fmax(bright, 0), rgb);
  } else if (channel == PAGS_VIEW_SIZE) {
    /* 1 mm is black, 10 m the brightest; each factor of ten adds one quarter */
    const double bright = id < 0 ? 0 : 0.25 * pags_log10(fmax((double)renderer->size_of[id], 1e-3) / 1e-3);
    pags_colormap_heat((float)fmin(bright, 1), rgb);
  } else if (channel == PAGS_VIEW_PRIORITY) {
    pags_colormap_heat(id < 0 ? 0 : renderer->priority_of[id], rgb);
  } else if (channel == PAGS_VIEW_CRITICAL && !(id >= 0 && renderer->priority_of[id] > 0.5F)) {
    rgb[0] = rgb[1] = rgb[2] = 0.35F * grey;
  } else if (channel == PAGS_VIEW_OBJECT) {
    if (object >= 0)
      object_color(object, rgb);
    for (int c = 0; c < 3; c++)
      rgb[c] = object >= 0 ? rgb[c] * (0.35F + 0.65F * grey) : 0.35F * grey;
  }
}

static uint8_t to_byte(float value) {
  return (uint8_t)(255 * (value > 0 ? value < 1 ? value : 1 : 0) + 0.5F);
}

static pags_result to_image(const pags_renderer *renderer, const pags_picture *picture, pags_view_channel channel,
                            pags_image *out) {
  if (channel == PAGS_VIEW_COLOR)
    return pags_picture_to_image(picture, PAGS_U8, out);
  PAGS_TRY(pags_image_create(out, picture->width, picture->height, 3, PAGS_U8));
  uint8_t *to = out->data;
  for (int y = 0; y < picture->height; y++)
    for (int x = 0; x < picture->width; x++) {
      float rgb[3];
      color_pixel(renderer, picture, channel, (size_t)y * (size_t)picture->stride + (size_t)x, rgb);
      for (int c = 0; c < 3; c++)
        *to++ = to_byte(rgb[c]);
    }
  return PAGS_OK;
}

/* ---- Messages ---- */

pags_result pags_view_message_of(pags_json_writer *json, pags_view_message *out) {
  pags_json_end_object(json);
  const pags_result result = pags_json_writer_finish(json);
  if (result == PAGS_OK)
    *out = (pags_view_message){.bytes = pags_take(&json->data), .size = json->size};
  pags_json_writer_destroy(json);
  return result;
}

static pags_json_writer begin(const char *type, int64_t serial) {
  pags_json_writer json = {0};
  pags_json_begin_object(&json, NULL);
  pags_json_put_string(&json, "type", type);
  pags_json_put_integer(&json, "serial", serial);
  return json;
}

pags_result pags_renderer_error_message(const char *text, int64_t serial, pags_view_message *out) {
  pags_json_writer json = begin("error", serial);
  pags_json_put_string(&json, "text", text);
  return pags_view_message_of(&json, out);
}

static pags_result send_picture(const pags_view_look *look, const pags_image *image, int percent, bool sharp,
                                const pags_deadline_result *drawn, double psnr, pags_view_message *out) {
  const pags_frame_stats *s = &drawn->stats;
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer json = begin("picture", look->serial);
  pags_json_put_integer(&json, "width", image->width);
  pags_json_put_integer(&json, "height", image->height);
  pags_json_put_bool(&json, "sharp", sharp);
  pags_json_put_number(&json, "psnr", psnr);
  pags_json_put_integer(&json, "step", drawn->step);
  pags_json_put_number(&json, "drawMs", drawn->ms);
  pags_json_put_number(&json, "fullTiles", drawn->full_tiles);
  pags_json_put_integer(&json, "gaussians", s->gaussians);
  pags_json_put_integer(&json, "inView", s->in_view);
  pags_json_put_integer(&json, "loaded", s->loaded);
  pags_json_put_integer(&json, "hidden", s->hidden);
  pags_json_put_integer(&json, "shaded", s->shaded);
  pags_json_put_integer(&json, "pairs", s->pairs_binned);
  pags_json_put_integer(&json, "clustersHidden", s->clusters_hidden);
  pags_json_end_object(&json);
  PAGS_TRY(pags_json_writer_finish(&json));
  pags_sink jpeg = {0};
  const pags_result encoded = pags_jpeg_encode("the picture", image, percent, &jpeg);
  PAGS_AUTOFREE unsigned char *file = jpeg.bytes;
  PAGS_TRY(encoded);
  const size_t head = 4 + json.size;
  unsigned char *bytes = malloc(head + jpeg.size);
  PAGS_CHECK_MEMORY(bytes, NULL);
  for (int i = 0; i < 4; i++)
    bytes[i] = (unsigned char)(json.size >> (8 * i));
  memcpy(bytes + 4, json.data, json.size);
  memcpy(bytes + head, file, jpeg.size);
  *out = (pags_view_message){.bytes = bytes, .size = head + jpeg.size, .binary = true};
  return PAGS_OK;
}

/* ---- Pictures ---- */

static pags_result draw_scene(pags_renderer *renderer, const pags_view_look *look, const pags_renderer_quality *quality,
                              pags_view_message *out) {
  pags_frame_options options = pags_composition_options(renderer->settings.composition);
  pags_deadline_result drawn;
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  pags_picture picture;
  int count;
  PAGS_TRY(compose(renderer, look, look->camera.time, &count));
  options.extra_channels = look->channel != PAGS_VIEW_COLOR;
  if (!look->early_z)
    options.early_z = PAGS_EARLY_Z_OFF;
  if (look->channel == PAGS_VIEW_SIZE)
    measure_sizes(renderer, count);
  PAGS_TRY(pags_deadline_render_step(renderer->deadline, quality->step, renderer->parts, count, &look->camera, &options,
                                     &picture, &drawn));
  PAGS_TRY(to_image(renderer, &picture, look->channel, &image));
  return send_picture(look, &image, quality->percent, quality->sharp, &drawn, (double)NAN, out);
}

/* ---- Photographs ---- */

static pags_result open_photographs(pags_renderer *renderer) {
  enum { CACHE = 64 << 20 }; /* bytes of decoded photographs */
  const pags_renderer_settings *settings = &renderer->settings;
  const pags_scene *scene = pags_composition_scene(settings->composition);
  if (renderer->photographs.dataset)
    return PAGS_OK;
  if (settings->photographs)
    return pags_photographs_of(settings->photographs, settings->tasks, CACHE, &renderer->photographs);
  if (!settings->dataset && !scene->dataset)
    return pags_fail(PAGS_ERROR_ARGUMENT,
                     "the scene doesn't name its data set: start pags view with --dataset DATASET");
  return pags_photographs_open_for(scene, settings->dataset, &settings->dataset_options, settings->tasks, CACHE,
                                   &renderer->photographs);
}

/* Renders the view from its own camera with the exposure of its photograph, as floats 0..1. */
static pags_result draw_view(pags_renderer *renderer, const pags_view_look *look, const pags_scene_view *view,
                             int width, int height, pags_image *out, pags_deadline_result *drawn) {
  pags_frame_options options = pags_composition_options(renderer->settings.composition);
  pags_picture picture;
  int count;
  const pags_camera camera = view->camera;
  if (camera.width != width || camera.height != height)
    return pags_fail_at(view->name, "the photograph has %dx%d pixels, its camera %dx%d", width, height, camera.width,
                        camera.height);
  PAGS_TRY(compose(renderer, look, camera.time, &count));
  options.photometric = view->photometric;
  pags_frame_options_expose(&options, view->gain, view->offset);
  PAGS_TRY(
      pags_deadline_render_step(renderer->deadline, 0, renderer->parts, count, &camera, &options, &picture, drawn));
  return pags_picture_to_image(&picture, PAGS_F32, out);
}

static pags_result compare(pags_renderer *renderer, const pags_view_look *look, const pags_photograph *photograph,
                           const pags_scene_view *view, pags_view_message *out) {
  enum { QUALITY = 92, TIMES = 3 };
  const pags_image *photo = &photograph->image;
  PAGS_AUTO(pags_image_destroy) pags_image picture = {0}, shown = {0};
  pags_deadline_result drawn;
  double psnr;
  PAGS_TRY(draw_view(renderer, look, view, photo->width, photo->height, &picture, &drawn));
  PAGS_TRY(pags_eval_psnr(&picture, photo, photograph->mask, &psnr));
  PAGS_TRY(pags_image_create(&shown, photo->width, photo->height, 3, PAGS_U8));
  const float *a = picture.data, *b = photo->data;
  uint8_t *to = shown.data;
  const size_t samples = 3 * (size_t)photo->width * (size_t)photo->height;
  for (size_t i = 0; i < samples; i++)
    to[i] = to_byte(look->channel == PAGS_VIEW_PHOTOGRAPH ? b[i] : TIMES * fabsf(a[i] - b[i]));
  return send_picture(look, &shown, QUALITY, true, &drawn, pags_psnr_capped(psnr), out);
}

static pags_result draw_photograph(pags_renderer *renderer, const pags_view_look *look, pags_view_message *out) {
  const pags_scene *scene = pags_composition_scene(renderer->settings.composition);
  pags_photographs *photographs = &renderer->photographs;
  PAGS_AUTO(pags_photograph_destroy) pags_photograph photograph = {0};
  if (look->view < 0 || look->view >= scene->view_count)
    return pags_fail(PAGS_ERROR_ARGUMENT, "no recorded camera is selected");
  PAGS_TRY(open_photographs(renderer));
  const pags_scene_view *view = &scene->views[look->view];
  int64_t i = 0;
  while (i < photographs->count && (photographs->borrowed ? i != look->view : photographs->views[i].scene_view != view))
    i++;
  if (i == photographs->count)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: the data set has no photograph of it", view->name);
  PAGS_TRY(pags_photographs_read(photographs, i, &photograph));
  return compare(renderer, look, &photograph, view, out);
}

pags_result pags_renderer_draw(pags_renderer *renderer, const pags_view_look *look,
                               const pags_renderer_quality *quality, pags_view_message *out) {
  const bool photograph = look->channel == PAGS_VIEW_PHOTOGRAPH || look->channel == PAGS_VIEW_DIFFERENCE;
  return photograph ? draw_photograph(renderer, look, out) : draw_scene(renderer, look, quality, out);
}

/* ---- Picking ---- */

pags_result pags_renderer_pick(pags_renderer *renderer, const pags_view_look *look, double x, double y, int64_t serial,
                               pags_view_message *out) {
  const pags_camera *camera = &look->camera;
  const double ray[3] = {(x - camera->cx) / camera->fx, (y - camera->cy) / camera->fy, 1};
  double eye[3], direction[3];
  pags_picked picked;
  int count;
  pags_pose_position(camera->world_from_camera, eye);
  pags_rotate3(camera->world_from_camera, ray, direction);
  PAGS_TRY(compose(renderer, look, camera->time, &count));
  PAGS_TRY(
      pags_composition_pick(renderer->settings.composition, renderer->parts, count, eye, direction, NULL, &picked));
  pags_json_writer json = begin("picked", serial);
  pags_json_put_bool(&json, "hit", picked.part >= 0);
  if (picked.part >= 0) {
    const int64_t object = picked.object >= 0 ? picked.object : renderer->object_of[picked.id];
    pags_json_put_numbers(&json, "point", picked.point, 3);
    pags_json_put_number(&json, "depth", picked.depth);
    pags_json_put_integer(&json, "gaussian", picked.id);
    pags_json_put_integer(&json, "object", object);
    pags_json_put_number(&json, "priority", (double)renderer->priority_of[picked.id]);
  }
  return pags_view_message_of(&json, out);
}
