/* SPDX-License-Identifier: Apache-2.0 */
/* pags info --overlay: draws LiDAR points and object boxes onto a driving set's photographs and measures how well
 * they agree, to check the set's conventions.
 *
 * A wrong axis, a box at the wrong time or a pose in the wrong frame is obvious in the pictures; the figures and
 * warnings let a program find the same errors. */
#include "cli/measure/info.h"

#include "cli/common/progress.h"
#include "cli/draw/picture.h"
#include "cli/measure/overlay_draw.h"

#include <math.h>
#include "base/vec3.h"
#include "dataset/owners.h"
#include "train/driving_losses.h"

enum { MOST_STEPS = 20, MOST_SAMPLES = 20000 };

/* Metres: a point counts as inside a box enlarged by inside_slack, and as near a box enlarged by about_slack. The
 * lowest `ground` of a box is left out, since LiDAR points there lie on the road. */
static const double inside_slack = 0.1, about_slack = 0.4, ground = 0.3;
/* m/s: above this speed, a vehicle's motion tells its forward direction. */
static const double least_speed = 2.0;

/* A fraction hits / of, kept as two counts. */
typedef struct share {
  int64_t of, hits;
} share;

static double share_value(share s) {
  return s.of ? (double)s.hits / (double)s.of : (double)NAN;
}

typedef struct overlay {
  const pags_dataset *dataset;
  const char *folder;
  pags_photo_cache *photos;
  int64_t pictures, points;
  share under_sky;   /* of the LiDAR points: those on sky pixels */
  share on_vehicles; /* of the points inside moving vehicles' boxes: those on pixels labelled critical */
  share in_boxes;    /* of the points inside or near moving vehicles' boxes: those inside */
  share union_;      /* of the pixels in a moving box's outline or in the moving-object mask: those in both */
  share boxes;       /* of the boxes at the view's time: those in front of the camera */
} overlay;

static const uint8_t colours[4][3] = {{200, 200, 200}, {0, 255, 255}, {255, 80, 255}, {255, 220, 0}};
static const uint8_t parked_colour[3] = {110, 150, 150};

/* ---- LiDAR points against boxes and masks ---- */

/* Returns where a world point lies relative to the boxes of all moving vehicles at `time`: 2 inside of one, 1 near, 0
 * neither. */
static int place_of(const overlay *o, double time, const double world[3]) {
  int best = 0;
  for (int64_t i = 0; i < pags_dataset_object_count(o->dataset) && best < 2; i++) {
    const pags_object *object = pags_dataset_object(o->dataset, i);
    double pose[12], inverse[12], beyond = -HUGE_VAL, p[3];
    if (!object->moving || object->category != PAGS_CATEGORY_VEHICLE || !pags_object_pose(object, time, pose))
      continue;
    pags_rigid_inverse(pose, inverse);
    pags_rigid_point(inverse, world, p);
    for (int k = 0; k < 3; k++)
      beyond = fmax(beyond, fabs(p[k]) - 0.5 * object->size[k]);
    if (p[2] >= ground - 0.5 * object->size[2] && beyond <= about_slack)
      best = beyond <= inside_slack ? 2 : 1;
  }
  return best;
}

static void measure_point(overlay *o, const pags_view *view, const pags_photo *photo,
                          const pags_lidar_depth_sample *sample) {
  double p[3], world[3];
  if (!pags_camera_point(&view->camera, (double)sample->x, (double)sample->y, (double)sample->depth, p))
    return;
  pags_rigid_point(view->camera.world_from_camera, p, world);
  const int place = place_of(o, view->camera.time, world);
  o->in_boxes.of += place > 0;
  o->in_boxes.hits += place == 2;
  o->points++;
  if (!photo->labels)
    return;
  const unsigned labels = photo->labels[(size_t)sample->y * (size_t)photo->stride + (size_t)sample->x];
  o->under_sky.of++;
  o->under_sky.hits += (labels & PAGS_LABEL_SKY) != 0;
  o->on_vehicles.of += place == 2;
  o->on_vehicles.hits += place == 2 && labels & PAGS_LABEL_CRITICAL;
}

/* ---- Drawing the pictures ---- */

