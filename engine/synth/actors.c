/* SPDX-License-Identifier: Apache-2.0 */
/* The labelled objects of the synthetic street (actors): parked cars along both kerbs, and moving cars, pedestrians
 * and cyclists that the ego vehicle meets. Creates their meshes, starts and speeds, and gives their poses over
 * time. */
#include <math.h>

#include "base/vec3.h"
#include "maths/maths.h"
#include "synth/street.h"

#define PI 3.14159265358979324

enum { STREAM_MODELS = 10, STREAM_PARKED, STREAM_MOVING };
enum { BODY, LEFT_ARM, RIGHT_ARM, LEFT_LEG, RIGHT_LEG, PERSON_PARTS, BICYCLE = PERSON_PARTS, RIDER_PARTS };

/* ---- Models and actors at rest ---- */

static pags_person_kind make_person(pags_street *street, pags_dice *dice, uint8_t label) {
  pags_person_kind kind = {.body = pags_street_mesh(street),
                           .arm = pags_street_mesh(street),
                           .leg = pags_street_mesh(street),
                           .bicycle = -1};
  if (street->failed)
    return kind;
  const pags_person person = {&street->meshes[kind.body], &street->meshes[kind.arm], &street->meshes[kind.leg]};
  pags_person_add(&person, &street->materials, dice, label);
  return kind;
}

void pags_cast_make(pags_street *street, pags_cast *out) {
  pags_dice dice = {street->options->seed, STREAM_MODELS, 0};
  for (int i = 0; i < PAGS_CAR_KINDS; i++) {
    out->cars[i] = pags_street_mesh(street);
    if (!street->failed)
      pags_car_add(&street->meshes[out->cars[i]], &street->materials, &dice, i, out->car_sizes[i]);
  }
  for (int i = 0; i < PAGS_PERSON_KINDS; i++)
    out->people[i] = make_person(street, &dice, PAGS_CLASS_PERSON);
  for (int i = 0; i < PAGS_RIDER_KINDS; i++) {
    out->riders[i] = make_person(street, &dice, PAGS_CLASS_RIDER);
    out->riders[i].bicycle = pags_street_mesh(street);
    if (!street->failed)
      pags_bicycle_add(&street->meshes[out->riders[i].bicycle], &street->materials, &dice);
  }
}

static void add_car(pags_street *street, const pags_cast *models, pags_actor actor, int kind) {
  actor.role = PAGS_ROLE_CAR;
  pags_copy3f(models->car_sizes[kind], actor.size);
  actor.first_placement = street->placement_count;
  actor.placement_count = 1;
  const int number = pags_street_actor(street, &actor);
  pags_street_place(street, models->cars[kind], number, (float)actor.start[0], (float)actor.start[1],
                    (float)actor.ground, (float)actor.heading, 1.0f);
}

/* The size of the labelled box is constant and large enough for the swinging limbs at every phase of a stride. */
void pags_actors_stand(pags_street *street, const pags_person_kind *kind, pags_actor actor) {
  const bool rides = kind->bicycle >= 0;
  const int parts = rides ? RIDER_PARTS : PERSON_PARTS;
  const int meshes[RIDER_PARTS] = {kind->body, kind->arm, kind->arm, kind->leg, kind->leg, kind->bicycle};
  actor.role = rides ? PAGS_ROLE_CYCLIST : PAGS_ROLE_PEDESTRIAN;
  pags_copy3f(rides ? (float[3]){1.80f, 0.66f, 1.86f} : (float[3]){1.16f, 0.66f, 1.80f}, actor.size);
  actor.first_placement = street->placement_count;
  actor.placement_count = parts;
  const int number = pags_street_actor(street, &actor);
  for (int i = 0; i < parts; i++)
    pags_street_place(street, meshes[i], number, 0, 0, 0, 0, 1.0f);
}

