/* SPDX-License-Identifier: Apache-2.0 */
/* Writes a synthetic street as a driving data set. Frame by frame, all pictures are traced in parallel, then all
 * files of the frame are written in parallel. */
#include <pags/image.h>
#include <pags/synth.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/lock.h"
#include "base/memory.h"
#include "synth/faults.h"
#include "synth/range.h"
#include "synth/street_labels.h"
#include "synth/sweep.h"
#include "synth/view.h"

enum { CAMERAS = 3, SHIFTS = 4, VIEWS = CAMERAS + SHIFTS, SHIFT_EVERY = 4, CAMERA_FILES = 7, MESSAGE = 512 };

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
  float *points;
  int64_t point_count;
} writer;

static pags_result join(const writer *w, const char *relative, char **out) {
  *out = pags_path_join(w->folder, relative);
  return *out ? PAGS_OK : pags_out_of_memory("%s", w->folder);
}

static pags_result make_folders(const writer *w) {
  static const char *const names[] = {"images",
                                      "ego_pose",
                                      "extrinsics",
                                      "intrinsics",
                                      "lidar",
                                      "instances",
                                      "semantic",
                                      "sky_masks",
                                      "dynamic_masks/all",
                                      "dynamic_masks/vehicle",
                                      "dynamic_masks/human",
                                      "truth/instances",
                                      "truth/depth",
                                      "truth/ids",
                                      "truth/cameras",
                                      "truth/shift/right1",
                                      "truth/shift/right2",
                                      "truth/shift/right3",
                                      "truth/shift/up1"};
  enum { COUNT = sizeof names / sizeof names[0] };
  bool empty = true;
  char *old = NULL;
  PAGS_TRY(pags_dir_is_empty(w->folder, &empty));
  if (!empty && !w->street->options->overwrite)
    return pags_fail(PAGS_ERROR_IO, "%s: expected an empty or a new folder", w->folder);
  for (int i = 0; i < COUNT - (w->street->options->shifts ? 0 : SHIFTS); i++) {
    char *path = NULL;
    PAGS_TRY(join(w, names[i], &path));
    const pags_result result = pags_make_dirs(path);
    free(path);
    PAGS_TRY(result);
  }
  /* An old dataset.json is removed before anything is written, and the new one is written last: a folder left by an
   * unfinished run does not open as a data set. */
  PAGS_TRY(join(w, "dataset.json", &old));
  const pags_result result = pags_remove_tree(old);
  free(old);
  return result;
}

static pags_result make_views(writer *w) {
  const pags_street_options *o = w->street->options;
  const size_t pixels = (size_t)o->width * (size_t)o->height;
  w->points = malloc(((size_t)o->lidar_points + 1) * 4 * sizeof *w->points);
  bool complete = w->points != NULL;
  for (int i = 0; i < VIEWS; i++) {
    pags_street_view *view = &w->views[i];
    view->rgb = malloc(3 * pixels);
    complete &= view->rgb != NULL;
    view->depth = malloc(pixels * sizeof *view->depth);
    view->labels = malloc(pixels);
    view->actors = malloc(pixels * sizeof *view->actors);
    complete &= view->depth && view->labels && view->actors;
  }
  return complete ? PAGS_OK : pags_out_of_memory("pictures of %dx%d", o->width, o->height);
}

/* ---- Image files ---- */

/* Returns the value at pixel index `at` of a one-channel image that is derived from a view's labels and actors. */
typedef uint16_t pixel_fn(const writer *w, const pags_street_view *view, size_t at);

static const pags_actor *actor_at(const writer *w, const pags_street_view *view, size_t at) {
  return view->actors[at] < 0 ? NULL : &w->street->actors[view->actors[at]];
}

static uint16_t semantic_of(const writer *w, const pags_street_view *view, size_t at) {
  (void)w;
  return view->labels[at];
}

static uint16_t sky_of(const writer *w, const pags_street_view *view, size_t at) {
  (void)w;
  return view->labels[at] == PAGS_CLASS_SKY ? 255 : 0;
}

