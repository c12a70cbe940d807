/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval: renders a scene's views and compares them with photographs (PSNR, SSIM, LPIPS, per region), LiDAR depth,
 * and the ground truth of synthetic data sets. */
#include "cli/common/photographs.h"
#include "cli/common/ranks.h"
#include "cli/common/scene_options.h"
#include "cli/draw/picture.h"
#include "cli/measure/errors.h"
#include "cli/measure/view_scores.h"
#include "cli/verbs/verbs.h"

#include <pags/eval.h>
#include "base/log.h"
#include "base/psnr.h"
#include "base/text.h"
#include "base/vec3.h"
#include "dataset/photo_mask.h"
#include "train/camera_poses.h"

typedef struct eval_arguments {
  pags_session session;
  const char *early_z;
  int order; /* pags_order */
  const char *dataset, *lpips_weights, *images;
  int split; /* index in "all|train|test" */
  int shift, fit_poses;
  int64_t views; /* how many views to compare; 0: all */
  pags_picture_changes changes;
  pags_dataset_options options;
  uint64_t image_cache;
} eval_arguments;

#define AT(member) offsetof(eval_arguments, member)

static const pags_option options[] = {
    PAGS_TEXT("dataset", 0, AT(dataset), "DATASET", "the scene's training data", "Data set with the photographs."),
    PAGS_TEXT("lpips-weights", 0, AT(lpips_weights), "FILE|none", "AlexNet's, if installed",
              "Weights of LPIPS v0.1 on SqueezeNet 1.1 or AlexNet (.npz); none: no LPIPS."),
    PAGS_TEXT("images", 0, AT(images), "FOLDER", NULL,
              "Write NAME_render.png and NAME_photo.png of every view compared."),
    PAGS_FLAG("shift", 0, AT(shift),
              "Synthetic data: also compare with the ground-truth pictures from shifted cameras."),
    PAGS_FLAG("fit-poses", 0, AT(fit_poses),
              "Captures: also score the right half of each photograph, with the given pose and with the pose fitted to "
              "the left half."),
    PAGS_CHOICE("split", AT(split), "all|train|test", NULL, "Views to compare."),
    PAGS_VALUE("views", 0, INT64, AT(views), 0, 1e9, "N", "0: all", NULL, "Compare only N of them, evenly spaced."),
    PAGS_TEXT("early-z", 0, AT(early_z), "off|lossless|bounded[=EPS]|paper", NULL,
              "Skip hidden Gaussians, as for render."),
    PAGS_CHOICE("order", AT(order), "depth|paper", NULL, "As for render."),
    PAGS_VALUE("image-cache", 0, SIZE, AT(image_cache), 1, PAGS_UNLIMITED, "SIZE", "bytes; K, M, G", NULL,
               "Memory for decoded photographs."),

    PAGS_VALUE("background", 0, COLOR, AT(changes.background), 0, 0, "R,G,B", "sRGB, 0..1", "as in the scene",
               "Background colour of the renderings and of photographs with alpha."),
    PAGS_FLAG("antialiased", 0, AT(changes.antialiased), "As for render."),
    PAGS_FLAG("no-antialiased", 0, AT(changes.antialiased), "Don't compensate, even if the scene was trained so."),
    PAGS_VALUE("low-pass", 0, DOUBLE, AT(changes.low_pass), 0, 100, "V", "px^2", "as in training, else 0.3",
               "As for render."),
    PAGS_VALUE("near", 0, DOUBLE, AT(changes.near_plane), 1e-6, PAGS_UNLIMITED, "Z", "metres",
               "as in training, else 0.01", "As for render."),
    PAGS_PHOTOGRAPH_OPTIONS(AT(options), "as in training"),

    PAGS_GROUP("Splat files, which store no views"),
    PAGS_VALUE("downscale", 0, DOUBLE, AT(options.downscale), 1, 64, "F", "times", NULL,
               "Downscale the photographs by this factor."),
    PAGS_VALUE("split-every", 0, INT, AT(options.split_every), 0, 1e9, "N", "views; 0: none",
               "as the data set says, else 8; driving sets 4", "Count every Nth view as held out."),
    PAGS_FLAG("allow-missing", 0, AT(options.allow_missing), "Skip views whose photograph or pose is missing."),
    PAGS_TEXT("colmap", 0, AT(options.colmap), "FOLDER", NULL,
              "Read cameras from this COLMAP model (a scene stores the one it was trained with)."),

    PAGS_GROUP("Driving sets, as for train"),
    PAGS_DRIVING_OPTIONS(AT(options)),
    PAGS_SESSION_OPTIONS(eval_arguments),
    {0}};