void pags_actors_park(pags_street *street, pags_dice *dice, const pags_cast *models) {
  for (int left = 0; left < 2; left++)
    for (float x = PAGS_PARKING_BAY * (floorf(street->begin_x / PAGS_PARKING_BAY) + 0.5f); x < street->end_x - 8.0f;
         x += PAGS_PARKING_BAY) {
      const float middle =
          left ? 0.5f * (PAGS_PARKING_LEFT + PAGS_KERB_LEFT) : 0.5f * (PAGS_PARKING_RIGHT + PAGS_KERB_RIGHT);
      const float along = pags_dice_between(dice, -0.4f, 0.4f), across = pags_dice_between(dice, -0.1f, 0.1f);
      const float skew = pags_dice_between(dice, -0.025f, 0.025f);
      const int kind = pags_dice_pick(dice, PAGS_CAR_KINDS), taken = pags_dice_pick(dice, 100) < 68;
      const double spacing = (double)street->markings.spacing;
      const double phase = ((double)x - (double)street->markings.first_crossing) / spacing;
      if (taken && !(fabs(phase - floor(phase + 0.5)) * spacing < 7.0)) /* not near a crossing */
        add_car(street, models,
                (pags_actor){.start = {(double)(x + along), (double)(middle + across)},
                             .heading = (left ? PI : 0.0) + (double)skew},
                kind);
    }
}

/* ---- Moving actors ---- */

/* Returns the time, seconds, at which the ego vehicle meets actor `index` of the `count` actors of one role. These
 * times are spread about the middle of the recording, at least `gap` seconds from each other. */
static double meeting(const pags_street *street, int index, int count, double gap) {
  return 0.5 * street->duration + (index - 0.5 * (count - 1)) * fmax(street->duration / count, gap);
}

/* What tells one moving actor from the others of its role. */
typedef struct part {
  int index, count; /* its number within the role, and how many actors have that role */
  int look;         /* any number; modulo the number of models of the kind, chooses the model */
} part;

static void drive_ahead(pags_street *street, const pags_cast *models, pags_dice *dice, part p, bool right) {
  const double ahead = (right ? 13.5 : 25.0) + 9.0 * p.index;
  add_car(street, models,
          (pags_actor){.moving = true,
                       .start = {ahead + pags_street_ego_x(street->options, 0.0),
                                 right ? (double)PAGS_RIGHT_LANE : (double)PAGS_EGO_LANE},
                       .speed = right ? 10.2 : 9.8,
                       .sway = 0.8,
                       .sway_rate = 0.9,
                       .phase = (double)pags_dice_between(dice, 0.0f, 6.0f)},
          p.look % PAGS_CAR_KINDS);
}

static void drive_towards(pags_street *street, const pags_cast *models, part p) {
  const double speed = 9.0, met = meeting(street, p.index, p.count, 0.45) + 0.3;
  add_car(street, models,
          (pags_actor){.moving = true,
                       .start = {pags_street_ego_x(street->options, met) + speed * met, (double)PAGS_ONCOMING_LANE},
                       .heading = PI,
                       .speed = speed},
          p.look % PAGS_CAR_KINDS);
}

static void walk(pags_street *street, const pags_cast *models, pags_dice *dice, part p, bool left) {
  const int away = pags_dice_pick(dice, 2);
  const double speed = away ? 1.3 : 1.4, met = meeting(street, p.index, p.count, 0.3), direction = away ? 1.0 : -1.0;
  const double kerb = left ? (double)PAGS_KERB_LEFT : (double)PAGS_KERB_RIGHT;
  const double y = kerb + (left ? 1.0 : -1.0) * (away ? 1.5 : 2.6);
  pags_actors_stand(street, &models->people[p.look % PAGS_PERSON_KINDS],
                    (pags_actor){.moving = true,
                                 .start = {pags_street_ego_x(street->options, met) + 8.0 - direction * speed * met, y},
                                 .heading = away ? 0.0 : PI,
                                 .speed = speed,
                                 .ground = (double)PAGS_KERB_HEIGHT,
                                 .step_rate = 5.6,
                                 .phase = (double)pags_dice_between(dice, 0.0f, 6.0f)});
}