static uint16_t moving_of(const writer *w, const pags_street_view *view, size_t at) {
  const pags_actor *actor = actor_at(w, view, at);
  return actor && actor->moving ? 255 : 0;
}

static uint16_t vehicle_of(const writer *w, const pags_street_view *view, size_t at) {
  const pags_actor *actor = actor_at(w, view, at);
  return actor && actor->moving && actor->role == PAGS_ROLE_CAR ? 255 : 0;
}

static uint16_t human_of(const writer *w, const pags_street_view *view, size_t at) {
  const pags_actor *actor = actor_at(w, view, at);
  return actor && actor->moving && actor->role != PAGS_ROLE_CAR ? 255 : 0;
}

static uint16_t id_of(const writer *w, const pags_street_view *view, size_t at) {
  const pags_actor *actor = actor_at(w, view, at);
  return actor ? (uint16_t)(actor->number + 1) : 0;
}

static const struct plane {
  const char *folder;
  pags_sample sample;
  pixel_fn *pixel;
} planes[] = {{"semantic", PAGS_U8, semantic_of},         {"sky_masks", PAGS_U8, sky_of},
              {"dynamic_masks/all", PAGS_U8, moving_of},  {"dynamic_masks/vehicle", PAGS_U8, vehicle_of},
              {"dynamic_masks/human", PAGS_U8, human_of}, {"truth/ids", PAGS_U16, id_of}};
enum { PLANES = sizeof planes / sizeof planes[0] };

static pags_result save_plane(const writer *w, const pags_street_view *view, const struct plane *plane,
                              const char *path) {
  const int width = view->camera.width, height = view->camera.height;
  pags_image image = {0};
  PAGS_TRY(pags_image_create(&image, width, height, 1, plane->sample));
  for (size_t i = 0; i < (size_t)width * (size_t)height; i++) {
    const uint16_t value = plane->pixel(w, view, i);
    if (plane->sample == PAGS_U16)
      ((uint16_t *)image.data)[i] = value;
    else
      ((uint8_t *)image.data)[i] = (uint8_t)value;
  }
  const pags_result result = pags_image_save(path, &image);
  pags_image_destroy(&image);
  return result;
}

static pags_result save_picture(const pags_street_view *view, const char *path) {
  const pags_image image = {
      .width = view->camera.width, .height = view->camera.height, .channels = 3, .sample = PAGS_U8, .data = view->rgb};
  return pags_image_save(path, &image);
}

static pags_result save_depth(const pags_street_view *view, const char *path) {
  static const char *const name = "Z";
  const float *plane = view->depth;
  return pags_image_save_exr(path, view->camera.width, view->camera.height, 1, &name, &plane, view->camera.width, NULL);
}

/* Writes file number `index` of the current frame. In order of numbers: for each camera its one-channel images, its
 * depth and its picture, then of each shifted camera its picture and its classes. */
static pags_result save_file(const writer *w, int index) {
  enum { EACH = PLANES + 2 };
  const int cameras = w->street->options->cameras, camera = index / EACH, kind = index % EACH;
  const int beside = index - EACH * cameras; /* >= 0: a file of shifted camera beside / 2 */
  char relative[64], *path = NULL;
  if (beside >= 0)
    snprintf(relative, sizeof relative, "truth/shift/%s/%05d%s.png", shifts[beside / 2].name,
             w->frame / SHIFT_EVERY - 1, beside % 2 ? "_semantic" : "");
  else if (kind < PLANES)
    snprintf(relative, sizeof relative, "%s/%03d_%d.png", planes[kind].folder, w->frame, camera);
  else
    snprintf(relative, sizeof relative, kind == PLANES ? "truth/depth/%03d_%d.exr" : "images/%03d_%d.png", w->frame,
             camera);
  const pags_street_view *view = &w->views[beside >= 0 ? cameras + beside / 2 : camera];
  PAGS_TRY(join(w, relative, &path));
  pags_result result;
  if (beside >= 0)
    result = beside % 2 ? save_plane(w, view, &planes[0], path) : save_picture(view, path);
  else
    result = kind == EACH - 1 ? save_picture(view, path)
             : kind < PLANES  ? save_plane(w, view, &planes[kind], path)
                              : save_depth(view, path);
  free(path);
  return result;
}