typedef struct evaluation {
  eval_arguments *arguments;
  const pags_parsed *parsed;
  pags_composition *composition;
  const pags_scene *scene;
  pags_photographs photographs;
  pags_lpips *lpips;
  pags_frame *frame;
  pags_frame_options options;
  pags_view_score *scores;
  pags_picture_names names; /* of --images, of all views of the data set */
  int64_t *score_views;     /* of each score the index of its view among the photographs' */
  int64_t count;            /* scores; of this rank until the ranks' are gathered */
  int64_t *without_pixels;  /* indices of views whose mask leaves no pixel: they have no figures */
  int64_t without_count;
  int32_t *object_of; /* object of each Gaussian; NULL: the scene has no objects */
  pags_object_errors objects;
  int64_t shown;                     /* views in which a Gaussian is in view */
  pags_depth_errors depth_errors[2]; /* [0] training views, [1] held-out views */
  pags_depth_figures depth[2];
  pags_pose_errors poses;
  pags_camera_errors cameras;
  pags_shifted_view_scores shifts;
  pags_priority_truth priority_truth;
} evaluation;

static void evaluation_destroy(evaluation *eval) {
  pags_frame_destroy(eval->frame);
  pags_picture_names_destroy(&eval->names);
  pags_photographs_close(&eval->photographs);
  pags_lpips_destroy(eval->lpips);
  pags_composition_destroy(eval->composition);
  free(eval->shifts.items);
  free(eval->objects.items);
  free(eval->object_of);
  for (int test = 0; test < 2; test++)
    free(eval->depth_errors[test].errors);
  free(eval->scores);
  free(eval->score_views);
  free(eval->without_pixels);
}

/* ---- Comparing one view ---- */

static pags_result save_image(const char *folder, const char *name, const char *what, const pags_image *image) {
  PAGS_AUTOFREE char *file = pags_text_format("%s_%s.png", name, what);
  PAGS_CHECK_MEMORY(file, "%s", name);
  return pags_image_save_in(folder, file, image);
}

/* `view`: its index in the data set. */
static pags_result measure(const evaluation *eval, int64_t view, pags_image *render, const pags_photograph *photo,
                           pags_view_score *score) {
  const char *images = eval->arguments->images;
  PAGS_TRY(pags_view_score_measure(render, photo, eval->arguments->session.tasks, score));
  if (images) {
    PAGS_TRY(save_image(images, eval->names.items[view], "render", render));
    PAGS_TRY(save_image(images, eval->names.items[view], "photo", &photo->image));
  }
  return eval->lpips ? pags_view_score_lpips(eval->lpips, render, photo, eval->arguments->session.tasks, score)
                     : PAGS_OK;
}

/* Renders the scene's colours without the camera's exposure and measures their PSNR against the photograph. */
static pags_result compare_unexposed(const evaluation *eval, const pags_camera *camera, const pags_part *parts,
                                     int part_count, const pags_photograph *photo, pags_view_score *score) {
  pags_picture picture;
  PAGS_AUTO(pags_image_destroy) pags_image render = {0};
  PAGS_TRY(pags_frame_render(eval->frame, parts, part_count, camera, &eval->options, NULL, NULL, &picture));
  PAGS_TRY(pags_picture_to_image(&picture, PAGS_F32, &render));
  const pags_result result = pags_eval_psnr(&render, &photo->image, photo->mask, &score->psnr_unexposed);
  score->psnr_unexposed = pags_psnr_capped(score->psnr_unexposed);
  return result;
}

/* Whether a photograph is fully masked. */
static bool is_blank(const pags_photograph *photo) {
  const size_t count = (size_t)photo->image.width * (size_t)photo->image.height;
  size_t i = 0;
  while (photo->mask && i < count && !photo->mask[i])
    i++;
  return photo->mask && i == count;
}