/* Adds a pedestrian who walks over a zebra crossing from the right and is in the middle of the ego lane when the ego
 * vehicle is about 45 m before the crossing. */
static void cross(pags_street *street, const pags_cast *models, pags_dice *dice, part p) {
  const double speed = 1.4, spacing = (double)street->markings.spacing;
  const int crossings = 1 + (int)(street->end / spacing), chosen = crossings - 1 - p.index % crossings;
  const double x = (double)street->markings.first_crossing - spacing * (crossings - 1 - chosen);
  const double row =
      p.index / crossings; /* pedestrians on one crossing walk in up to four files, 0.9 s from each other */
  const double when = fmax(0.0, (x - 45.0) / 10.0) - 0.9 * row; /* time in the middle of the ego lane, seconds */
  pags_actors_stand(street, &models->people[p.look % PAGS_PERSON_KINDS],
                    (pags_actor){.moving = true,
                                 .start = {x - 1.2 + 0.8 * fmod(row, 4.0), (double)PAGS_EGO_LANE - speed * when},
                                 .heading = 0.5 * PI,
                                 .speed = speed,
                                 .step_rate = 5.6,
                                 .phase = (double)pags_dice_between(dice, 0.0f, 6.0f)});
}

static void ride(pags_street *street, const pags_cast *models, pags_dice *dice, part p) {
  const double speed = 5.5, met = meeting(street, p.index, p.count, 0.7) + 0.25 * street->duration;
  pags_actors_stand(
      street, &models->riders[p.look % PAGS_RIDER_KINDS],
      (pags_actor){.moving = true,
                   .start = {pags_street_ego_x(street->options, met) + 6.0 - speed * met, (double)PAGS_CYCLE_LINE},
                   .speed = speed,
                   .step_rate = 5.0,
                   .phase = (double)pags_dice_between(dice, 0.0f, 6.0f)});
}

/* The roles of moving actors, options->objects of them, are dealt in turn (car ahead, oncoming car, pedestrian,
 * cyclist,
 * ...), so that even a few objects include every kind. */
void pags_actors_add(pags_street *street) {
  enum { ROLES = 8 };
  pags_cast models = {0};
  pags_cast_make(street, &models);
  if (street->failed)
    return;
  pags_dice dice = {street->options->seed, STREAM_PARKED, 0};
  pags_actors_park(street, &dice, &models);
  street->first_moving = street->placement_count;
  dice = (pags_dice){street->options->seed, STREAM_MOVING, 0};
  const int objects = street->options->objects, first = pags_dice_pick(&dice, PAGS_CAR_KINDS);
  const int both = (objects + ROLES - 1 - 1) / ROLES + (objects + ROLES - 1 - 4) / ROLES; /* of oncoming cars */
  for (int i = 0; i < objects; i++) {
    const int role = i % ROLES, turn = i / ROLES;
    const part p = {turn, (objects + ROLES - 1 - role) / ROLES, first + 3 * i}; /* 3: the next in a lane differs */
    switch (role) {
      case 0: drive_ahead(street, &models, &dice, p, true); break;
      case 1: drive_towards(street, &models, (part){2 * turn, both, p.look}); break;
      case 2: walk(street, &models, &dice, p, false); break;
      case 3: ride(street, &models, &dice, p); break;
      case 4: drive_towards(street, &models, (part){2 * turn + 1, both, p.look}); break;
      case 5: cross(street, &models, &dice, p); break;
      case 6: walk(street, &models, &dice, p, true); break;
      default: drive_ahead(street, &models, &dice, p, false); break;
    }
  }
}

/* ---- Poses over time ---- */

