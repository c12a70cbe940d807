/* SPDX-License-Identifier: Apache-2.0 */
/* The synthetic street: its meshes and their placements, its labelled objects (actors) and their motion, and the ego
 * vehicle with the cameras that record it. World: metres, x along the street, y to the left, z up. */
#ifndef PAGS_SYNTH_STREET_H
#define PAGS_SYNTH_STREET_H

#include <pags/camera.h>
#include <pags/synth.h>

#include "synth/models.h"

/* The cross-section of the street: positions y in metres, 0 on the middle line, positive to its left. Traffic keeps
 * to the right. The ego vehicle drives in the left one of its two lanes, so that a camera shifted by three metres to
 * the right is still over a lane. */
#define PAGS_EGO_LANE (-1.65f)
#define PAGS_LANE_EDGE (-3.3f)
#define PAGS_RIGHT_LANE (-4.6f) /* cars in the right lane drive here, clear of cyclists */
#define PAGS_CYCLE_LINE (-6.3f)
#define PAGS_ONCOMING_LANE 1.65f
#define PAGS_PARKING_LEFT 3.3f
#define PAGS_PARKING_RIGHT (-6.6f)
#define PAGS_PARKING_BAY 6.0f /* length of one bay along x */
#define PAGS_KERB_LEFT 5.5f
#define PAGS_KERB_RIGHT (-8.8f)
#define PAGS_KERB_HEIGHT 0.13f
#define PAGS_FRONT_LEFT 9.2f /* where the house plots begin, behind the pavement */
#define PAGS_FRONT_RIGHT (-12.5f)
#define PAGS_ZEBRA 4.0f /* length of a crossing along x */

typedef enum pags_role { PAGS_ROLE_CAR, PAGS_ROLE_PEDESTRIAN, PAGS_ROLE_CYCLIST } pags_role;

/* A labelled object. A moving one goes straight ahead; a sine of amplitude `sway` added to its path makes its speed
 * vary. */
typedef struct pags_actor {
  pags_role role;
  bool moving;
  float size[3];                 /* length, width and height of its labelled box, metres */
  double start[2];               /* x, y of its middle at time 0, metres */
  double heading;                /* radians, 0 = along +x */
  double speed;                  /* mean speed, m/s */
  double sway, sway_rate, phase; /* amplitude (metres), rate (radians a second), phase (radians) of the sine */
  double ground;                 /* z of the road or pavement that it stands on, metres */
  double step_rate;              /* rate at which legs swing, radians a second */
  int first_placement, placement_count;
  int number; /* its number in the data set; -1: never near enough to the ego vehicle to be labelled */
} pags_actor;

typedef struct pags_street {
  const pags_street_options *options;
  double duration, end; /* length of the recording, seconds; x of the ego vehicle at its end */
  float begin_x, end_x; /* where the street begins and ends */
  pags_markings markings;
  pags_materials materials;
  pags_mesh *meshes;
  pags_stage_placement *placements; /* scenery first, then parked actors', then moving actors' */
  pags_actor *actors;               /* parked ones first */
  int mesh_count, placement_count, actor_count;
  int64_t mesh_capacity, placement_capacity, actor_capacity;
  int first_moving; /* index of the first placement whose pose changes with time; all after it do, too */
  bool failed;      /* out of memory */
} pags_street;

pags_result pags_street_build(const pags_street_options *options, pags_street *street);
void pags_street_destroy(pags_street *street);
/* Whether nothing is missing for want of memory. */
bool pags_street_is_complete(const pags_street *street);

/* Checks that an option of the synthetic scenes lies within its range; the error message names the option. */
static inline pags_result pags_synth_in_range(const char *name, double value, double lo, double hi) {
  if (value >= lo && value <= hi)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT, "%s is %.12g, expected %.12g..%.12g", name, value, lo, hi);
}

/* For the functions that build a street: append an empty mesh, a placement or an actor and return its index (0 when
 * out of memory, which sets `failed`). `yaw` is in radians about z. */
int pags_street_mesh(pags_street *street);
int pags_street_place(pags_street *street, int mesh, int actor, float x, float y, float z, float yaw, float scale);
int pags_street_actor(pags_street *street, const pags_actor *actor);

/* Adds parked and moving objects (actors.c). */
void pags_actors_add(pags_street *street);

/* The building blocks of streets, which town.c uses as well. They build along x, with the middle line of the street at
 * y = 0. */