static pags_result draw_view(overlay *o, int64_t index) {
  const pags_view *view = pags_dataset_view(o->dataset, index);
  pags_photo photo;
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  PAGS_TRY(pags_photo_cache_get(o->photos, index, 1, &photo));
  PAGS_TRY(pags_photo_image(&photo, &image));
  PAGS_AUTOFREE uint8_t *outlines = calloc((size_t)photo.width, (size_t)photo.height); /* 1 inside a moving box */
  PAGS_CHECK_MEMORY(outlines, NULL);

  /* Draw the LiDAR points and compare them with boxes and labels. */
  PAGS_AUTOFREE pags_lidar_depth_sample *samples = NULL;
  int64_t sample_count;
  PAGS_TRY(pags_lidar_depth_samples(o->dataset, index, MOST_SAMPLES, &sample_count, &samples));
  for (int64_t i = 0; i < sample_count; i++) {
    uint8_t rgb[3];
    pags_depth_colour((double)samples[i].depth, rgb);
    pags_draw_dot(&image, (double)samples[i].x, (double)samples[i].y, image.width >= 800, rgb);
    measure_point(o, view, &photo, &samples[i]);
  }

  /* Draw the boxes of all objects at the view's time; fill the outlines of the moving ones. */
  for (int64_t i = 0; i < pags_dataset_object_count(o->dataset); i++) {
    const pags_object *object = pags_dataset_object(o->dataset, i);
    double pose[12], corners[32];
    if (!pags_object_pose(object, view->camera.time, pose))
      continue;
    const int count = pags_box_outline(&view->camera, pose, object->size, corners);
    o->boxes.of++;
    if (!count)
      continue;
    o->boxes.hits++;
    pags_draw_box(&image, &view->camera, pose, object->size,
                  object->moving ? colours[object->category] : parked_colour);
    if (object->moving)
      pags_outline_fill(corners, count, image.width, image.height, image.width, 1, outlines);
  }

  /* Compare the outlines with the mask of moving objects, pixel by pixel. */
  if (photo.labels && pags_dataset_provides(o->dataset) & PAGS_PROVIDES_DYNAMIC_MASKS)
    for (int y = 0; y < photo.height; y++)
      for (int x = 0; x < photo.width; x++) {
        const bool box = outlines[(size_t)y * (size_t)photo.width + (size_t)x] != 0;
        const bool mask = (photo.labels[(size_t)y * (size_t)photo.stride + (size_t)x] & PAGS_LABEL_MOVING) != 0;
        o->union_.of += box || mask;
        o->union_.hits += box && mask;
      }
  o->pictures++;

  /* Save the picture as NAME.jpg, NAME being the photograph's stem. */
  char stem[PAGS_STEM], file[PAGS_STEM + 16];
  pags_stem(view->name, stem, sizeof stem);
  snprintf(file, sizeof file, "%s.jpg", stem);
  return pags_image_save_in(o->folder, file, &image);
}

static pags_result draw_all(overlay *o, const pags_session *session) {
  const int64_t count = pags_dataset_view_count(o->dataset);
  int64_t steps = 0, step = -1;
  for (int64_t i = 0; i < count; i++)
    steps += pags_view_begins_step(o->dataset, i);
  PAGS_AUTO(pags_progress_end) pags_progress progress = pags_progress_begin(session->people);
  pags_interrupt_install(session->tasks);
  for (int64_t i = 0; i < count; i++) {
    step += pags_view_begins_step(o->dataset, i);
    if (pags_interrupted())
      return pags_fail(PAGS_CANCELLED, "interrupted after %lld pictures", (long long)o->pictures);
    /* The time step is one of at most MOST_STEPS evenly chosen ones. */
    if (steps <= MOST_STEPS || step * MOST_STEPS / steps != (step + 1) * MOST_STEPS / steps)
      PAGS_TRY(draw_view(o, i));
    if (pags_progress_due(&progress))
      pags_progress_show(&progress, "view %lld of %lld", (long long)i + 1, (long long)count);
  }
  return PAGS_OK;
}

/* ---- Figures and warnings ---- */

/* Returns the mean cosine of the angle between the forward axis of vehicles and their direction of motion; NaN if no
 * vehicle is fast enough. */
