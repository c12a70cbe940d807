/* SPDX-License-Identifier: Apache-2.0 */
/* Plans a town as large as the wanted number of Gaussians covers, covers its surfaces with Gaussians (surface.c), and
 * writes the scene with its sky and camera views. */
#include <math.h>
#include <pags/scene.h>

#include "base/file.h"
#include "base/lock.h"
#include "base/memory.h"
#include "base/text.h"
#include "scene/scene_json.h"
#include "synth/size_tables.h"
#include "synth/surface.h"
#include "synth/view.h"

enum { CAMERAS = 3, SKY_SIZE = 256, PROBES = 6000, FITS = 3 };
#define SHORTEST_BLOCK 12.0 /* metres; room for one house */

pags_town_options pags_town_options_default(void) {
  return (pags_town_options){.gaussians = 2000000, .density = 1.0, .width = 960, .height = 540, .frames = 24};
}

typedef struct town_maker {
  const pags_town_options *options;
  pags_street_options street_options;
  pags_town_plan plan;
  pags_street town;
  pags_stage *stage;
  pags_surface surface;
  double seen; /* visible surface, square metres weighted by density */
} town_maker;

static void raze(town_maker *m) {
  pags_surface_destroy(&m->surface);
  pags_stage_destroy(m->stage);
  pags_street_destroy(&m->town);
  m->stage = NULL;
}

/* The camera of a view. The ego vehicle drives along the middle street, from x = 4 m to 12 m before its end. */
static pags_camera camera_at(const town_maker *m, int frame, int camera) {
  const pags_town_options *o = m->options;
  const float length = pags_town_length(&m->plan);
  const double share = o->frames > 1 ? (double)frame / (o->frames - 1) : 0.0;
  const double ego[12] = {1, 0, 0, 4.0 + share * fmax((double)length - 16.0, 1.0),
                          0, 1, 0, (double)PAGS_EGO_LANE + (double)(m->plan.streets / 2) * (double)pags_town_pitch(),
                          0, 0, 1, 0};
  double mount[12];
  pags_camera out = {.width = o->width, .height = o->height, .time = 0.1 * frame};
  out.fx = out.fy = 0.8 * o->width;
  out.cx = 0.5 * o->width;
  out.cy = 0.5 * o->height;
  pags_street_mount(camera, mount);
  pags_rigid_multiply(ego, mount, out.world_from_camera);
  return out;
}

