/* SPDX-License-Identifier: Apache-2.0 */
/* Renders pictures and writes their channels (colour, alpha, depth, ids, priorities, normals, passes) to PNG and EXR
 * files. */
#ifndef PAGS_CLI_PICTURE_H
#define PAGS_CLI_PICTURE_H

#include <pags/compose.h>
#include <pags/dataset.h>
#include <pags/image.h>
#include <pags/passes.h>
#include <pags/scene.h>
#include <pags/tasks.h>
#include <stdbool.h>

enum { PAGS_STEM = 600 }; /* room for the name of a picture, with the folders in it, and its end */

typedef enum pags_channel {
  PAGS_CHANNEL_COLOR,
  PAGS_CHANNEL_ALPHA,
  PAGS_CHANNEL_DEPTH,
  PAGS_CHANNEL_ID,
  PAGS_CHANNEL_OBJECT,
  PAGS_CHANNEL_PRIORITY,
  PAGS_CHANNEL_NORMAL,
  PAGS_CHANNEL_HEAT,
  PAGS_CHANNEL_CRYPTO_OBJECT, /* these six are passes (pags/passes.h) */
  PAGS_CHANNEL_CRYPTO_CLASS,
  PAGS_CHANNEL_EXPECTED_NORMAL,
  PAGS_CHANNEL_MOTION,
  PAGS_CHANNEL_BLENDED,
  PAGS_CHANNEL_OVERDRAW,
  PAGS_CHANNEL_COUNT
} pags_channel;

enum {
  PAGS_CHANNELS_PASSES = 1u << PAGS_CHANNEL_CRYPTO_OBJECT | 1u << PAGS_CHANNEL_CRYPTO_CLASS |
                         1u << PAGS_CHANNEL_EXPECTED_NORMAL | 1u << PAGS_CHANNEL_MOTION | 1u << PAGS_CHANNEL_BLENDED |
                         1u << PAGS_CHANNEL_OVERDRAW
};

/* Parses a list such as "color,depth" into a set of bits 1 << channel. Returns false if a word is not a channel's
 * name, with that word in `unknown`. */
bool pags_channels_parse(const char *list, unsigned *set, char *unknown, size_t unknown_size);

typedef enum pags_picture_format { PAGS_PICTURE_PNG, PAGS_PICTURE_EXR } pags_picture_format;

/* Which channels of a picture are written, and how. Colour and alpha go to NAME.png and NAME_alpha.png, or .exr;
 * depth (metres), id, object, priority, normal and passes always to NAME_depth.exr and so on, as float32; heat
 * (priority as a colour map) to NAME_heat.png. */
typedef struct pags_picture_writer {
  unsigned channels; /* bits 1 << pags_channel */
  pags_picture_format format;
  int bits;                   /* bits a PNG channel: 8 or 16 */
  int32_t *object_of;         /* object of each Gaussian id; NULL unless the object channel is written */
  float *priority_of;         /* priority of each Gaussian id; NULL unless priority or heat is written */
  pags_matte_names mattes[2]; /* objects, classes; empty unless their channels are written */
} pags_picture_writer;

/* Looks up the objects and priorities that the channels need. Returns PAGS_ERROR_LIMIT if float32 can't hold every id
 * exactly (--channel id), PAGS_ERROR_ARGUMENT if the scene has no priorities for the priority channels. `out` must be
 * destroyed on failure, too. */
pags_result pags_picture_writer_create(const pags_composition *composition, unsigned channels,
                                       pags_picture_format format, int bits, pags_picture_writer *out);
void pags_picture_writer_destroy(pags_picture_writer *writer);

/* Whether any channel needs the extra planes (depth and id) rendered. */
bool pags_picture_writer_needs_extras(const pags_picture_writer *writer);

/* Saves an image as `file` in `folder`. */
pags_result pags_image_save_in(const char *folder, const char *file, const pags_image *image);

/* Converts the colour planes to an image of 3 channels: F32 clamped to [0, 1], or U8 or U16 rounded. */
pags_result pags_picture_to_image(const pags_picture *picture, pags_sample sample, pags_image *out);

/* ---- Rendering ---- */

/* Renders the composition as it is at the camera's time. Errors of pags_frame_render. */
pags_result pags_picture_render(pags_composition *composition, pags_frame *frame, const pags_camera *camera,
                                const pags_frame_options *options, pags_picture *out);

