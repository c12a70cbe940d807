/* SPDX-License-Identifier: Apache-2.0 */
/* State of pags-bench proxies, shared by its files. */
#ifndef PAGS_BENCHMARKS_PROXIES_H
#define PAGS_BENCHMARKS_PROXIES_H

#include <pags/scene.h>
#include "exporters/proxy/proxy_error.h"
#include "synth/stage.h"
#include "synth/street.h"

#include "benchmarks/exporters/glb.h"
#include "cli/common/session.h"

typedef struct pags_proxy_bench {
  pags_session session;
  pags_scene scene;
  pags_glb file;
  pags_street_options options;
  pags_street street;
  pags_stage *stage;
  double stage_time;
  pags_json_writer json;
  int failures;
  int pictures; /* 1: the truth is in pictures (truth/depth, truth/ids), not in the rebuilt street */
} pags_proxy_bench;

/* Moves the street's actors to their poses at `time` (seconds). */
pags_result pags_proxy_bench_time(pags_proxy_bench *self, double time);
/* Writes a distance summary as an array: mean, 95th percentile, maximum. */
void pags_proxy_bench_put(pags_json_writer *w, const char *key, const pags_proxy_distance *d);
/* Measures the proxy of a labelled object, which is the mesh of `node`; does nothing unless the object is a
 * vehicle. */
pags_result pags_proxy_bench_vehicle(pags_proxy_bench *self, const pags_json_value *node, const char *track);

#endif