static double front_cosine(const pags_dataset *dataset) {
  double sum = 0;
  int64_t count = 0;
  for (int64_t i = 0; i < pags_dataset_object_count(dataset); i++) {
    const pags_object *object = pags_dataset_object(dataset, i);
    if (object->category != PAGS_CATEGORY_VEHICLE)
      continue;
    for (int64_t n = 0; n + 1 < object->keyframe_count; n++) {
      const pags_keyframe *a = &object->keyframes[n], *b = &object->keyframes[n + 1];
      double way[3], from[3];
      pags_pose_position(a->world_from_object, from);
      pags_pose_position(b->world_from_object, way);
      pags_subtract3(way, from, way);
      const double front[3] = {a->world_from_object[0], a->world_from_object[4], a->world_from_object[8]};
      if (b->time > a->time && pags_length3(way) > least_speed * (b->time - a->time)) {
        sum += pags_dot3(way, front) / pags_length3(way);
        count++;
      }
    }
  }
  return count ? sum / (double)count : (double)NAN;
}

pags_result pags_overlay(const pags_dataset *dataset, const char *folder, pags_session *session, pags_report *report) {
  overlay o = {.dataset = dataset, .folder = folder};
  if (!(pags_dataset_fps(dataset) > 0))
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: --overlay is for driving sets, which have boxes or LiDAR",
                     pags_dataset_path(dataset));
  PAGS_TRY(pags_prepare_folder(session, folder));
  PAGS_AUTO(pags_photo_cache_destroy_auto) pags_photo_cache *photos = NULL;
  PAGS_TRY(pags_photo_cache_create(dataset, session->tasks, (uint64_t)128 << 20, &photos));
  o.photos = photos;
  PAGS_TRY(draw_all(&o, session));
  const double cosine = front_cosine(dataset);
  pags_report_begin_group(report, "overlay");

  /* Report the figures. */
  pags_report_text(report, "folder", o.folder);
  pags_report_count(report, "pictures", o.pictures);
  pags_report_count(report, "lidar_points", o.points);
  pags_report_number(report, "lidar_under_sky", share_value(o.under_sky));
  pags_report_number(report, "lidar_in_boxes", share_value(o.in_boxes));
  pags_report_number(report, "lidar_in_boxes_on_mask", share_value(o.on_vehicles));
  pags_report_number(report, "outline_mask_overlap", share_value(o.union_));
  pags_report_number(report, "boxes_in_pictures", share_value(o.boxes));
  pags_report_number(report, "front_cosine", cosine);

  /* Report a warning for each figure that is out of its expected range. */
  bool lidar = (pags_dataset_provides(o.dataset) & PAGS_PROVIDES_LIDAR) != 0;
  const struct {
    bool holds;
    const char *text;
  } warnings[] = {{cosine < 0.5,
                   "vehicles don't go where their fronts point: object_forward of dataset.json (--kind) may be wrong"},
                  {share_value(o.under_sky) > 0.05,
                   "more than 5 % of the LiDAR points lie on sky: extrinsics, camera_axes or "
                   "lidar_frame of dataset.json (--kind) may be wrong"},
                  {share_value(o.in_boxes) < 0.5,
                   "most LiDAR points around the boxes of moving vehicles lie outside of them: boxes, "
                   "LiDAR or their times may be wrong"},
                  {share_value(o.on_vehicles) < 0.5,
                   "most LiDAR points in the boxes of moving vehicles don't lie on vehicles in the "
                   "photographs: extrinsics or times may be wrong"},
                  {share_value(o.union_) < 0.5,
                   "the boxes' outlines and dynamic_masks overlap by less than half: boxes, "
                   "extrinsics or object_forward may be wrong"},
                  {lidar && !o.points,
                   "no LiDAR point lies in a photograph: lidar_columns, lidar_frame or extrinsics may be wrong"},
                  {o.boxes.of && !o.boxes.hits, "no box lies in a photograph: boxes or extrinsics may be wrong"}};
  pags_report_begin_list(report, "warnings");
  for (size_t i = 0; i < sizeof warnings / sizeof warnings[0]; i++)
    if (warnings[i].holds)
      pags_report_sentence(report, warnings[i].text);
  pags_report_end_list(report);

  pags_report_end_group(report);
  return PAGS_OK;
}