static pags_result compare_view(evaluation *eval, int64_t i) {
  const pags_photographs_view *at = &eval->photographs.views[i];
  const pags_dataset *dataset = eval->photographs.dataset;
  const pags_camera camera = pags_photographs_camera(&eval->photographs, i);
  pags_view_score *score = &eval->scores[eval->count];
  PAGS_AUTO(pags_photograph_destroy) pags_photograph photo = {0};
  PAGS_AUTO(pags_image_destroy) pags_image render = {0};
  pags_picture picture;
  const pags_part *parts;
  int part_count;
  pags_frame_options exposed = eval->options;
  *score = pags_view_score_make(pags_dataset_view(dataset, at->index)->name, at->test);
  pags_compose(eval->composition, camera.time, &parts, &part_count);
  PAGS_TRY(pags_photographs_read(&eval->photographs, i, &photo));
  if (is_blank(&photo)) {
    eval->without_pixels[eval->without_count++] = i;
    return PAGS_OK;
  }
  if (at->scene_view)
    exposed.photometric = at->scene_view->photometric;
  if (at->scene_view && pags_frame_options_expose(&exposed, at->scene_view->gain, at->scene_view->offset))
    PAGS_TRY(compare_unexposed(eval, &camera, parts, part_count, &photo, score));
  if (eval->arguments->fit_poses) {
    pags_fitted_pose pose;
    PAGS_TRY(pags_fit_pose(eval->frame, parts, part_count, &camera, &exposed, NULL, NULL, &photo.photo, &pose));
    score->psnr_right = pose.given;
    score->psnr_right_fitted = pose.fitted;
  }
  PAGS_TRY(pags_frame_render(eval->frame, parts, part_count, &camera, &exposed, NULL, NULL, &picture));
  eval->shown += pags_frame_stats_get(eval->frame)->binned > 0;
  PAGS_TRY(pags_picture_to_image(&picture, PAGS_F32, &render));
  PAGS_TRY(measure(eval, at->index, &render, &photo, score));
  if (eval->object_of)
    PAGS_TRY(pags_object_errors_add(&eval->objects, eval->object_of, eval->scene->object_count, at->index, &picture,
                                    &render, &photo));
  if (picture.depth && (pags_dataset_provides(dataset) & PAGS_PROVIDES_LIDAR))
    PAGS_TRY(pags_depth_errors_add(&eval->depth_errors[at->test != 0], dataset, at->index, &picture, photo.mask));
  eval->score_views[eval->count++] = i;
  return PAGS_OK;
}

static bool wanted(const eval_arguments *arguments, int test) {
  return arguments->split == 0 || (arguments->split == 2) == (test != 0);
}

/* Whether view `number` of `count` is among the --views evenly spread ones: those at which the integer number * views /
 * count increases. */
static bool chosen(const eval_arguments *arguments, int64_t number, int64_t count) {
  return arguments->views == 0 || arguments->views >= count || number == 0 ||
         number * arguments->views / count != (number - 1) * arguments->views / count;
}

/* ---- JSON and printed lines ---- */

static void put_split(pags_json_writer *writer, const evaluation *eval, const char *key, int test) {
  pags_mean_score mean = pags_view_scores_mean(eval->scores, eval->count, test);
  pags_json_begin_object(writer, key);
  pags_json_put_integer(writer, "views", mean.views);
  pags_view_scores_put_json(writer, &mean.mean);
  pags_depth_figures_put_json(writer, &eval->depth[test]);
  pags_json_begin_array(writer, "per_view");
  for (int64_t i = 0; i < eval->count; i++) {
    if (eval->scores[i].test != test)
      continue;
    pags_json_begin_object(writer, NULL);
    pags_json_put_string(writer, "name", eval->scores[i].name);
    pags_view_scores_put_json(writer, &eval->scores[i]);
    pags_json_end_object(writer);
  }
  pags_json_end_array(writer);
  if (eval->without_count) {
    pags_json_begin_array(writer, "without_pixels");
    for (int64_t i = 0; i < eval->without_count; i++) {
      const pags_photographs_view *view = &eval->photographs.views[eval->without_pixels[i]];
      if ((view->test != 0) == (test != 0))
        pags_json_put_string(writer, NULL, pags_dataset_view(eval->photographs.dataset, view->index)->name);
    }
    pags_json_end_array(writer);
  }
  pags_json_end_object(writer);
}

