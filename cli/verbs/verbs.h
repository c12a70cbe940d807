/* SPDX-License-Identifier: Apache-2.0 */
/* The verbs of pags: each takes its arguments (without program and verb) and returns the exit code. Also the options
 * that several of them share. */
#ifndef PAGS_CLI_VERBS_H
#define PAGS_CLI_VERBS_H

#include "cli/common/session.h"

int pags_verb_train(int argc, char **argv);
int pags_verb_render(int argc, char **argv);
int pags_verb_eval(int argc, char **argv);
int pags_verb_export(int argc, char **argv);
int pags_verb_info(int argc, char **argv);
int pags_verb_import(int argc, char **argv);
int pags_verb_synth(int argc, char **argv);
int pags_verb_split(int argc, char **argv);
int pags_verb_merge(int argc, char **argv);
int pags_verb_report(int argc, char **argv);
int pags_verb_view(int argc, char **argv);

/* Rows for verbs that open photographs; `where` is the offset of a pags_dataset_options in the verb's struct. */
#define PAGS_PHOTOGRAPH_OPTIONS(where, standard)                                                                 \
  PAGS_TEXT("image-folder", 0, (where) + offsetof(pags_dataset_options, image_folder), "FOLDER", standard,       \
            "Read the photographs from this folder; intrinsics are scaled."),                                    \
      PAGS_CHOICE("image-alpha", (where) + offsetof(pags_dataset_options, image_alpha), "composite|mask|ignore", \
                  standard, "Blend alpha over --background, use it as a mask, or ignore it.")

/* Rows for verbs that open driving sets; `where` is the offset of a pags_dataset_options in the verb's struct. */
#define PAGS_DRIVING_OPTIONS(where)                                                                                   \
  PAGS_TEXT("kind", 0, (where) + offsetof(pags_dataset_options, kind),                                                \
            "waymo|pandaset|kitti|nuscenes|argoverse2|nuplan|street-gaussians", "from dataset.json",                  \
            "Source, which selects the layout rules."),                                                               \
      PAGS_TEXT("cameras", 0, (where) + offsetof(pags_dataset_options, cameras), "LIST", "all",                       \
                "Cameras to use, separated by commas."),                                                              \
      PAGS_VALUE("frames", 0, SPAN, (where) + offsetof(pags_dataset_options, frame_first), 0, 0, "A-B", "time steps", \
                 "all", "Time steps to use, both ends included."),                                                    \
      PAGS_TEXT("holdout-camera", 0, (where) + offsetof(pags_dataset_options, holdout_camera), "N", "none",           \
                "Hold out all photographs of this camera."),                                                          \
      PAGS_TEXT("ego-mask", 0, (where) + offsetof(pags_dataset_options, ego_mask), "FILE|FOLDER",                     \
                "ego_masks/C.png, else detected", "Mask of the recording car; white pixels are excluded."),           \
      PAGS_TEXT("critical", 0, (where) + offsetof(pags_dataset_options, critical), "LIST",                            \
                "vehicle,pedestrian,cyclist", "Critical categories or classes."),                                     \
      PAGS_TEXT("sfm", 0, (where) + offsetof(pags_dataset_options, sfm), "FOLDER", "",                                \
                "Add the points of this COLMAP model, in the same world frame.")

#endif