typedef struct pags_ground {
  uint16_t asphalt, slabs, stone, grass; /* numbers of materials */
} pags_ground;
pags_ground pags_ground_make(pags_materials *materials);
/* Adds the horizontal rectangle [x0, x1] x [y0, y1] at height z. */
void pags_ground_pave(pags_mesh *mesh, float x0, float x1, float y0, float y1, float z, uint16_t material);
/* Adds the kerb and the pavement of one side from x0 to x1. */
void pags_ground_kerb(pags_mesh *mesh, const pags_ground *ground, float x0, float x1, int left);

enum { PAGS_TREE_KINDS = 4, PAGS_CAR_KINDS = 10, PAGS_PERSON_KINDS = 6, PAGS_RIDER_KINDS = 3 };
typedef struct pags_planting {
  int trees[PAGS_TREE_KINDS], signs[3], lamp, bin; /* meshes */
} pags_planting;
void pags_planting_make(pags_street *street, pags_dice *dice, pags_planting *out);
/* Places trees, lamps, signs and bins along both kerbs from begin_x to end_x; trees keep away from crossings. */
void pags_planting_add(pags_street *street, pags_dice *dice, const pags_planting *kinds);

typedef struct pags_person_kind {
  int body, arm, leg, bicycle; /* indices of meshes; bicycle -1: a pedestrian */
} pags_person_kind;
/* The meshes of all models of cars, pedestrians and cyclists; each actor is given one of them. */
typedef struct pags_cast {
  int cars[PAGS_CAR_KINDS];
  float car_sizes[PAGS_CAR_KINDS][3];
  pags_person_kind people[PAGS_PERSON_KINDS], riders[PAGS_RIDER_KINDS];
} pags_cast;
void pags_cast_make(pags_street *street, pags_cast *out);
/* Adds parked cars along both kerbs from begin_x to end_x; some bays stay empty. */
void pags_actors_park(pags_street *street, pags_dice *dice, const pags_cast *models);
/* Adds a pedestrian or, if `kind` has a bicycle, a cyclist. Role, size and placements of `actor` are filled in here,
 * the poses later by pags_street_set_time. */
void pags_actors_stand(pags_street *street, const pags_person_kind *kind, pags_actor actor);

/* Pose of the actor's box at `time` (seconds), world from box: x forward, y left, z up, origin in its middle. */
void pags_actor_pose(const pags_actor *actor, double time, double pose[12]);
/* Sets the poses of the placements of all moving actors to those at `time` (seconds). */
void pags_street_set_time(pags_street *street, double time);

/* Pose of the ego vehicle at `time`, world from ego: x forward, y left, z up, origin on the road below its rear
 * axle. */
void pags_street_ego(const pags_street_options *options, double time, double pose[12]);
/* The x coordinate of the ego vehicle at `time`, metres. */
double pags_street_ego_x(const pags_street_options *options, double time);
/* Pose of a camera in the ego frame (ego from camera), which is constant. Camera 0 looks ahead, 1 to the front left,
 * 2 to the front right. OpenCV axes: x right, y down, z forward. */
void pags_street_mount(int camera, double pose[12]);
/* The camera `camera` at `time`, shifted by `right` metres along its own x and `up` metres along the ego vehicle's
 * z. */
pags_camera pags_street_camera(const pags_street_options *options, double time, int camera, double right, double up);

/* ---- Writers of the text files of a street's data set: boxes, cameras, times, and the options ---- */

/* Gives a number to each actor that is labelled in some frame, because it is within 90 m of the ego vehicle there. */
void pags_street_number(pags_street *street);
/* Writes the boxes of all objects: instances/, with the noise of the options, and truth/instances/, exact. */
pags_result pags_street_write_instances(const pags_street *street, const char *folder);
pags_result pags_street_write_timestamps(const pags_street *street, const char *path);
pags_result pags_street_write_description(const pags_street *street, const char *path);
/* Writes a 4x4 matrix, one row a line. */
pags_result pags_street_write_pose(const char *path, const double pose[12]);
/* Writes fx fy cx cy and k1 k2 p1 p2 k3, of which all but k1 are 0; fx fy cx cy alone of a fisheye. */
pags_result pags_street_write_intrinsics(const char *path, const pags_camera *camera, double k1);

/* truth/street.json holds the options from which the same street can be built again. Reading takes the data set's
 * folder; without such a file *found is false and `out` the default options. */
pags_result pags_street_write_truth(const pags_street *street, const char *path);
pags_result pags_street_read_truth(const char *folder, pags_street_options *out, bool *found);

#endif
