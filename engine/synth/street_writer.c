/* SPDX-License-Identifier: Apache-2.0 */
/* Writes a synthetic street as a driving data set. Frame by frame, all pictures are traced in parallel, then all
 * files of the frame are written in parallel. */
#include <pags/image.h>
#include <pags/synth.h>

#include <stdarg.h>
#include <stdio.h>

#include "base/file.h"
#include "base/lock.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "synth/faults.h"
#include "synth/view.h"

enum { CAMERAS = 3, SHIFTS = 4, VIEWS = CAMERAS + SHIFTS, SHIFT_EVERY = 4 };

static const struct shift {
  const char *name;
  double right, up; /* metres */
} shifts[SHIFTS] = {{"right1", 1, 0}, {"right2", 2, 0}, {"right3", 3, 0}, {"up1", 0, 1}};

pags_street_options pags_street_options_default(void) {
  return (pags_street_options){.width = 480,
                               .height = 270,
                               .frames = 40,
                               .fps = 10,
                               .cameras = 3,
                               .samples = 8,
                               .objects = 8,
                               .lidar_points = 20000,
                               .lidar_noise = 0.02,
                               .shifts = 1};
}

/* ---- The folder and the images' memory ---- */

typedef struct writer {
  const char *folder;
  pags_street *street;
  pags_stage *stage;
  pags_tasks *tasks;
  pags_lock *lock;
  pags_street_view views[VIEWS];
  int view_count, frame;
  float *points; /* of a sweep */
} writer;

static void destroy(writer *w) {
  pags_lock_release(w->lock);
  pags_stage_destroy(w->stage);
  for (int i = 0; i < VIEWS; i++) {
    free(w->views[i].rgb);
    free(w->views[i].depth);
    free(w->views[i].labels);
    free(w->views[i].actors);
  }
  free(w->points);
}

/* Gives the path of a file in the folder, which the caller frees. */
static pags_result find_path(const writer *w, char **out, const char *format, ...) PAGS_PRINTF(3, 4);
static pags_result find_path(const writer *w, char **out, const char *format, ...) {
  char relative[64];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(relative, sizeof relative, format, arguments);
  va_end(arguments);
  *out = pags_path_join(w->folder, relative);
  PAGS_CHECK_MEMORY(*out, "%s", w->folder);
  return PAGS_OK;
}

static pags_result make_views(writer *w) {
  const pags_street_options *o = w->street->options;
  const size_t pixels = (size_t)o->width * (size_t)o->height;
  w->points = malloc(((size_t)o->lidar_points + 1) * 4 * sizeof *w->points);
  bool complete = w->points;
  for (int i = 0; i < VIEWS; i++) {
    pags_street_view *view = &w->views[i];
    view->rgb = malloc(3 * pixels);
    view->depth = malloc(pixels * sizeof *view->depth);
    view->labels = malloc(pixels);
    view->actors = malloc(pixels * sizeof *view->actors);
    complete &= view->rgb && view->depth && view->labels && view->actors;
  }
  PAGS_CHECK_MEMORY(complete, "pictures of %dx%d", o->width, o->height);
  return PAGS_OK;
}

/* ---- Image files ---- */

/* The one-channel images that are derived from a view's labels and actors. */
typedef enum plane { SEMANTIC, SKY, MOVING, VEHICLE, HUMAN, IDS, PLANES } plane;
static const char *const plane_folders[PLANES] = {
    "semantic", "sky_masks", "dynamic_masks/all", "dynamic_masks/vehicle", "dynamic_masks/human", "truth/ids"};

/* Returns the value of an image at pixel index `at`. */
static int pixel_of(const writer *w, const pags_street_view *view, plane which, size_t at) {
  const pags_actor *actor = view->actors[at] < 0 ? NULL : &w->street->actors[view->actors[at]];
  const bool moving = actor && actor->moving, car = actor && actor->role == PAGS_ROLE_CAR;
  switch (which) {
    case SEMANTIC: return view->labels[at];
    case SKY: return view->labels[at] == PAGS_CLASS_SKY ? 255 : 0;
    case MOVING: return moving ? 255 : 0;
    case VEHICLE: return moving && car ? 255 : 0;
    case HUMAN: return moving && !car ? 255 : 0;
    default: return actor ? actor->number + 1 : 0;
  }
}