void pags_actor_pose(const pags_actor *actor, double time, double pose[12]) {
  const double c = pags_cos(actor->heading), s = pags_sin(actor->heading),
               way = actor->moving
                         ? (actor->speed * time +
                            actor->sway * (pags_sin(actor->sway_rate * time + actor->phase) - pags_sin(actor->phase)))
                         : 0.0;
  const double out[12] = {c,   -s,  0.0, actor->start[0] + c * way, /* origin in the middle of the box */
                          s,   c,   0.0, actor->start[1] + s * way,
                          0.0, 0.0, 1.0, actor->ground + 0.5 * (double)actor->size[2]};
  memcpy(pose, out, sizeof out);
}

/* Sets the pose of one mesh of an actor: the mesh's origin goes to `pivot` (actor's frame, metres, origin on the
 * ground between the feet), and the mesh is rotated by `swing` radians about the actor's y axis. `box` is the pose of
 * the actor's box, `ground` the height of the ground under it. */
static void put_part(pags_stage_placement *placement, const double box[12], double ground, const double pivot[3],
                     double swing) {
  const double c = pags_cos(swing), s = pags_sin(swing), turn[9] = {c, 0, s, 0, 1, 0, -s, 0, c};
  for (int r = 0; r < 3; r++) {
    const double *b = box + 4 * r;
    for (int k = 0; k < 3; k++)
      placement->pose[4 * r + k] = (float)(b[0] * turn[k] + b[1] * turn[3 + k] + b[2] * turn[6 + k]);
    placement->pose[4 * r + 3] =
        (float)(b[0] * pivot[0] + b[1] * pivot[1] + b[2] * pivot[2] + (r == 2 ? ground : b[3]));
  }
}

void pags_street_set_time(pags_street *street, double time) {
  for (int i = 0; i < street->actor_count; i++) {
    const pags_actor *actor = &street->actors[i];
    pags_stage_placement *parts = street->placements + actor->first_placement;
    double box[12];
    if (!actor->moving)
      continue;
    pags_actor_pose(actor, time, box);
    if (actor->role == PAGS_ROLE_CAR)
      put_part(parts, box, actor->ground, (double[3]){0, 0, 0}, 0.0);
    else {
      /* Walking: arms swing against legs. Cycling: the trunk leans forward, the arms stay stretched towards the
       * handlebar, the legs swing in turn. */
      const double step = pags_sin(actor->step_rate * time + actor->phase);
      const bool rides = actor->role == PAGS_ROLE_CYCLIST;
      const double lean = rides ? 0.45 : 0.03, seat = rides ? 0.07 : 0.0, back = rides ? -0.18 : 0.0;
      const double hip = (double)PAGS_HIP_HEIGHT + seat, reach = (double)(PAGS_SHOULDER_HEIGHT - PAGS_HIP_HEIGHT);
      const double shoulder[2] = {back + reach * pags_sin(lean), hip + reach * pags_cos(lean)};
      const double foot =
          (double)PAGS_HIP_HEIGHT; /* the trunk's mesh has its origin at the feet, but must turn about the hip */
      put_part(&parts[BODY], box, actor->ground,
               (double[3]){back - foot * pags_sin(lean), 0, hip - foot * pags_cos(lean)}, lean);
      for (int side = 0; side < 2; side++) {
        const double y = side ? -0.23 : 0.23, turn = side ? -1.0 : 1.0;
        const double arm = rides ? -0.75 : 0.45 * step * turn,
                     leg = rides ? -0.45 + 0.3 * step * turn : -0.42 * step * turn;
        put_part(&parts[LEFT_ARM + side], box, actor->ground, (double[3]){shoulder[0], y, shoulder[1]}, arm);
        put_part(&parts[LEFT_LEG + side], box, actor->ground, (double[3]){back, 0.4 * y, hip + (rides ? 0.02 : 0.0)},
                 leg);
      }
      if (rides)
        put_part(&parts[BICYCLE], box, actor->ground, (double[3]){0, 0, 0}, 0.0);
    }
  }
}
