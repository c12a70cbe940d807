/* SPDX-License-Identifier: Apache-2.0 */
/* What is wrong with the cameras of a synthetic street (pags_street_faults): when and where a photograph was really
 * taken, and what the data set says about it. Chance depends on the street's seed alone. */
#ifndef PAGS_SYNTH_FAULTS_H
#define PAGS_SYNTH_FAULTS_H

#include "base/json.h"
#include "synth/street.h"

/* Number of lines of a photograph that are read one after the other: rows or columns; 1 with a global shutter. */
int pags_faults_lines(const pags_street_options *options);
bool pags_faults_reads_rows(const pags_street_options *options); /* these lines are rows */
/* A camera of the car as it really is when it reads line `line` in the time step `frame`; line -1: in the middle of the
 * exposure. */
pags_camera pags_faults_camera(const pags_street_options *options, int frame, int camera, int line);

/* The pose of the car at a time step, world from ego, as the data set has it. */
void pags_faults_ego(const pags_street_options *options, int frame, double pose[12]);
/* The pose of a camera in the car, ego from camera, as the data set has it. */
void pags_faults_mount(const pags_street_options *options, int camera, double pose[12]);

/* Share of the light of the lens's axis that arrives at the image position (x, y), pixels. */
float pags_faults_vignette(const pags_street_options *options, double x, double y);
/* Exponent of a camera's response curve: a display-referred value v becomes v to that power. */
float pags_faults_response(const pags_street_options *options, int camera);

/* Sets `direction` to the direction, in the camera's frame, of the ray through the image position (x, y), pixels,
 * with z = 1, or of unit length through a fisheye. Returns whether the lens sees there. */
bool pags_faults_ray(const pags_street_options *options, const pags_camera *camera, double x, double y,
                     double direction[3]);

/* Checks the range of each fault. */
pags_result pags_faults_check(const pags_street_faults *faults);
/* Writes the member "faults", an object with the faults that are not 0. */
void pags_faults_to_json(pags_json_writer *writer, const pags_street_faults *faults);

#endif