static void put_shifts(pags_json_writer *writer, const evaluation *eval) {
  if (!eval->arguments->shift) {
    pags_json_put_null(writer, "shift");
    return;
  }
  pags_json_begin_array(writer, "shift");
  for (int64_t i = 0; i < eval->shifts.count; i++) {
    const pags_shifted_view_score *score = &eval->shifts.items[i];
    pags_json_begin_object(writer, NULL);
    pags_json_put_string(writer, "name", score->name);
    pags_json_put_integer(writer, "views", score->views);
    pags_json_put_number(writer, "psnr", score->psnr);
    pags_json_put_number(writer, "ssim", score->ssim);
    pags_json_put_integer(writer, "road_views", score->road_views);
    pags_json_put_number(writer, "road_psnr", score->road_psnr);
    pags_json_end_object(writer);
  }
  pags_json_end_array(writer);
}

static void print_poses(const pags_session *session, const pags_pose_errors *e, const pags_camera_errors *cameras) {
  if (e->keyframes) {
    pags_say(session,
             "poses of %lld objects: off by %.3f m and %.2f degrees as labelled, %.3f m and %.2f degrees as trained\n",
             (long long)e->objects, e->absolute.label_metres, e->absolute.label_degrees, e->absolute.metres,
             e->absolute.degrees);
    pags_say(
        session,
        "  without each track's mean error: %.3f m and %.2f degrees as labelled, %.3f m and %.2f degrees as trained\n",
        e->relative.label_metres, e->relative.label_degrees, e->relative.metres, e->relative.degrees);
  }
  if (e->keyframes && e->held_out_keyframes)
    pags_say(session,
             "  at held-out time steps: %.3f m and %.2f degrees as labelled, %.3f m and %.2f degrees as drawn\n",
             e->held_out.label_metres, e->held_out.label_degrees, e->held_out.metres, e->held_out.degrees);
  for (int test = 0; test < 2; test++)
    if (cameras->views[test] > 0 && cameras->recorded[test].metres > 1e-6)
      pags_say(
          session,
          "cameras of %lld %s views: off by %.3f m and %.2f degrees as recorded, %.3f m and %.2f degrees as used\n",
          (long long)cameras->views[test], test ? "held-out" : "training", cameras->recorded[test].metres,
          cameras->recorded[test].degrees, cameras->corrected[test].metres, cameras->corrected[test].degrees);
}

static double percent(int64_t part, int64_t whole) {
  return whole ? 100 * (double)part / (double)whole : 0;
}

static void print_priority_truth(const pags_session *session, const pags_priority_truth *o) {
  if (!o->seen)
    return;
  pags_say(session,
           "priorities against ground truth: %.1f %% of %lld Gaussians on critical objects and %.1f %% of %lld others "
           "have a priority over 0.5\n",
           percent(o->critical_high, o->critical), (long long)o->critical, percent(o->other_high, o->other),
           (long long)o->other);
  pags_say(session,
           "  not counted: %.1f %% of %lld visible Gaussians (%.1f %% by weight): %.1f %% over 5 cm from any surface, "
           "%.1f %% within 15 cm of both a critical and another surface\n",
           percent(o->seen - o->counted, o->seen), (long long)o->seen, 100 * o->left_out_weight,
           percent(o->astray, o->seen), percent(o->between, o->seen));
}

static void print_more(const evaluation *eval) {
  const pags_session *session = &eval->arguments->session;
  for (int test = 0; test < 2; test++) {
    const pags_depth_figures *depth = &eval->depth[test];
    if (depth->samples)
      pags_say(session,
               "depth against LiDAR, %s views: off by %.3f m (median), %.3f m (mean), %.3f m (mean of the best 95 "
               "%%); %.1f %% within 5 %%\n",
               test ? "held-out" : "training", depth->median, depth->mean, depth->mean95, 100 * depth->within);
  }
  for (int64_t i = 0; i < eval->shifts.count; i++) {
    const pags_shifted_view_score *const score = &eval->shifts.items[i];
    pags_say(session, "shifted cameras %-16s %9.3f %8.4f", score->name, score->psnr, score->ssim);
    if (score->road_views > 0)
      pags_say(session, "   road %9.3f", score->road_psnr);
    pags_say(session, "\n");
  }
  print_poses(session, &eval->poses, &eval->cameras);
  print_priority_truth(session, &eval->priority_truth);
}

/* ---- Comparing all views ---- */

/* Refuses options that the views stored in the scene override: their size and, except for the sweeps of a drive, the
 * split. */