typedef struct save_job {
  const writer *writer;
  pags_result results[VIEWS * (PLANES + 2)];
  char messages[VIEWS * (PLANES + 2)][MESSAGE]; /* copied, since error messages belong to a thread */
} save_job;

static void save_files(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  save_job *job = context;
  for (int64_t i = begin; i < end; i++) {
    job->results[i] = save_file(job->writer, (int)i);
    if (job->results[i] != PAGS_OK)
      snprintf(job->messages[i], MESSAGE, "%s", pags_error_message());
  }
}

/* ---- One frame ---- */

static pags_result save_sweep(const writer *w) {
  char relative[32], *path = NULL;
  snprintf(relative, sizeof relative, "lidar/%03d.bin", w->frame);
  PAGS_TRY(join(w, relative, &path));
  const pags_result result = pags_file_write(path, w->points, (size_t)w->point_count * 4 * sizeof *w->points);
  free(path);
  return result;
}

static pags_result save_ego(const writer *w) {
  double ego[12];
  char relative[32], *path = NULL;
  pags_faults_ego(w->street->options, w->frame, ego);
  snprintf(relative, sizeof relative, "ego_pose/%03d.txt", w->frame);
  PAGS_TRY(join(w, relative, &path));
  const pags_result result = pags_street_write_pose(path, ego);
  free(path);
  return result;
}

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
  save_job *job = calloc(1, sizeof *job);
  if (!job)
    return pags_out_of_memory("%s", shown.folder);
  job->writer = (&shown);
  pags_result result =
      pags_parallel_for(shown.tasks, files, 1, save_files, job) ? PAGS_OK : pags_fail(PAGS_CANCELLED, "cancelled");
  for (int i = 0; i < files && result == PAGS_OK; i++)
    if (job->results[i] != PAGS_OK)
      result = pags_fail(job->results[i], "%s", job->messages[i]);
  free(job);
  PAGS_TRY(result);

  w->point_count = pags_sweep_trace(street, w->stage, frame, w->tasks, w->points);
  PAGS_TRY(save_sweep(w));
  return save_ego(w);
}

/* ---- Text files and the whole data set ---- */

typedef pags_result text_fn(const pags_street *street, const char *path);

static pags_result write_text(const writer *w, const char *relative, text_fn *write) {
  char *path = NULL;
  PAGS_TRY(join(w, relative, &path));
  const pags_result result = write(w->street, path);
  free(path);
  return result;
}

static pags_result labelled_instances(const pags_street *street, const char *path) {
  return pags_street_write_instances(street, path, 0);
}

static pags_result true_instances(const pags_street *street, const char *path) {
  return pags_street_write_instances(street, path, 1);
}

/* The cameras of a path file: those of one camera of the car, as they really are, or those of a shifted one. */
typedef struct path_cameras {
  int camera;
  const struct shift *shift; /* NULL: of the car */
} path_cameras;

static pags_result write_path(const writer *w, const char *relative, const path_cameras *which) {
  const pags_street_options *o = w->street->options;
  const struct shift *s = which->shift;
  pags_camera_path cameras = {.fps = s ? o->fps / SHIFT_EVERY : o->fps};
  char *path = NULL;
  cameras.cameras = malloc((size_t)o->frames * sizeof *cameras.cameras);
  if (!cameras.cameras)
    return pags_out_of_memory("%s", w->folder);
  for (int f = 0; f < o->frames; f++)
    if (!s || is_shift_frame(o, f))
      cameras.cameras[cameras.count++] =
          s ? pags_street_camera(o, f / o->fps, 0, s->right, s->up) : pags_faults_camera(o, f, which->camera, -1);
  pags_result result = join(w, relative, &path);
  if (result == PAGS_OK)
    result = pags_camera_path_save(path, &cameras);
  free(path);
  pags_camera_path_destroy(&cameras);
  return result;
}