static pags_result save_plane(const writer *w, const pags_street_view *view, plane which, const char *path) {
  const int width = view->camera.width, height = view->camera.height;
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  PAGS_TRY(pags_image_create(&image, width, height, 1, which == IDS ? PAGS_U16 : PAGS_U8));
  for (size_t i = 0; i < (size_t)width * (size_t)height; i++) {
    const int value = pixel_of(w, view, which, i);
    if (which == IDS)
      ((uint16_t *)image.data)[i] = (uint16_t)value;
    else
      ((uint8_t *)image.data)[i] = (uint8_t)value;
  }
  return pags_image_save(path, &image);
}

static pags_result save_picture(const pags_street_view *view, const char *path) {
  const pags_image image = {
      .width = view->camera.width, .height = view->camera.height, .channels = 3, .sample = PAGS_U8, .data = view->rgb};
  return pags_image_save(path, &image);
}

/* Writes file number `item` of the current frame. In order of numbers: for each camera its one-channel images, its
 * depth and its picture, then of each shifted camera its picture and its classes. */
static pags_result save_file(void *context, int64_t item, PAGS_UNUSED int worker) {
  enum { EACH = PLANES + 2 };
  const writer *w = context;
  const int index = (int)item, cameras = w->street->options->cameras, camera = index / EACH, kind = index % EACH;
  const int extra = index - EACH * cameras; /* >= 0: a file of a shifted camera, two for each */
  PAGS_AUTOFREE char *path = NULL;
  if (extra >= 0) {
    const pags_street_view *view = &w->views[cameras + extra / 2];
    PAGS_TRY(find_path(w, &path, "truth/shift/%s/%05d%s.png", shifts[extra / 2].name, w->frame / SHIFT_EVERY - 1,
                       extra % 2 ? "_semantic" : ""));
    return extra % 2 ? save_plane(w, view, SEMANTIC, path) : save_picture(view, path);
  }
  const pags_street_view *view = &w->views[camera];
  if (kind < PLANES) {
    PAGS_TRY(find_path(w, &path, "%s/%03d_%d.png", plane_folders[kind], w->frame, camera));
    return save_plane(w, view, (plane)kind, path);
  }
  if (kind > PLANES) {
    PAGS_TRY(find_path(w, &path, "images/%03d_%d.png", w->frame, camera));
    return save_picture(view, path);
  }
  static const char *const name = "Z";
  const float *depth = view->depth;
  PAGS_TRY(find_path(w, &path, "truth/depth/%03d_%d.exr", w->frame, camera));
  return pags_image_save_exr(path, view->camera.width, view->camera.height, 1, &name, &depth, view->camera.width, NULL);
}

/* ---- Folders ---- */

static pags_result make_folder(const writer *w, const char *parent, const char *name) {
  PAGS_AUTOFREE char *path = NULL;
  PAGS_TRY(find_path(w, &path, "%s%s", parent, name));
  return pags_make_dirs(path);
}

static pags_result make_folders(const writer *w) {
  static const char *const names[] = {"images",    "ego_pose",        "extrinsics",  "intrinsics",   "lidar",
                                      "instances", "truth/instances", "truth/depth", "truth/cameras"};
  const pags_street_options *o = w->street->options;
  bool empty = true;
  PAGS_TRY(pags_dir_is_empty(w->folder, &empty));
  if (!empty && !o->overwrite)
    return pags_fail(PAGS_ERROR_IO, "%s: expected an empty or a new folder", w->folder);
  for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
    PAGS_TRY(make_folder(w, "", names[i]));
  for (int i = 0; i < PLANES; i++)
    PAGS_TRY(make_folder(w, "", plane_folders[i]));
  for (int i = 0; i < SHIFTS && o->shifts; i++)
    PAGS_TRY(make_folder(w, "truth/shift/", shifts[i].name));
  /* An old dataset.json is removed before anything is written, and the new one is written last: a folder left by an
   * unfinished run does not open as a data set. */
  PAGS_AUTOFREE char *old = NULL;
  PAGS_TRY(find_path(w, &old, "dataset.json"));
  return pags_remove_tree(old);
}

