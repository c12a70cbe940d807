/* SPDX-License-Identifier: Apache-2.0 */
/* Builds a town from the building blocks of the synthetic street: its cross-section, houses, trees, lamps, cars and
 * people. */
#include "synth/town.h"

#include "base/memory.h"
#include "base/vec3.h"

enum { STREAM_HOUSES = 101, STREAM_KINDS, STREAM_PLANTS, STREAM_PARKED, STREAM_PEOPLE };

#define PI 3.14159265358979324
#define END_GAP 5.0f /* metres from a street's end to the houses that close it */
#define PEOPLE_PER_METRE 0.06f

float pags_town_pitch(void) {
  return PAGS_FRONT_LEFT - PAGS_FRONT_RIGHT + PAGS_TOWN_BLOCK_DEPTH;
}

float pags_town_length(const pags_town_plan *plan) {
  return (float)plan->columns * plan->block + (float)(plan->columns - 1) * PAGS_TOWN_LANE;
}

float pags_town_lane_x(const pags_town_plan *plan, int column) {
  return (float)(column + 1) * (plan->block + PAGS_TOWN_LANE) - 0.5f * PAGS_TOWN_LANE;
}

/* Adds houses wall to wall that fill [from, to], metres along plot.along. `plot` gives the position of coordinate 0,
 * the direction of the fronts and the houses' depth. */
static void add_row(pags_street *town, pags_mesh *mesh, pags_dice *dice, pags_plot plot, float from, float to) {
  const float length = to - from;
  const int houses = length > 18.0f ? (int)(length / 11.5f) : 1;
  float origin[3], at = from;
  pags_copy3f(plot.base, origin);
  for (int i = 0; i < houses; i++) {
    const float left = to - at, share = left / (float)(houses - i);
    plot.width = i + 1 < houses ? share * pags_dice_between(dice, 0.8f, 1.2f) : left;
    pags_along3f(origin, at, plot.along, plot.base);
    pags_building_add(mesh, &town->materials, dice, &plot);
    at += plot.width;
  }
}

static void pave(pags_street *town, pags_mesh *mesh, const pags_town_plan *plan) {
  const pags_ground ground = pags_ground_make(&town->materials);
  const float x0 = -END_GAP, x1 = pags_town_length(plan) + END_GAP;
  pags_ground_pave(mesh, x0, x1, PAGS_KERB_RIGHT, PAGS_KERB_LEFT, 0.0f, ground.asphalt);
  for (int left = 0; left < 2; left++)
    pags_ground_kerb(mesh, &ground, x0, x1, left);
  for (int c = 0; c + 1 < plan->columns; c++) {
    const float x = pags_town_lane_x(plan, c), half = 0.5f * PAGS_TOWN_LANE;
    pags_ground_pave(mesh, x - half, x + half, PAGS_FRONT_LEFT, PAGS_FRONT_LEFT + PAGS_TOWN_BLOCK_DEPTH,
                     PAGS_KERB_HEIGHT, ground.slabs);
  }
}

/* Adds pedestrians on both pavements and cyclists on the cycle line. */
static void add_people(pags_street *town, pags_dice *dice, const pags_cast *models, float length) {
  const int count = (int)(PEOPLE_PER_METRE * length) + 1;
  for (int i = 0; i < count; i++) {
    const bool left = pags_dice_pick(dice, 2), rides = pags_dice_pick(dice, 5) == 0;
    const float off = pags_dice_between(dice, 1.3f, 2.9f);
    const float y = rides ? PAGS_CYCLE_LINE : left ? PAGS_KERB_LEFT + off : PAGS_KERB_RIGHT - off;
    const pags_person_kind *kind = rides ? &models->riders[pags_dice_pick(dice, PAGS_RIDER_KINDS)]
                                         : &models->people[pags_dice_pick(dice, PAGS_PERSON_KINDS)];
    pags_actors_stand(town, kind,
                      (pags_actor){.moving = true,
                                   .start = {(double)pags_dice_between(dice, 1.0f, length - 1.0f), (double)y},
                                   .heading = rides || pags_dice_pick(dice, 2) ? 0.0 : PI,
                                   .ground = rides ? 0.0 : (double)PAGS_KERB_HEIGHT,
                                   .phase = (double)pags_dice_between(dice, 0.0f, 6.0f)});
  }
}