static pags_result check_effect(const evaluation *eval, const char *scene_path) {
  const bool free = eval->scene->view_count == 0;
  const pags_option_rule rules[] = {
      {"downscale allow-missing", free, NULL}, {"split-every", free || eval->scene->fps > 0, NULL}, {0}};
  char names[128];
  if (!pags_option_idle(eval->parsed, rules, names, sizeof names))
    return PAGS_OK;
  return pags_fail(
      PAGS_ERROR_ARGUMENT,
      "%s: %s: no effect, since the scene stores its views, their size and which are held out; expected a splat file",
      scene_path, names);
}

static pags_result open_all(evaluation *eval, const char *scene_path) {
  eval_arguments *arguments = eval->arguments;
  pags_tasks *tasks = arguments->session.tasks;
  PAGS_TRY(pags_composition_load(scene_path, &eval->composition));
  eval->scene = pags_composition_scene(eval->composition);
  PAGS_TRY(check_effect(eval, scene_path));
  const char *dataset = arguments->dataset ? arguments->dataset : eval->scene->dataset;
  if (!dataset)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: doesn't name its training data; expected --dataset DATASET", scene_path);
  PAGS_TRY(pags_view_lpips_load(arguments->lpips_weights, &eval->lpips));
  pags_dataset_options opened = pags_photographs_options(eval->scene, arguments->dataset, &arguments->options);
  if (pags_option_given(eval->parsed, "image-alpha"))
    opened.image_alpha = arguments->options.image_alpha;
  if (pags_option_given(eval->parsed, "background"))
    pags_copy3(arguments->changes.background, opened.background);
  PAGS_TRY(pags_photographs_open(eval->scene, arguments->dataset, &opened, tasks, arguments->image_cache,
                                 &eval->photographs));
  if (arguments->fit_poses && pags_dataset_fps(eval->photographs.dataset) > 0)
    return pags_fail(PAGS_ERROR_ARGUMENT,
                     "%s: --fit-poses is for captures; in a driving set, the pose corrections of held-out views are "
                     "interpolated from their neighbours",
                     dataset);
  PAGS_TRY(pags_session_check(&arguments->session));
  const size_t count = (size_t)eval->photographs.count;
  eval->scores = calloc(count, sizeof *eval->scores);
  eval->score_views = calloc(count, sizeof *eval->score_views);
  eval->without_pixels = calloc(count, sizeof *eval->without_pixels);
  PAGS_CHECK_MEMORY(eval->scores && eval->score_views && eval->without_pixels, "%zu views", count);
  eval->options = pags_composition_options(eval->composition);
  pags_picture_changes_apply(&arguments->changes, eval->parsed, &eval->options);
  PAGS_TRY(pags_early_z_parse(arguments->early_z, &eval->options));
  eval->options.order = (pags_order)arguments->order;
  if (eval->scene->object_count) {
    eval->object_of = malloc((size_t)pags_composition_gaussian_count(eval->composition) * sizeof *eval->object_of);
    PAGS_CHECK_MEMORY(eval->object_of, "the Gaussians' objects");
    pags_composition_objects(eval->composition, eval->object_of);
  }
  eval->options.extra_channels =
      eval->object_of || (pags_dataset_provides(eval->photographs.dataset) & PAGS_PROVIDES_LIDAR) != 0;
  PAGS_TRY(pags_frame_create(tasks, &eval->frame));
  if (!arguments->images)
    return PAGS_OK;
  PAGS_TRY(pags_picture_names_make(NULL, eval->photographs.dataset, &eval->names));
  return pags_prepare_folder(&arguments->session, arguments->images);
}

/* Compares this rank's share of the chosen views with their photographs. */
static pags_result compare_all(evaluation *eval) {
  pags_progress progress = pags_progress_begin(eval->arguments->session.people);
  pags_result result = PAGS_OK;
  int64_t number = 0, count = 0, compared = 0;
  for (int64_t i = 0; i < eval->photographs.count; i++)
    count += wanted(eval->arguments, eval->photographs.views[i].test);
  pags_interrupt_install(eval->arguments->session.tasks);
  for (int64_t i = 0; result == PAGS_OK && i < eval->photographs.count; i++) {
    if (pags_interrupted() || pags_ranks_stopping())
      result = PAGS_CANCELLED;
    else if (wanted(eval->arguments, eval->photographs.views[i].test) && chosen(eval->arguments, number++, count) &&
             pags_ranks_mine(compared++))
      result = compare_view(eval, i);
    const int64_t done = pags_ranks_tell(eval->count, result != PAGS_OK);
    if (pags_progress_due(&progress))
      pags_progress_show(&progress, "view %lld of %lld", pags_ranks() ? (long long)done : (long long)i + 1,
                         (long long)eval->photographs.count);
  }
  pags_progress_end(&progress);
  int64_t done = eval->count;
  PAGS_TRY(pags_ranks_sum(&done));
  if (result == PAGS_CANCELLED || (result != PAGS_OK && pags_interrupted()))
    return pags_fail(PAGS_CANCELLED, "interrupted after %lld of %lld views", (long long)done,
                     (long long)eval->photographs.count);
  return result;
}

