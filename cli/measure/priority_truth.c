/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval: compares the priorities of Gaussians with the truth of a synthetic street: whether the nearest surface is
 * critical. */
#include "cli/measure/priority_truth.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#ifdef PAGS_WITH_SYNTH

#include <pags/synth.h>

#include "base/memory.h"
#include "cli/common/progress.h"

static const double near_metres = 0.05, far_metres = 0.15;
/* sum of alpha T over all training views from which on a Gaussian counts as seen, in pixels */
static const double least_weight = 1.0;

typedef struct measuring {
  pags_composition *composition;
  const pags_photographs *photographs;
  pags_street_truth *street;
  pags_frame *frame;
  pags_frame_options options;
  int64_t count; /* number of Gaussians; the arrays below are indexed by Gaussian id */
  float *priority, *most;
  double *weight;
  int32_t *view; /* index of the photographs' view in which the Gaussian has its largest weight `most`; -1: none */
  float *ones, *zeros;
  int64_t plane_floats;
  const pags_part *parts; /* of the view being processed, whose index is `now` */
  int part_count;
  int32_t now;
  /* of the Gaussians listed for one time: means, and distances to the nearest critical and other surface */
  float *points, *critical, *other;
  int64_t *id;
} measuring;

/* ---- Weights of the Gaussians in the training views ---- */

static int64_t id_of(const pags_part *part, int64_t row) {
  return part->id ? part->id[row] : part->first_id + row;
}

static void add_weights(void *user, const pags_cluster_score *c, int worker) {
  measuring *m = user;
  (void)worker;
  for (int i = 0; i < c->count; i++) {
    int64_t id = id_of(&m->parts[c->part], c->first + i);
    m->weight[id] += c->seen[i];
    if ((float)c->seen[i] > m->most[id]) {
      m->most[id] = (float)c->seen[i];
      m->view[id] = m->now;
    }
  }
}

static pags_result reserve_planes(measuring *m, const pags_picture *picture) {
  int64_t floats = (int64_t)picture->stride * ((picture->height + 15) / 16 * 16);
  if (floats <= m->plane_floats)
    return PAGS_OK;
  free(m->ones);
  m->ones = calloc(2 * (size_t)floats, sizeof *m->ones);
  m->plane_floats = m->ones ? floats : 0;
  if (!m->ones)
    return pags_out_of_memory("a picture of %dx%d", picture->width, picture->height);
  for (int64_t i = 0; i < floats; i++)
    m->ones[i] = 1;
  m->zeros = m->ones + floats;
  return PAGS_OK;
}

/* ---- Comparing with the true surfaces ---- */

/* Lists ids and world positions of the seen Gaussians whose best view (largest weight) was taken at `time`; returns
 * how many. */
static int64_t list_points(measuring *m, double time) {
  int64_t count = 0;
  pags_compose(m->composition, time, &m->parts, &m->part_count);
  for (int p = 0; p < m->part_count; p++)
    for (int64_t row = 0; row < m->parts[p].gaussians->count; row++) {
      int64_t id = id_of(&m->parts[p], row);
      if (m->weight[id] < least_weight || m->view[id] < 0)
        continue;
      int64_t view = m->photographs->views[m->view[id]].index;
      if (pags_dataset_view(m->photographs->dataset, view)->camera.time != time)
        continue;

      /* World position of the Gaussian; the parts are placed as at `time`. */
      const double *w = m->parts[p].world_from_model;
      for (int k = 0; k < 3; k++) {
        double x = w[4 * k + 3] + m->options.origin[k];
        for (int j = 0; j < 3; j++)
          x += w[4 * k + j] * (double)pags_plane(m->parts[p].gaussians, PAGS_MEAN + j)[row];
        m->points[3 * count + k] = (float)x;
      }

      m->id[count++] = id;
    }
  return count;
}

static pags_result check_interrupted(void) {
  return pags_interrupted() ? pags_fail(PAGS_CANCELLED, "interrupted while comparing priorities with the truth")
                            : PAGS_OK;
}

static pags_result judge_times(measuring *m, pags_priority_truth *out) {
  double left_out = 0, all = 0, before = (double)NAN;
  for (int64_t v = 0; v < m->photographs->count; v++) { /* views are in order of time */
    double time = pags_dataset_view(m->photographs->dataset, m->photographs->views[v].index)->camera.time;
    if (m->photographs->views[v].test || time == before)
      continue;
    before = time;
    PAGS_TRY(check_interrupted());
    int64_t count = list_points(m, time);
    PAGS_TRY(pags_street_truth_distances(m->street, time, m->points, count, 2 * far_metres, m->critical, m->other));
    for (int64_t i = 0; i < count; i++) {
      /* Count the Gaussian as critical or other by its nearest surface, or leave it out if its owner isn't clear. */
      int64_t id = m->id[i];
      double critical = (double)m->critical[i], other = (double)m->other[i];
      int high = m->priority[id] > 0.5f;
      out->seen++;
      all += m->weight[id];
      if (fmin(critical, other) > near_metres || fmax(critical, other) <= far_metres) {
        left_out += m->weight[id];
        ++*(fmin(critical, other) > near_metres ? &out->astray : &out->between);
      } else if (critical < other) {
        out->critical++;
        out->critical_high += high;
      } else {
        out->other++;
        out->other_high += high;
      }
    }
  }
  out->counted = out->critical + out->other;
  out->left_out_weight = all > 0 ? left_out / all : 0;
  return PAGS_OK;
}