/* Renders the same and calls `add` with the weight, the sum of alpha T over the pixels, of each Gaussian in view, once
 * each, from several threads at once. The same bits for any number of threads. */
typedef void pags_weight_fn(void *user, int64_t id, double weight);
pags_result pags_picture_weights(pags_composition *composition, pags_frame *frame, const pags_camera *camera,
                                 const pags_frame_options *options, pags_weight_fn *add, void *user);

/* ---- Names of pictures: unique, in any letter case ---- */

typedef struct pags_picture_names {
  int64_t count;
  char **items; /* names without folder and extension, in the order of the views */
} pags_picture_names;

/* A view is named after its photograph without extension: "cam0/DSC_01.JPG" is "cam0/DSC_01"; a name that leaves the
 * folder, "../DSC_01.JPG", is reduced to the part after the last slash. If an earlier view has that name (a.jpg and
 * a.png, or A.jpg), the extension stays, "a.png"; if that is taken as well, the number of the view follows, "a.png-12".
 * The views are those of a scene or of a data set, the other being NULL. `out` must be destroyed on failure, too. */
pags_result pags_picture_names_make(const pags_scene *scene, const pags_dataset *dataset, pags_picture_names *out);
void pags_picture_names_destroy(pags_picture_names *names);

/* ---- Channels computed from the planes ---- */

/* Computes unit normals of the surface that the depth plane describes, in world axes and facing the camera, into
 * three planes with the picture's stride. A normal is 0 at pixels without depth or without neighbours that have
 * depth. */
void pags_normals_from_depth(const pags_picture *picture, const pags_camera *camera, float *const out[3]);

/* ---- objects.json, the objects of --channel object ---- */

/* Writes `folder`/objects.json. */
pags_result pags_object_table_write(const pags_scene *scene, const char *folder);

/* ---- Passes of a sequence of pictures (pags/passes.h) for the channels of a picture writer ---- */

typedef struct pags_render_passes {
  pags_composition *composition;
  const pags_picture_writer *writer; /* its channels select the passes; both must outlive this */
  pags_moment moments[2];            /* before, after; their parts are `copies` */
  pags_part *copies[2];
  bool known[2];
  int32_t *names[2];   /* per part: its name in the mattes of objects and classes */
  int64_t capacity[4]; /* parts that the copies and the names have room for */
} pags_render_passes;

/* Composes the scene at the time of the neighbouring camera (side 0: before, 1: after), for motion; NULL: no motion on
 * that side. It uses the composition's parts, so compose the picture itself afterwards. */
pags_result pags_render_passes_moment(pags_render_passes *passes, int side, const pags_camera *camera);
/* Computes the passes of the picture that `frame` has drawn of these parts, as composed by pags_compose. */
pags_result pags_render_passes_draw(pags_render_passes *passes, pags_frame *frame, const pags_part *parts,
                                    int part_count, pags_passes *out);
/* Frees the memory. A zeroed struct is allowed. */
void pags_render_passes_destroy(pags_render_passes *passes);

/* ---- Queue of rendered pictures to be written: gathers one picture per worker thread, then encodes and writes all in
 * parallel. Writing doesn't overlap rendering, since it would distort the measured render times. ---- */

typedef struct pags_picture_slot pags_picture_slot;

typedef struct pags_picture_queue {
  const pags_picture_writer *writer;
  pags_tasks *tasks;
  const char *folder;
  int count, used; /* number of slots; slots that hold a picture */
  pags_picture_slot *slots;
} pags_picture_queue;

/* `writer`, `tasks` and `folder` must outlive the queue. */
pags_result pags_picture_queue_create(const pags_picture_writer *writer, pags_tasks *tasks, const char *folder,
                                      pags_picture_queue *out);
/* Frees the queue and drops pictures that aren't written yet. A zeroed struct is allowed. */
void pags_picture_queue_destroy(pags_picture_queue *queue);

/* Adds a copy of the picture and its passes. If the queue is full then, writes all its pictures and returns the first
 * error. */
pags_result pags_picture_queue_put(pags_picture_queue *queue, const pags_picture *picture, const pags_passes *passes,
                                   const pags_camera *camera, const char *name);

/* Writes the pictures in the queue, even if the tasks were cancelled. */
pags_result pags_picture_queue_finish(pags_picture_queue *queue);

#endif
