/* Objects: what their class names mean, whether they move, where they are at a time.
 *
 * The pose used is label(t) * Exp(increment(t)). Labels are interpolated on their own (translation linear, rotation along the shorter
 * arc of quaternions) and increments linearly in their six numbers between trained knots, so that a held-out knot keeps its label
 * and takes its correction from its neighbours. */
#include <pags/object.h>

#include <pags/camera.h>

#include <assert.h>
#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Two times are the same: a tenth of the shortest shutter, and four steps of a double at Unix time. */
static const double same_time = 1e-6;

/* Categories. */

const char *pags_category_name(pags_category category) {
  static const char *const names[] = {"other", "vehicle", "pedestrian", "cyclist"};
  assert((unsigned)category < sizeof names / sizeof *names);
  return names[category];
}

/* Class names as the data sets' documents list them, lower case, everything but letters and digits a single blank. */
static const char *const vehicles[] = {
    /* Waymo, nuPlan; KITTI */
    "vehicle", "type vehicle", "car", "van", "truck", "tram",
    /* PandaSet */
    "pickup truck", "medium sized truck", "semi truck", "towed object", "other vehicle",
    "other vehicle construction vehicle", "other vehicle uncommon", "emergency vehicle", "bus", "train", "trolley",
    "tram subway",
    /* nuScenes: by its prefix "vehicle"; short names of its detection task */
    "construction vehicle", "trailer",
    /* Argoverse 2 */
    "regular vehicle", "large vehicle", "box truck", "truck cab", "vehicular trailer", "school bus", "articulated bus",
    "message board trailer", "traffic light trailer", "railed vehicle"};

static const char *const pedestrians[] = {
    "pedestrian", "type pedestrian",        "person",           "person sitting", "wheelchair",
    "stroller",   "pedestrian with object", "official signaler"};

static const char *const cyclists[] = {"cyclist",
                                       "type cyclist",
                                       "bicycle",
                                       "motorcycle",
                                       "motorized scooter",
                                       "personal mobility device",
                                       "other vehicle pedicab",
                                       "bicyclist",
                                       "motorcyclist",
                                       "wheeled rider",
                                       "wheeled device",
                                       "rider",
                                       "vehicle bicycle",
                                       "vehicle motorcycle"};

enum { NAME_LENGTH = 64 };

static void normalise(const char *name, char out[NAME_LENGTH]) {
  size_t length = 0;
  for (; *name && length < NAME_LENGTH - 1; name++) {
    unsigned char c = (unsigned char)*name;
    if (isalnum(c))
      out[length++] = (char)tolower(c);
    else if (length > 0 && out[length - 1] != ' ')
      out[length++] = ' ';
  }
  while (length > 0 && out[length - 1] == ' ')
    length--;
  out[length] = '\0';
}

static int is_listed(const char *name, const char *const *list, size_t count) {
  for (size_t i = 0; i < count; i++)
    if (strcmp(name, list[i]) == 0)
      return 1;
  return 0;
}

static int begins(const char *name, const char *prefix) {
  return strncmp(name, prefix, strlen(prefix)) == 0;
}

#define LISTED(name, list) is_listed(name, list, sizeof(list) / sizeof *(list))

pags_category pags_category_of(const char *class_name) {
  char name[NAME_LENGTH];
  normalise(class_name, name);
  if (LISTED(name, cyclists))
    return PAGS_CATEGORY_CYCLIST;
  if (LISTED(name, pedestrians) || begins(name, "human pedestrian"))
    return PAGS_CATEGORY_PEDESTRIAN;
  if (LISTED(name, vehicles) || begins(name, "vehicle "))
    return PAGS_CATEGORY_VEHICLE;
  return PAGS_CATEGORY_OTHER;
}

/* Motion. */

void pags_object_destroy(pags_object *object) {
  free(object->id);
  free(object->class_name);
  free(object->knots);
  memset(object, 0, sizeof *object);
}

/* Street Gaussians' rule (facts 2.1): the distance between the first and the last position, and the positions' standard deviation. */
void pags_object_classify_motion(pags_object *object) {
  assert(object->knot_count > 0);
  const double *first = object->knots[0].world_from_object;
  const double *last = object->knots[object->knot_count - 1].world_from_object;
  double travel = 0, largest = 0, count = (double)object->knot_count;
  for (int axis = 3; axis < 12; axis += 4) {
    double mean = 0, square = 0;
    for (int64_t i = 0; i < object->knot_count; i++)
      mean += (object->knots[i].world_from_object[axis] - first[axis]) / count;
    for (int64_t i = 0; i < object->knot_count; i++) {
      double d = object->knots[i].world_from_object[axis] - first[axis] - mean;
      square += d * d / count;
    }
    travel += (last[axis] - first[axis]) * (last[axis] - first[axis]);
    largest = fmax(largest, square);
  }
  object->moving = sqrt(travel) > 2 || sqrt(largest) > 0.5;
}

/* Poses. */

/* Exp([r]x) = I + sin a / a [r]x + (1 - cos a) / a^2 [r]x^2, a = |r| (Rodrigues); near 0 by its series. */
void pags_increment_matrix(const double rotation[3], const double translation[3], double out[12]) {
  double x = rotation[0], y = rotation[1], z = rotation[2];
  double square = x * x + y * y + z * z, angle = sqrt(square), half = sin(0.5 * angle);
  double s = angle < 1e-4 ? 1 - square / 6 : sin(angle) / angle;
  double c = angle < 1e-4 ? 0.5 - square / 24 : 2 * half * half / square;
  const double turn[9] = {1 - c * (y * y + z * z), c * x * y - s * z,       c * x * z + s * y,
                          c * x * y + s * z,       1 - c * (x * x + z * z), c * y * z - s * x,
                          c * x * z - s * y,       c * y * z + s * x,       1 - c * (x * x + y * y)};
  for (int i = 0; i < 3; i++) {
    memcpy(out + 4 * i, turn + 3 * i, 3 * sizeof *turn);
    out[4 * i + 3] = translation[i];
  }
}