static pags_result make_scene(town_maker *m, pags_tasks *tasks, pags_progress_fn *progress, void *user,
                              pags_scene *scene) {
  *scene = (pags_scene){.up = PAGS_UP_Z, .fps = 10, .seed = m->options->seed};
  scene->time_end = 0.1 * (m->options->frames - 1);
  m->street_options = pags_street_options_default();
  m->street_options.seed = m->options->seed;

  /* One metre of street has about 90 square metres of visible surface, weighted by density; that gives the total
   * length of the streets. The town is made deeper than long, so that seen from the middle street several blocks
   * stand behind each other. The length of the blocks is then fitted: a town is built, its visible surface measured,
   * and the length corrected, up to FITS times. */
  const double wanted = (double)m->options->gaussians / PAGS_TRAINED_DENSITY, metres = wanted / 90.0;
  const double shortest = 2.0 * SHORTEST_BLOCK + (double)PAGS_TOWN_LANE; /* of a street, metres */
  const int streets = (int)fmin(sqrt(metres / 9.0) + 0.5, metres / shortest);
  m->plan.streets = streets < 2 ? 2 : streets;
  const int columns = (int)(metres / m->plan.streets / 36.0 + 0.5);
  m->plan.columns = columns < 2 ? 2 : columns;
  m->plan.block = 30.0f;
  for (int fit = 0; fit < FITS; fit++) {
    /* Build a town of this block length and measure its visible surface. */
    raze(m);
    PAGS_TRY(pags_town_build(&m->street_options, &m->plan, &m->town));
    PAGS_TRY(
        pags_stage_create(m->town.meshes, m->town.mesh_count, m->town.placements, m->town.placement_count, &m->stage));
    PAGS_TRY(pags_surface_create(&m->town, &m->plan, m->stage, &m->surface));
    m->seen = pags_surface_seen(&m->surface, PROBES);

    const double block = (double)m->plan.block * wanted / m->seen;
    if (fabs(wanted / m->seen - 1.0) < 0.01 || fit + 1 == FITS)
      break;
    m->plan.block = (float)fmin(fmax(block, SHORTEST_BLOCK), 60.0);
  }

  /* The views: three cameras at each position of the drive. */
  scene->views = calloc((size_t)m->options->frames * CAMERAS, sizeof *scene->views);
  PAGS_CHECK_MEMORY(scene->views, "the views of a town");
  for (int i = 0; i < m->options->frames * CAMERAS; i++) {
    pags_scene_view *view = &scene->views[scene->view_count];
    *view = (pags_scene_view){.camera = camera_at(m, i / CAMERAS, i % CAMERAS),
                              .sensor = i % CAMERAS,
                              .frame = i / CAMERAS,
                              .gain = {1, 1, 1}};
    view->name = pags_text_format("%03d_%d.png", i / CAMERAS, i % CAMERAS);
    PAGS_CHECK_MEMORY(view->name, "the views of a town");
    scene->view_count++;
  }

  /* The sky's cube map. */
  PAGS_TRY(pags_sky_create(&scene->sky, SKY_SIZE));
  float *texel = scene->sky.texels;
  for (int face = 0; face < 6; face++)
    for (int row = 0; row < SKY_SIZE; row++)
      for (int column = 0; column < SKY_SIZE; column++, texel += 3) {
        float direction[3];

        /* Direction of the texel's centre; the order and axes of the faces are those of pags/sky.h. */
        double s = 2 * (column + 0.5) / SKY_SIZE - 1;
        double t = 2 * (row + 0.5) / SKY_SIZE - 1;
        const double ways[6][3] = {{1, -t, -s}, {-1, -t, s}, {s, 1, t}, {s, -1, -t}, {s, -t, 1}, {-s, -t, -1}};
        const double length = sqrt(1.0 + s * s + t * t);
        for (int k = 0; k < 3; k++)
          direction[k] = (float)(ways[face][k] / length);

        pags_sky_color(direction, m->options->seed, texel);
        for (int c = 0; c < 3; c++)
          texel[c] = pags_display_srgb(texel[c]);
      }

  /* The background model with all Gaussians. */
  scene->models = calloc(1, sizeof *scene->models);
  PAGS_CHECK_MEMORY(scene->models, "a town");
  scene->model_count = 1;
  pags_model *model = &scene->models[0];
  const int64_t count = (int64_t)((double)m->options->gaussians * m->options->density + 0.5);
  model->name = pags_text_copy("background");
  model->file = pags_text_copy("background.ply");
  PAGS_CHECK_MEMORY(model->name && model->file, "a town");
  PAGS_TRY(pags_gaussians_create(&model->gaussians, count, 1));
  PAGS_TRY(pags_gaussians_add_s_sem(&model->gaussians));
  return pags_surface_sample(&m->surface, &model->gaussians, tasks, progress, user);
}

pags_result pags_synth_town(const char *folder, const pags_town_options *options, pags_tasks *tasks,
                            pags_progress_fn *progress, void *user, pags_town_facts *facts) {
  /* Ranges of the options. */
  PAGS_TRY(pags_synth_in_range("gaussians", (double)options->gaussians, 1000, 2e8));
  PAGS_TRY(pags_synth_in_range("density", options->density, 0.05, 20));
  PAGS_TRY(pags_synth_in_range("gaussians times density", (double)options->gaussians * options->density, 1, 2e9));
  PAGS_TRY(pags_synth_in_range("width", options->width, 16, 8192));
  PAGS_TRY(pags_synth_in_range("height", options->height, 16, 8192));
  PAGS_TRY(pags_synth_in_range("frames", options->frames, 1, 10000));

  PAGS_AUTO(pags_lock_release_auto) pags_lock *lock = NULL;
  PAGS_AUTO(raze) town_maker maker = {.options = options};
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  bool empty = true;
  PAGS_TRY(pags_lock_folder(folder, &lock));
  PAGS_TRY(pags_dir_is_empty(folder, &empty));
  if (!empty && !options->overwrite)
    return pags_fail(PAGS_ERROR_IO, "%s: expected an empty or a new folder", folder);
  PAGS_TRY(make_scene(&maker, tasks, progress, user, &scene));
  PAGS_TRY(pags_scene_write(folder, &scene));
  if (facts)
    *facts = (pags_town_facts){.gaussians = pags_scene_gaussian_count(&scene),
                               .streets = maker.plan.streets,
                               .blocks = (maker.plan.streets + 1) * maker.plan.columns,
                               .length = (double)pags_town_length(&maker.plan),
                               .breadth = (double)(maker.plan.streets - 1) * (double)pags_town_pitch() +
                                          (double)(PAGS_FRONT_LEFT - PAGS_FRONT_RIGHT) + (double)PAGS_TOWN_BLOCK_DEPTH,
                               .square_metres = maker.seen};
  return PAGS_OK;
}