/* ---- One frame ---- */

static bool is_shift_frame(const pags_street_options *o, int frame) {
  return o->shifts && frame > 0 && frame % SHIFT_EVERY == 0;
}

static pags_result write_frame(writer *w, int frame) {
  const pags_street_options *o = w->street->options;
  const double time = frame / o->fps;
  pags_street *street = w->street;
  w->frame = frame;
  w->view_count = o->cameras;
  PAGS_TRY(pags_street_expose(street, w->stage, frame, w->views, w->tasks));
  pags_street_set_time(street, time);
  PAGS_TRY(pags_stage_commit(w->stage, street->first_moving, street->placement_count - street->first_moving));
  /* The views of the shifted cameras, which have no faults, follow those of the cameras; of them, the picture
   * and the classes are written. */
  writer shown = *w;
  for (int i = 0; is_shift_frame(o, frame) && i < SHIFTS; i++)
    shown.views[shown.view_count++] =
        (pags_street_view){.camera = pags_street_camera(o, time, 0, shifts[i].right, shifts[i].up),
                           .sensor = -1,
                           .rgb = w->views[CAMERAS + i].rgb,
                           .depth = w->views[CAMERAS + i].depth,
                           .labels = w->views[CAMERAS + i].labels,
                           .actors = w->views[CAMERAS + i].actors};
  PAGS_TRY(pags_street_draw(street, w->stage, shown.views + o->cameras, shown.view_count - o->cameras, NULL, w->tasks));

  /* Write the images of all views. */
  const int files = (PLANES + 2) * o->cameras + 2 * (shown.view_count - o->cameras);
  PAGS_TRY(pags_parallel_try(w->tasks, files, save_file, &shown, "cancelled"));

  double ego[12];
  PAGS_AUTOFREE char *sweep_path = NULL;
  PAGS_AUTOFREE char *ego_path = NULL;
  PAGS_TRY(find_path(w, &sweep_path, "lidar/%03d.bin", frame));
  PAGS_TRY(find_path(w, &ego_path, "ego_pose/%03d.txt", frame));
  const int64_t points = pags_sweep_trace(street, w->stage, frame, w->tasks, w->points);
  PAGS_TRY(pags_file_write(sweep_path, w->points, (size_t)points * 4 * sizeof *w->points));
  pags_faults_ego(o, frame, ego);
  return pags_street_write_pose(ego_path, ego);
}

/* ---- Text files and the whole data set ---- */

typedef pags_result text_fn(const pags_street *street, const char *path);

static pags_result write_text(const writer *w, const char *relative, text_fn *write) {
  PAGS_AUTOFREE char *path = NULL;
  PAGS_TRY(find_path(w, &path, "%s", relative));
  return write(w->street, path);
}

/* Writes the path of a camera of the car, as it really is, or of a shifted one (`s`). */
static pags_result write_path(const writer *w, const char *path, int camera, const struct shift *s) {
  const pags_street_options *o = w->street->options;
  PAGS_AUTO(pags_camera_path_destroy) pags_camera_path cameras = {.fps = s ? o->fps / SHIFT_EVERY : o->fps};
  cameras.cameras = malloc((size_t)o->frames * sizeof *cameras.cameras);
  PAGS_CHECK_MEMORY(cameras.cameras, "%s", w->folder);
  for (int f = 0; f < o->frames; f++)
    if (!s || is_shift_frame(o, f))
      cameras.cameras[cameras.count++] =
          s ? pags_street_camera(o, f / o->fps, 0, s->right, s->up) : pags_faults_camera(o, f, camera, -1);
  return pags_camera_path_save(path, &cameras);
}

