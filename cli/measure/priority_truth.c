/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval: compares the priorities of Gaussians with the truth of a synthetic street: whether the nearest surface is
 * critical. */
#include "cli/measure/errors.h"

#include <math.h>

#ifdef PAGS_WITH_SYNTH

#include <pags/synth.h>

#include "base/memory.h"
#include "cli/draw/picture.h"

static const double near_metres = 0.05, far_metres = 0.15;
/* sum of alpha T over all training views from which on a Gaussian counts as seen, in pixels */
static const double least_weight = 1.0;

PAGS_DEFINE_AUTO(pags_street_truth, pags_street_truth_close)

/* A Gaussian in the training views: the sum of its weights, the largest, and the index of the photographs' view that it
 * is of. */
typedef struct sighting {
  double weight;
  float most;
  int32_t view;
} sighting;

typedef struct measuring {
  pags_composition *composition;
  const pags_photographs *photographs;
  const double *origin;
  sighting *seen; /* by the Gaussian's id */
  int32_t now;    /* the view being processed */
} measuring;

static void add_weight(void *user, int64_t id, double weight) {
  measuring *const m = user;
  sighting *const seen = &m->seen[id];
  seen->weight += weight;
  if ((float)weight > seen->most) {
    seen->most = (float)weight;
    seen->view = m->now;
  }
}

static double time_of(const pags_photographs *photographs, int64_t view) {
  return pags_dataset_view(photographs->dataset, photographs->views[view].index)->camera.time;
}

/* Lists ids and world positions of the seen Gaussians whose best view (largest weight) was taken at `time`; returns
 * how many. */
static int64_t list_points(const measuring *m, double time, int64_t *ids, float *points) {
  const pags_part *parts;
  int part_count;
  int64_t count = 0;
  pags_compose(m->composition, time, &parts, &part_count);
  for (int p = 0; p < part_count; p++)
    for (int64_t row = 0; row < parts[p].gaussians->count; row++) {
      const int64_t id = parts[p].id ? parts[p].id[row] : parts[p].first_id + row;
      if (m->seen[id].weight < least_weight || time_of(m->photographs, m->seen[id].view) != time)
        continue;
      const double *w = parts[p].world_from_model; /* as at `time` */
      for (int k = 0; k < 3; k++) {
        double x = w[4 * k + 3] + m->origin[k];
        for (int j = 0; j < 3; j++)
          x += w[4 * k + j] * (double)pags_plane(parts[p].gaussians, PAGS_MEAN + j)[row];
        points[3 * count + k] = (float)x;
      }
      ids[count++] = id;
    }
  return count;
}

static pags_result check_interrupted(void) {
  return pags_interrupted() ? pags_fail(PAGS_CANCELLED, "interrupted while comparing priorities with the truth")
                            : PAGS_OK;
}

/* Counts each seen Gaussian as critical or other by its nearest surface, or leaves it out if its owner isn't clear. */
static pags_result judge(const measuring *m, pags_street_truth *street, const float *priority, size_t gaussians,
                         pags_priority_truth *out) {
  double left_out = 0, all = 0, before = (double)NAN;
  /* Of the Gaussians listed for one time: means, and distances to the nearest critical and other surface. */
  PAGS_AUTOFREE int64_t *ids = malloc(gaussians * sizeof *ids);
  PAGS_AUTOFREE float *points = malloc(5 * gaussians * sizeof *points);
  PAGS_CHECK_MEMORY(ids && points, "the owners of %lld Gaussians", (long long)gaussians - 1);
  float *const critical = points + 3 * gaussians, *const other = critical + gaussians;
  for (int64_t v = 0; v < m->photographs->count; v++) { /* views are in order of time */
    const double time = time_of(m->photographs, v);
    if (m->photographs->views[v].test || time == before)
      continue;
    before = time;
    PAGS_TRY(check_interrupted());
    const int64_t count = list_points(m, time, ids, points);
    PAGS_TRY(pags_street_truth_distances(street, time, points, count, 2 * far_metres, critical, other));
    for (int64_t i = 0; i < count; i++) {
      const double weight = m->seen[ids[i]].weight;
      const double near = (double)fminf(critical[i], other[i]), far = (double)fmaxf(critical[i], other[i]);
      const bool high = priority[ids[i]] > 0.5f;
      out->seen++;
      all += weight;
      if (near > near_metres || far <= far_metres) {
        left_out += weight;
        ++*(near > near_metres ? &out->astray : &out->between);
      } else if (critical[i] < other[i]) {
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

pags_result pags_priority_truth_measure(pags_composition *composition, const pags_photographs *photographs,
                                        pags_frame *frame, const pags_frame_options *options,
                                        pags_priority_truth *out) {
  const size_t count = (size_t)pags_composition_gaussian_count(composition) + 1;
  pags_frame_options plain = *options;
  PAGS_AUTO(pags_street_truth_close_auto) pags_street_truth *street = NULL;
  *out = (pags_priority_truth){0};
  PAGS_TRY(pags_street_truth_open(pags_dataset_path(photographs->dataset), &street));
  if (!street)
    return PAGS_OK;
  PAGS_AUTOFREE float *priority = malloc(count * sizeof *priority);
  PAGS_AUTOFREE sighting *seen = calloc(count, sizeof *seen);
  PAGS_CHECK_MEMORY(priority && seen, "the owners of %lld Gaussians", (long long)count - 1);
  if (!pags_composition_priorities(composition, priority))
    return PAGS_OK;
  plain.extra_channels = 0;
  measuring m = {.composition = composition, .photographs = photographs, .origin = options->origin, .seen = seen};
  for (int64_t i = 0; i < photographs->count; i++) {
    PAGS_TRY(check_interrupted());
    m.now = (int32_t)i;
    if (!photographs->views[i].test)
      PAGS_TRY(pags_picture_weights(composition, frame,
                                    &pags_dataset_view(photographs->dataset, photographs->views[i].index)->camera,
                                    &plain, add_weight, &m));
  }
  return judge(&m, street, priority, count, out);
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