/* ---- Gathering what the ranks have found ---- */

static int compare_indices(const void *a, const void *b) {
  const int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
  return (x > y) - (x < y);
}

/* A score sent to rank 0; its name is memory of the sending rank. */
typedef struct sent_score {
  int64_t view; /* compare_indices sorts by it */
  pags_view_score score;
} sent_score;

static pags_result gather_scores(evaluation *eval) {
  PAGS_AUTOFREE sent_score *own = calloc((size_t)eval->count + 1, sizeof *own), *all = NULL;
  int64_t count;
  PAGS_CHECK_MEMORY(own, "%lld views", (long long)eval->count);
  for (int64_t i = 0; i < eval->count; i++)
    own[i] = (sent_score){eval->score_views[i], eval->scores[i]};
  PAGS_TRY(pags_ranks_gather(own, eval->count, sizeof *own, &all, &count));
  if (!all)
    return PAGS_OK;
  qsort(all, (size_t)count, sizeof *all, compare_indices);
  for (int64_t i = 0; i < count; i++) {
    const int64_t index = eval->photographs.views[all[i].view].index;
    eval->scores[i] = all[i].score;
    eval->scores[i].name = pags_dataset_view(eval->photographs.dataset, index)->name;
  }
  eval->count = count;
  return PAGS_OK;
}

/* Depth errors are sorted before they are added up, so that their order doesn't matter. */
static pags_result gather_depths(pags_depth_errors *errors) {
  PAGS_AUTOFREE double *all = NULL;
  int64_t count;
  PAGS_TRY(pags_ranks_sum(&errors->within));
  PAGS_TRY(pags_ranks_sum(&errors->unblended));
  PAGS_TRY(pags_ranks_gather(errors->errors, errors->count, sizeof *errors->errors, &all, &count));
  if (all)
    errors->count = 0;
  return pags_depth_errors_append(errors, all, count);
}

/* Refuses a job of ranks some of which have found weights of LPIPS while others haven't. */
static pags_result check_ranks(const evaluation *eval) {
  int64_t with = eval->lpips != NULL, ranks = 1;
  PAGS_TRY(pags_ranks_sum(&with));
  PAGS_TRY(pags_ranks_sum(&ranks));
  if (with == 0 || with == ranks)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT,
                   "LPIPS weights are installed for %lld of %lld ranks: expected all or none; --lpips-weights names a "
                   "file or none",
                   (long long)with, (long long)ranks);
}

static pags_result gather_all(evaluation *eval) {
  PAGS_AUTOFREE int64_t *without = NULL;
  int64_t count;
  if (!pags_ranks())
    return PAGS_OK;
  PAGS_TRY(gather_scores(eval));
  PAGS_TRY(pags_ranks_gather(eval->without_pixels, eval->without_count, sizeof *without, &without, &count));
  if (without) {
    eval->without_count = count;
    memcpy(eval->without_pixels, without, (size_t)count * sizeof *without);
    qsort(eval->without_pixels, (size_t)count, sizeof *without, compare_indices);
  }
  for (int test = 0; test < 2; test++)
    PAGS_TRY(gather_depths(&eval->depth_errors[test]));
  PAGS_TRY(pags_object_errors_gather(&eval->objects));
  return pags_ranks_sum(&eval->shown);
}

/* ---- The verb ---- */