static pags_result write_texts(const writer *w) {
  /* Poses of the cameras in the ego frame, and their intrinsics. */
  const pags_street_options *o = w->street->options;
  for (int c = 0; c < o->cameras; c++) {
    const pags_camera camera = pags_faults_camera(o, 0, c, -1);
    double mount[12];
    PAGS_AUTOFREE char *extrinsics = NULL;
    PAGS_AUTOFREE char *intrinsics = NULL;
    PAGS_AUTOFREE char *path = NULL;
    PAGS_TRY(find_path(w, &extrinsics, "extrinsics/%d.txt", c));
    PAGS_TRY(find_path(w, &intrinsics, "intrinsics/%d.txt", c));
    PAGS_TRY(find_path(w, &path, "truth/cameras/%d.json", c));
    pags_faults_mount(o, c, mount);
    PAGS_TRY(pags_street_write_pose(extrinsics, mount));
    PAGS_TRY(pags_street_write_intrinsics(intrinsics, &camera, o->faults.distortion));
    PAGS_TRY(write_path(w, path, c, NULL));
  }
  PAGS_TRY(pags_street_write_instances(w->street, w->folder));
  PAGS_TRY(write_text(w, "truth/street.json", pags_street_write_truth));
  PAGS_TRY(write_text(w, "timestamps.json", pags_street_write_timestamps));
  /* Camera paths of the shifted pictures; with too few frames there is no such picture, and no path. */
  for (int i = 0; o->shifts && o->frames > SHIFT_EVERY && i < SHIFTS; i++) {
    PAGS_AUTOFREE char *path = NULL;
    PAGS_TRY(find_path(w, &path, "truth/shift/%s/path.json", shifts[i].name));
    PAGS_TRY(write_path(w, path, 0, &shifts[i]));
  }
  return PAGS_OK;
}

pags_result pags_synth_street(const char *folder, const pags_street_options *o, pags_tasks *tasks,
                              pags_progress_fn *progress, void *user) {
  /* Ranges of the options. */
  PAGS_TRY(pags_synth_in_range("width", o->width, 16, 8192));
  PAGS_TRY(pags_synth_in_range("height", o->height, 16, 8192));
  PAGS_TRY(pags_synth_in_range("frames", o->frames, 2, 10000));
  PAGS_TRY(pags_synth_in_range("fps", o->fps, 0.1, 1000.0));
  PAGS_TRY(pags_synth_in_range("frames / fps", o->frames / o->fps, 0.0,
                               1000.0)); /* seconds; the street is built as long as the car drives */
  PAGS_TRY(pags_synth_in_range("cameras", o->cameras, 1, CAMERAS));
  PAGS_TRY(pags_synth_in_range("samples", o->samples, 1, 1024));
  PAGS_TRY(pags_synth_in_range("objects", o->objects, 0, 64));
  PAGS_TRY(pags_synth_in_range("lidar_points", (double)o->lidar_points, 0, 1000000));
  PAGS_TRY(pags_synth_in_range("lidar_noise", o->lidar_noise, 0.0, 10.0));
  PAGS_TRY(pags_synth_in_range("pose_noise", o->pose_noise, 0.0, 10.0));
  PAGS_TRY(pags_synth_in_range("yaw_noise", o->yaw_noise, 0.0, 180.0));
  PAGS_TRY(pags_faults_check(&o->faults));

  PAGS_AUTO(pags_street_destroy) pags_street street = {.options = o};
  PAGS_AUTO(destroy) writer w = {.folder = folder, .street = &street, .tasks = tasks};
  PAGS_TRY(pags_street_build(o, &street));
  pags_street_number(&street);
  PAGS_TRY(pags_stage_create(street.meshes, street.mesh_count, street.placements, street.placement_count, &w.stage));
  PAGS_TRY(make_views(&w));
  PAGS_TRY(pags_lock_folder(w.folder, &w.lock));
  PAGS_TRY(make_folders(&w));
  PAGS_TRY(write_texts(&w));
  for (int f = 0; f < o->frames; f++) {
    if (progress && !progress(user, (double)f / o->frames, "frames"))
      return pags_fail(PAGS_CANCELLED, "cancelled");
    PAGS_TRY(write_frame(&w, f));
  }
  return write_text(&w, "dataset.json", pags_street_write_description);
}
