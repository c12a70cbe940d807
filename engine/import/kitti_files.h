/* SPDX-License-Identifier: Apache-2.0 */
/* Readers of KITTI's single files (A. Geiger, P. Lenz, C. Stiller, R. Urtasun: Vision meets Robotics: The KITTI
 * Dataset, IJRR 2013, and the readme files of its development kits).
 *
 * Frames of reference: imu and velo (x forward, y left, z up), cam0 (the rectified reference camera: x right, y down,
 * z forward). Every error message names file and line. */
#ifndef PAGS_IMPORT_KITTI_FILES_H
#define PAGS_IMPORT_KITTI_FILES_H

#include <pags/base.h>
#include <pags/place.h>
#include <stdbool.h>

/* ---- Words of a text ---- */

/* Parse a whole word as a finite number, or as an integer of lo..hi; false if it is not. */
bool pags_word_number(const char *word, double *out);
bool pags_word_integer(const char *word, int64_t lo, int64_t hi, int64_t *out);

/* ---- Rows of numbers: oxts, poses, unlabelled calibrations ---- */

typedef struct pags_kitti_table {
  int64_t rows;
  int columns;
  double *values; /* row-major; freed by pags_kitti_table_destroy */
} pags_kitti_table;

/* Reads a table of numbers: every line has `columns` finite numbers, empty lines are allowed only at the end, and
 * there is at least one row. */
pags_result pags_kitti_table_read(const char *path, int columns, pags_kitti_table *out);
void pags_kitti_table_destroy(pags_kitti_table *table);

/* ---- Calibration ---- */

typedef struct pags_kitti_calib {
  double projection[4][12]; /* P0..P3 (raw: P_rect_00..): pixel = P * cam0, with the first pixel's centre at 0 */
  double size[4][2]; /* raw: width and height of the rectified pictures, px (S_rect_00..); 0: the file doesn't say */
  double cam0_from_velo[12]; /* with an exactly orthonormal rotation */
  double velo_from_imu[12];
  bool has_imu; /* whether velo_from_imu is known; older files of the object benchmark lack it */
} pags_kitti_calib;

/* Reads calib/SSSS.txt of the tracking benchmark or calib/NNNNNN.txt of the object benchmark. */
pags_result pags_kitti_calib_read(const char *path, pags_kitti_calib *out);
/* Reads calib_cam_to_cam.txt, calib_velo_to_cam.txt and calib_imu_to_velo.txt in the day's folder of a raw
 * recording. */
pags_result pags_kitti_calib_read_raw(const char *folder, pags_kitti_calib *out);

/* Computes the intrinsics (fx fy cx cy in pixels, corner of the picture at 0) and the pose of camera `index` (0..3)
 * of a rectified set. All cameras have the orientation of cam0; P = K [I | t] puts the camera at -t. */
pags_result pags_kitti_camera(const pags_kitti_calib *calib, int index, double intrinsics[4],
                              double cam0_from_camera[12]);

/* ---- oxts: GPS and inertial measurement unit (IMU) ---- */

enum { PAGS_KITTI_OXTS = 30 };
/* Columns of an oxts row. VN VE VF VL VU: velocity to the north, east, front, left and up; WX WY WZ: about the IMU's
 * axes. */
enum { PAGS_OXTS_LAT, PAGS_OXTS_LON, PAGS_OXTS_ALT };                              /* degrees, degrees, m */
enum { PAGS_OXTS_ROLL = 3, PAGS_OXTS_PITCH, PAGS_OXTS_YAW };                       /* radians */
enum { PAGS_OXTS_VN = 6, PAGS_OXTS_VE, PAGS_OXTS_VF, PAGS_OXTS_VL, PAGS_OXTS_VU }; /* m/s */
enum { PAGS_OXTS_WX = 17, PAGS_OXTS_WY, PAGS_OXTS_WZ };                            /* rad/s */
enum { PAGS_OXTS_ACCURACY = 23 };                                                  /* of the position, m */

/* Computes the pose of the IMU in east, north, up with the Mercator projection of KITTI's development kit; `scale` =
 * cos(latitude of the sequence's first row). */
