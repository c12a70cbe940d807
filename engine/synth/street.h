/* SPDX-License-Identifier: Apache-2.0 */
/* The street: its meshes, what is placed where, who moves, and the car that records it. */
#ifndef PAGS_SYNTH_STREET_H
#define PAGS_SYNTH_STREET_H

#include <pags/camera.h>
#include <pags/synth.h>

#include "synth/models.h"

typedef enum pags_role { PAGS_ROLE_CAR, PAGS_ROLE_PEDESTRIAN, PAGS_ROLE_CYCLIST } pags_role;

/* A labelled object. It goes straight at a speed that sways. */
typedef struct pags_actor {
  pags_role role;
  int moving;
  float size[3];                 /* of its box: length, width, height; metres */
  double start[2];               /* x, y of its middle at time 0, metres */
  double heading;                /* radians, 0 = along +x */
  double speed;                  /* m/s */
  double sway, sway_rate, phase; /* metres to and fro, radians a second, radians */
  double ground;                 /* z of what it stands on */
  double step_rate;              /* of a walk, radians a second */
  int first_placement, placement_count;
  int number; /* in the data set's list; -1: never near enough to be labelled */
} pags_actor;

typedef struct pags_street {
  const pags_street_options *options;
  double duration, end; /* seconds of recording; x where the recording car is then */
  float begin_x, end_x; /* of the street */
  pags_markings markings;
  pags_materials materials;
  pags_mesh *meshes;
  pags_stage_placement *placements; /* the street's first, then those of actors, moving ones last */
  pags_actor *actors;               /* parked ones first */
  int mesh_count, placement_count, actor_count;
  int mesh_capacity, placement_capacity, actor_capacity;
  int first_moving; /* placement; from there on poses change with time */
  bool failed;      /* memory ran out */
} pags_street;

pags_result pags_street_build(const pags_street_options *options, pags_street *street);
void pags_street_destroy(pags_street *street);

/* For those who build it: numbers of new meshes, placements and actors. */
int pags_street_mesh(pags_street *street);
int pags_street_place(pags_street *street, int mesh, int actor, float x, float y, float z, float yaw, float scale);
int pags_street_actor(pags_street *street, const pags_actor *actor);

/* Ground, houses, trees, furniture (scenery.c). */
void pags_scenery_add(pags_street *street);
/* Parked and moving objects (actors.c). */
void pags_actors_add(pags_street *street);

/* What those are put together from; a town (town.c) is, too. Along x, the street's middle line at y = 0. */
typedef struct pags_ground {
  uint16_t asphalt, slabs, stone, grass; /* materials */
} pags_ground;
pags_ground pags_ground_make(pags_materials *materials);
/* A level rectangle. */
void pags_ground_pave(pags_mesh *mesh, float x0, float x1, float y0, float y1, float z, uint16_t material);
/* Kerb and pavement of one side. */
void pags_ground_kerb(pags_mesh *mesh, const pags_ground *ground, float x0, float x1, int left);

enum { PAGS_TREE_KINDS = 4, PAGS_CAR_KINDS = 10, PAGS_PERSON_KINDS = 6, PAGS_RIDER_KINDS = 3 };
typedef struct pags_planting {
  int trees[PAGS_TREE_KINDS], signs[3], lamp, bin; /* meshes */
} pags_planting;
void pags_planting_make(pags_street *street, pags_dice *dice, pags_planting *out);
/* Trees, lamps, signs and bins along both kerbs from begin_x to end_x; none on crossings. */
void pags_planting_add(pags_street *street, pags_dice *dice, const pags_planting *kinds);

typedef struct pags_person_kind {
  int body, arm, leg, bicycle; /* meshes; bicycle -1: on foot */
} pags_person_kind;
/* The models that actors are cast from. */
typedef struct pags_cast {
  int cars[PAGS_CAR_KINDS];
  float car_sizes[PAGS_CAR_KINDS][3];
  pags_person_kind people[PAGS_PERSON_KINDS], riders[PAGS_RIDER_KINDS];
} pags_cast;
void pags_cast_make(pags_street *street, pags_cast *out);
/* Cars along both kerbs from begin_x to end_x. */
void pags_actors_park(pags_street *street, pags_dice *dice, const pags_cast *models);
/* Someone on foot or on a bicycle: role, size and placements of `actor` are filled in here, poses by
 * pags_street_set_time. */
void pags_actors_stand(pags_street *street, const pags_person_kind *kind, pags_actor actor);

/* The box's pose: x forward, y left, z up, origin in its middle. */
void pags_actor_pose(const pags_actor *actor, double time, double pose[12]);
/* Puts the parts of all moving actors where they are at `time`. */
void pags_street_set_time(pags_street *street, double time);

/* The recording car: x forward, y left, z up, origin on the road below its rear axle. */
void pags_street_ego(double time, double pose[12]);
/* Where the car is on the road at `time`; x only. */
double pags_street_ego_x(double time);
/* Camera 0 front, 1 front left, 2 front right: constant pose in the ego frame, OpenCV axes. */
void pags_street_mount(int camera, double pose[12]);
/* That camera at `time`, moved `right` metres along its own x and `up` metres along the car's z. */
pags_camera pags_street_camera(const pags_street_options *options, double time, int camera, double right, double up);

#endif