pags_result pags_town_build(const pags_street_options *options, const pags_town_plan *plan, pags_street *town) {
  *town = (pags_street){.options = options,
                        .end_x = pags_town_length(plan),
                        .markings = {pags_town_lane_x(plan, 0), plan->block + PAGS_TOWN_LANE}};
  const uint64_t seed = options->seed;
  const int blocks = (plan->streets + 1) * plan->columns;
  pags_dice houses = {seed, STREAM_HOUSES, 0}, kinds = {seed, STREAM_KINDS, 0}, plants = {seed, STREAM_PLANTS, 0};
  pags_dice parked = {seed, STREAM_PARKED, 0}, people = {seed, STREAM_PEOPLE, 0};
  pags_planting planting;
  pags_cast models = {0};
  const int walls = pags_street_mesh(town), ground = pags_street_mesh(town);
  if (town->failed)
    return pags_out_of_memory("a town of %d blocks", blocks);
  pags_street_place(town, walls, -1, 0, 0, 0, 0, 1);

  /* Two rows of houses that close all streets at both ends. */
  const float length = pags_town_length(plan), top = (float)(plan->streets - 1) * pags_town_pitch() + PAGS_FRONT_LEFT;
  for (int end = 0; end < 2; end++) {
    const pags_plot plot = {.base = {end ? length + END_GAP : -END_GAP, 0, PAGS_KERB_HEIGHT - 0.02f},
                            .along = {0, 1, 0},
                            .into = {end ? 1.0f : -1.0f, 0, 0},
                            .depth = 10.0f};
    add_row(town, &town->meshes[walls], &houses, plot, PAGS_FRONT_RIGHT - 6.0f, top + 6.0f);
  }

  pave(town, &town->meshes[ground], plan);
  pags_planting_make(town, &kinds, &planting);
  pags_cast_make(town, &models);
  for (int s = 0; s < plan->streets && !town->failed; s++) {
    const int placement = town->placement_count, actor = town->actor_count;

    /* The houses on both sides of street `s`, block by block; in the outermost rows houses fill the lanes, too. */
    const float y = (float)s * pags_town_pitch();
    for (int left = 0; left < 2; left++) {
      const bool outermost = left ? s + 1 == plan->streets : s == 0;
      const pags_plot plot = {.base = {0, y + (left ? PAGS_FRONT_LEFT : PAGS_FRONT_RIGHT), PAGS_KERB_HEIGHT - 0.02f},
                              .along = {1, 0, 0},
                              .into = {0, left ? 1.0f : -1.0f, 0},
                              .depth = 0.5f * PAGS_TOWN_BLOCK_DEPTH};
      for (int c = 0; c < plan->columns; c++) {
        const float from = (float)c * (plan->block + PAGS_TOWN_LANE), to = from + plan->block;
        const bool last = c + 1 == plan->columns;
        add_row(town, &town->meshes[walls], &houses, plot, from, outermost && !last ? to + PAGS_TOWN_LANE : to);
      }
    }

    pags_street_place(town, ground, -1, 0, 0, 0, 0, 1);
    pags_planting_add(town, &plants, &planting);
    pags_actors_park(town, &parked, &models);
    add_people(town, &people, &models, town->end_x);

    /* What was built for a street at y = 0 moves to this one. */
    for (int i = placement; i < town->placement_count; i++)
      town->placements[i].pose[7] += y;
    for (int i = actor; i < town->actor_count; i++)
      town->actors[i].start[1] += (double)y;
  }
  pags_street_set_time(town, 0.0);
  PAGS_CHECK_MEMORY(pags_street_is_complete(town), "a town of %d blocks", blocks);
  return PAGS_OK;
}