void pags_kitti_oxts_pose(const double oxts[PAGS_KITTI_OXTS], double scale, double out[12]);
double pags_kitti_oxts_scale(const double first[PAGS_KITTI_OXTS]);
/* Inverse of that projection: converts a position in metres to latitude, longitude and altitude. */
pags_place pags_kitti_place(const double position[3], double scale);

/* ---- Labels ---- */

typedef struct pags_kitti_label {
  int frame, track; /* both -1 in the object benchmark; track -1: DontCare */
  char type[32];
  double box[4];                /* left top right bottom, px */
  double height, width, length; /* m */
  double bottom[3];             /* centre of the bottom face in cam0, m */
  double rotation_y;            /* radians about cam0's y axis; 0: the object faces along x */
  double score;                 /* of a detector or tracker, any unit; see `scored` */
  bool scored;                  /* whether the line has a score as its last column */
  int line;
} pags_kitti_label;

typedef struct pags_kitti_labels {
  int64_t count;
  pags_kitti_label *rows;
} pags_kitti_labels;

/* Reads label_02/SSSS.txt (`tracking`) or label_2/NNNNNN.txt. An empty file has no labels and is valid. Sizes, places
 * and angles that can't be metres and radians are PAGS_ERROR_FORMAT; a label without a size in space isn't. */
pags_result pags_kitti_labels_read(const char *path, bool tracking, pags_kitti_labels *out);
void pags_kitti_labels_destroy(pags_kitti_labels *labels);
bool pags_kitti_label_is_box(const pags_kitti_label *label);     /* false for DontCare regions */
bool pags_kitti_label_has_volume(const pags_kitti_label *label); /* false for labels in the picture only */
/* Computes the pose of the box in cam0: object axes x forward, y left, z up, origin at the centre of the box. */
void pags_kitti_label_pose(const pags_kitti_label *label, double cam0_from_object[12]);

/* ---- tracklet_labels.xml of raw recordings ---- */

typedef struct pags_kitti_tracklet {
  char type[32];
  double height, width, length; /* m; may be 0 or less, which is no size */
  int64_t first_frame;
  int64_t count;
  double (*poses)[6]; /* per frame: tx ty tz (m, velo, centre of the bottom face), rx ry rz (radians) */
} pags_kitti_tracklet;

typedef struct pags_kitti_tracklets {
  int64_t count;
  pags_kitti_tracklet *items;
} pags_kitti_tracklets;

pags_result pags_kitti_tracklets_read(const char *path, pags_kitti_tracklets *out);
void pags_kitti_tracklets_destroy(pags_kitti_tracklets *tracklets);
/* Computes the pose of the box in velo, with the object axes and the origin of pags_kitti_label_pose. */
void pags_kitti_tracklet_pose(const pags_kitti_tracklet *tracklet, int64_t index, double velo_from_object[12]);

/* ---- Points and times ---- */

/* The form of a sweep's rows. KITTI's: x y z reflectance, float32, metres. */
typedef struct pags_kitti_form {
  int columns;  /* 3 to 5: x, y, z, reflectance, ring */
  int width;    /* bytes of a number: 4 or 8 */
  double scale; /* metres per unit */
} pags_kitti_form;

/* Finds the form of a sweep by its numbers. PAGS_ERROR_FORMAT if no LiDAR measures such numbers, or places in the
 * world's axes. */
pags_result pags_kitti_form_find(const char *path, pags_kitti_form *out);
bool pags_kitti_form_is_usual(const pags_kitti_form *form);
/* Reads a sweep as rows of x y z reflectance in velo, metres; the reflectance is 0 if the file has none. The caller
 * frees *xyzr. */
pags_result pags_kitti_points_read(const char *path, const pags_kitti_form *form, int64_t *count, float **xyzr);

/* Reads timestamps.txt of a raw recording, lines like "2011-09-26 13:02:25.594360375", as seconds since 1970; the
 * clock is taken as UTC, whatever it was. An empty line represents a time that was lost, as in drives with
 * lost sweeps: it becomes NaN, and the lines behind it keep their numbers. Empty lines at the end aren't counted. The
 * caller frees *seconds. */
pags_result pags_kitti_times_read(const char *path, int64_t *count, double **seconds);

#endif