static pags_result measure(measuring *m, pags_priority_truth *out) {
  size_t count = (size_t)m->count + 1;
  m->priority = malloc(count * sizeof *m->priority);
  m->most = calloc(count, sizeof *m->most);
  m->weight = calloc(count, sizeof *m->weight);
  m->view = malloc(count * sizeof *m->view);
  m->points = malloc(3 * count * sizeof *m->points);
  m->critical = malloc(count * sizeof *m->critical);
  m->other = malloc(count * sizeof *m->other);
  m->id = malloc(count * sizeof *m->id);
  if (!m->priority || !m->most || !m->weight || !m->view || !m->points || !m->critical || !m->other || !m->id)
    return pags_out_of_memory("the owners of %lld Gaussians", (long long)m->count);
  if (!pags_composition_priorities(m->composition, m->priority))
    return PAGS_OK;
  for (int64_t i = 0; i < m->count; i++)
    m->view[i] = -1;
  for (int64_t i = 0; i < m->photographs->count; i++) {
    PAGS_TRY(check_interrupted());
    if (!m->photographs->views[i].test) {
      /* Render the view and add its weights to each Gaussian. */
      const pags_camera *camera = &pags_dataset_view(m->photographs->dataset, m->photographs->views[i].index)->camera;
      pags_picture picture;
      m->now = (int32_t)i;
      pags_compose(m->composition, camera->time, &m->parts, &m->part_count);
      PAGS_TRY(pags_frame_render(m->frame, m->parts, m->part_count, camera, &m->options, NULL, NULL, &picture));
      PAGS_TRY(reserve_planes(m, &picture));
      pags_score_planes planes = {.counted = m->ones, .critical = m->zeros};
      PAGS_TRY(pags_frame_scores(m->frame, &planes, add_weights, m));
    }
  }
  return judge_times(m, out);
}

pags_result pags_priority_truth_measure(pags_composition *composition, const pags_photographs *photographs,
                                        pags_frame *frame, const pags_frame_options *options,
                                        pags_priority_truth *out) {
  measuring m = {.composition = composition,
                 .photographs = photographs,
                 .frame = frame,
                 .options = *options,
                 .count = pags_composition_gaussian_count(composition)};
  *out = (pags_priority_truth){0};
  PAGS_TRY(pags_street_truth_open(pags_dataset_path(photographs->dataset), &m.street));
  m.options.keep_for_backward = 1;
  m.options.extra_channels = 0;
  pags_result result = m.street ? measure(&m, out) : PAGS_OK;
  pags_street_truth_close(m.street);
  void *const arrays[] = {m.priority, m.most, m.weight, m.view, m.ones, m.points, m.critical, m.other, m.id};
  for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++)
    free(arrays[i]);
  return result;
}

#else

pags_result pags_priority_truth_measure(pags_composition *composition, const pags_photographs *photographs,
                                        pags_frame *frame, const pags_frame_options *options,
                                        pags_priority_truth *out) {
  (void)composition, (void)photographs, (void)frame, (void)options;
  *out = (pags_priority_truth){0};
  return PAGS_OK;
}

#endif

/* ---- JSON output ---- */

static void put_share(pags_json_writer *writer, const char *key, int64_t part, int64_t whole) {
  pags_json_put_number(writer, key, whole ? (double)part / (double)whole : (double)NAN);
}

void pags_priority_truth_put_json(pags_json_writer *writer, const pags_priority_truth *o) {
  if (!o->seen) {
    pags_json_put_null(writer, "priorities");
    return;
  }
  pags_json_begin_object(writer, "priorities");
  pags_json_put_integer(writer, "seen", o->seen);
  pags_json_put_integer(writer, "counted", o->counted);
  put_share(writer, "left_out", o->seen - o->counted, o->seen);
  put_share(writer, "astray", o->astray, o->seen);
  put_share(writer, "between", o->between, o->seen);
  pags_json_put_number(writer, "left_out_weight", o->left_out_weight);
  pags_json_put_integer(writer, "critical", o->critical);
  put_share(writer, "critical_high", o->critical_high, o->critical);
  pags_json_put_integer(writer, "other", o->other);
  put_share(writer, "other_high", o->other_high, o->other);
  pags_json_end_object(writer);
}