static void quaternion_of(const double m[12], double q[4]) {
  const double r[9] = {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
  pags_quaternion_from_rotation(r, q);
}

/* Along the shorter arc; where that is below 1e-3 rad a straight line differs by less than 1e-10. */
static void interpolate_rotation(const double a[4], const double b[4], double share, double out[4]) {
  double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
  double sign = dot < 0 ? -1 : 1, angle = acos(fmin(fabs(dot), 1)), sine = sin(angle);
  double from = angle < 1e-3 ? 1 - share : sin((1 - share) * angle) / sine;
  double to = angle < 1e-3 ? share : sin(share * angle) / sine;
  for (int i = 0; i < 4; i++)
    out[i] = from * a[i] + sign * to * b[i];
}

static void interpolate_pose(const double a[12], const double b[12], double share, double out[12]) {
  double from[4], to[4], q[4], r[9];
  quaternion_of(a, from);
  quaternion_of(b, to);
  interpolate_rotation(from, to, share, q);
  pags_rotation_from_quaternion(q, r);
  for (int i = 0; i < 3; i++) {
    memcpy(out + 4 * i, r + 3 * i, 3 * sizeof *r);
    out[4 * i + 3] = (1 - share) * a[4 * i + 3] + share * b[4 * i + 3];
  }
}

/* Whether the median spacing of the knots (of an even number the upper middle one) is at least `length`: counting says it without
 * sorting. One knot alone has no spacing. */
static int median_reaches(const pags_object *object, double length) {
  int64_t spacings = object->knot_count - 1, shorter = 0;
  for (int64_t i = 0; i < spacings; i++)
    shorter += object->knots[i + 1].time - object->knots[i].time < length - same_time;
  return spacings > 0 && shorter <= spacings / 2;
}

/* The number of knots at or before `time`. */
static int64_t knots_until(const pags_object *object, double time) {
  int64_t low = 0, high = object->knot_count;
  while (low < high) {
    int64_t middle = low + (high - low) / 2;
    if (object->knots[middle].time <= time)
      low = middle + 1;
    else
      high = middle;
  }
  return low;
}

/* The label at `time`, `after` knots lying at or before it. */
static int label_at(const pags_object *object, double time, int64_t after, double out[12]) {
  const pags_knot *before = after > 0 ? &object->knots[after - 1] : NULL;
  const pags_knot *behind = after < object->knot_count ? &object->knots[after] : NULL;
  double since = before ? time - before->time : INFINITY, until = behind ? behind->time - time : INFINITY;
  const pags_knot *nearest = since <= until ? before : behind;
  double distance = fmin(since, until);
  if (!(distance < INFINITY)) /* a time that is no number */
    return 0;
  if (distance > same_time && before && behind && median_reaches(object, (since + until) / 1.5))
    interpolate_pose(before->world_from_object, behind->world_from_object, since / (since + until), out);
  else if (distance <= same_time || median_reaches(object, 2 * distance))
    memcpy(out, nearest->world_from_object, 12 * sizeof *out);
  else
    return 0;
  return 1;
}

static const pags_knot *trained_before(const pags_object *object, double time, int64_t after) {
  if (after < object->knot_count && object->knots[after].time - time <= same_time)
    after++;
  for (int64_t i = after - 1; i >= 0; i--)
    if (object->knots[i].trained)
      return &object->knots[i];
  return NULL;
}

static const pags_knot *trained_behind(const pags_object *object, double time, int64_t after) {
  if (after > 0 && time - object->knots[after - 1].time <= same_time)
    after--;
  for (int64_t i = after; i < object->knot_count; i++)
    if (object->knots[i].trained)
      return &object->knots[i];
  return NULL;
}

/* Says whether there is an increment other than zero. */
static int increment_at(const pags_object *object, double time, int64_t after, double increment[6]) {
  const pags_knot *a = trained_before(object, time, after), *b = trained_behind(object, time, after);
  int any = 0;
  if (!a && !b)
    return 0;
  a = a ? a : b;
  b = b ? b : a;
  double gap = b->time - a->time;
  double share = gap > 0 ? fmin(fmax((time - a->time) / gap, 0), 1) : 0;
  for (int i = 0; i < 3; i++) {
    increment[i] = (1 - share) * a->rotation[i] + share * b->rotation[i];
    increment[3 + i] = (1 - share) * a->translation[i] + share * b->translation[i];
    any = any || increment[i] != 0 || increment[3 + i] != 0;
  }
  return any;
}

const pags_knot *pags_object_knot(const pags_object *object, int64_t frame) {
  for (int64_t i = 0; i < object->knot_count; ++i)
    if (object->knots[i].frame == frame)
      return &object->knots[i];
  return NULL;
}

int pags_object_pose(const pags_object *object, double time, double out[12]) {
  int64_t after = knots_until(object, time);
  double increment[6], motion[12];
  if (!label_at(object, time, after, out))
    return 0;
  if (increment_at(object, time, after, increment)) {
    pags_increment_matrix(increment, increment + 3, motion);
    pags_rigid_multiply(out, motion, out);
  }
  return 1;
}