static pags_result write_texts(const writer *w) {
  /* Poses of the cameras in the ego frame, and their intrinsics. */
  for (int c = 0; c < w->street->options->cameras; c++) {
    const pags_street_options *o = w->street->options;
    const pags_camera camera = pags_faults_camera(o, 0, c, -1);
    double mount[12];
    char relative[32], *path = NULL;
    pags_faults_mount(o, c, mount);
    snprintf(relative, sizeof relative, "extrinsics/%d.txt", c);
    PAGS_TRY(join(w, relative, &path));
    pags_result result = pags_street_write_pose(path, mount);
    free(path);
    PAGS_TRY(result);
    snprintf(relative, sizeof relative, "intrinsics/%d.txt", c);
    PAGS_TRY(join(w, relative, &path));
    result = pags_street_write_intrinsics(path, &camera, o->faults.distortion);
    free(path);
    PAGS_TRY(result);
    snprintf(relative, sizeof relative, "truth/cameras/%d.json", c);
    PAGS_TRY(write_path(w, relative, &(path_cameras){.camera = c}));
  }

  PAGS_TRY(write_text(w, "instances/instances_info.json", labelled_instances));
  PAGS_TRY(write_text(w, "instances/frame_instances.json", pags_street_write_frame_instances));
  PAGS_TRY(write_text(w, "truth/instances/instances_info.json", true_instances));
  PAGS_TRY(write_text(w, "truth/street.json", pags_street_write_truth));
  PAGS_TRY(write_text(w, "timestamps.json", pags_street_write_timestamps));
  /* Camera paths of the shifted pictures; with too few frames there is no such picture, and no path. */
  for (int i = 0; w->street->options->shifts && w->street->options->frames > SHIFT_EVERY && i < SHIFTS; i++) {
    char relative[48];
    snprintf(relative, sizeof relative, "truth/shift/%s/path.json", shifts[i].name);
    PAGS_TRY(write_path(w, relative, &(path_cameras){.shift = &shifts[i]}));
  }
  return PAGS_OK;
}

static pags_result write_all(writer *w, const pags_street_options *o, pags_progress_fn *progress, void *user) {
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

  PAGS_TRY(pags_street_build(o, w->street));
  pags_street_number(w->street);
  PAGS_TRY(pags_stage_create(w->street->meshes, w->street->mesh_count, w->street->placements,
                             w->street->placement_count, &w->stage));
  PAGS_TRY(make_views(w));
  PAGS_TRY(pags_lock_folder(w->folder, &w->lock));
  PAGS_TRY(make_folders(w));
  PAGS_TRY(write_texts(w));
  for (int f = 0; f < o->frames; f++) {
    if (progress && !progress(user, (double)f / o->frames, "frames"))
      return pags_fail(PAGS_CANCELLED, "cancelled");
    PAGS_TRY(write_frame(w, f));
  }
  return write_text(w, "dataset.json", pags_street_write_description);
}

pags_result pags_synth_street(const char *folder, const pags_street_options *options, pags_tasks *tasks,
                              pags_progress_fn *progress, void *user) {
  pags_street street = {.options = options};
  writer w = {.folder = folder, .street = &street, .tasks = tasks};
  const pags_result result = write_all(&w, options, progress, user);
  pags_lock_release(w.lock);
  pags_stage_destroy(w.stage);
  pags_street_destroy(&street);

  /* The views' images. */
  for (int i = 0; i < VIEWS; i++) {
    free(w.views[i].rgb);
    free(w.views[i].depth);
    free(w.views[i].labels);
    free(w.views[i].actors);
  }
  free(w.points);

  return result;
}