static pags_result write_json(const evaluation *eval) {
  pags_json_writer writer = pags_session_json_begin();
  pags_json_put_integer(&writer, "gaussians", pags_composition_gaussian_count(eval->composition));
  pags_json_put_string(&writer, "lpips_network", eval->lpips ? pags_lpips_network(eval->lpips) : NULL);
  put_split(&writer, eval, "train", 0);
  put_split(&writer, eval, "test", 1);
  pags_object_errors_put_json(&writer, &eval->objects, eval->scene, eval->photographs.dataset);
  put_shifts(&writer, eval);
  pags_pose_errors_put_json(&writer, &eval->poses);
  pags_camera_errors_put_json(&writer, &eval->cameras);
  pags_priority_truth_put_json(&writer, &eval->priority_truth);
  return pags_session_json(&eval->arguments->session, &writer);
}

static pags_result run(void *user, const pags_parsed *parsed) {
  eval_arguments *arguments = user;
  pags_session *session = &arguments->session;
  const char *scene_path = parsed->positionals[0];
  PAGS_AUTO(evaluation_destroy) evaluation eval = {.arguments = arguments, .parsed = parsed};
  PAGS_TRY(pags_session_meet(session, open_all(&eval, scene_path)));
  PAGS_TRY(check_ranks(&eval));
  PAGS_TRY(pags_session_meet(session, compare_all(&eval)));
  PAGS_TRY(gather_all(&eval));
  if (!pags_ranks_lead())
    return PAGS_OK;
  const pags_photographs *photographs = &eval.photographs;
  const char *dataset = pags_dataset_path(photographs->dataset);
  if (eval.without_count) {
    const int64_t first = photographs->views[eval.without_pixels[0]].index;
    char masks[160];
    pags_dataset_masks_of(photographs->dataset, first, masks, sizeof masks);
    PAGS_WARN(
        "%s: %lld of %lld views are fully masked and have no figures; the first is %s, whose pixels are left out by %s",
        dataset, (long long)eval.without_count, (long long)(eval.count + eval.without_count),
        pags_dataset_view(photographs->dataset, first)->name, masks);
  }
  if (eval.count && !eval.shown)
    PAGS_WARN("%s: nothing of the scene is in view in any of %lld views", scene_path, (long long)eval.count);
  if (!eval.count)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: no %s to compare", scene_path,
                     arguments->split == 0   ? "views"
                     : arguments->split == 1 ? "training views"
                                             : "held-out views");
  for (int test = 0; test < 2; test++)
    eval.depth[test] = pags_depth_errors_figures(&eval.depth_errors[test]);
  PAGS_TRY(pags_pose_errors_measure(dataset, eval.scene, &eval.poses));
  PAGS_TRY(pags_camera_errors_measure(dataset, eval.scene, &eval.cameras));
  PAGS_TRY(pags_priority_truth_measure(eval.composition, photographs, eval.frame, &eval.options, &eval.priority_truth));
  if (arguments->shift)
    PAGS_TRY(pags_shifted_views_measure(dataset, photographs->downscale, eval.composition, eval.frame, &eval.options,
                                        session, arguments->images, &eval.shifts));
  pags_view_scores_print(session, eval.scores, eval.count);
  if (eval.lpips)
    pags_say(session, "LPIPS: v0.1 on %s\n", pags_lpips_network(eval.lpips));
  print_more(&eval);
  return write_json(&eval);
}

static const pags_verb verb = {
    .name = "eval",
    .usage = "SCENE [--dataset DATASET] [options]",
    .about =
        "Render a scene's training and held-out views and compare each with its photograph, undistorted and downscaled "
        "as for training. Renderings are clamped to [0, 1] and compared as float, not rounded to 8 bits. Means are "
        "over views; masked pixels are excluded. LPIPS values on different networks (SqueezeNet, AlexNet, VGG) can't "
        "be compared. For driving scenes, figures are also given per region: critical (vehicles, pedestrians and "
        "cyclists); moving (dynamic_masks/all, else the boxes of moving objects); vehicles, pedestrians and cyclists "
        "(their boxes). Each region's mean is over the views that show it. Driving scenes also get depth errors "
        "against LiDAR and scores without the trained exposures; synthetic data sets also get the pose errors of the "
        "tracks, as labelled and as trained.",
    .positionals = {{"SCENE", "Scene folder or splat file."}},
    .options = options,
    .run = run};

int pags_verb_eval(int argc, char **argv) {
  eval_arguments arguments = {.session = {.answers = true},
                              .early_z = "lossless",
                              .options = pags_dataset_options_default(),
                              .image_cache = (uint64_t)256 << 20};
  return pags_verb_run(&verb, argc, argv, &arguments);
}
