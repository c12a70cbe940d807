/* Procedural scenes, ray-traced: data sets with known truth that need no download. */
#ifndef PAGS_SYNTH_H
#define PAGS_SYNTH_H

#include <pags/base.h>
#include <pags/tasks.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_synth_options {
  int width, height; /* px, 16..8192; default 360x240 */
  int views;         /* 3..10000, evenly around; default 36 */
  int samples;       /* rays a pixel, 1..1024; default 8 */
  int64_t points;    /* coloured surface points, 0..10^7; default 4000 */
  uint64_t seed;     /* of textures and points; default 0 */
  int depth;         /* 1: write the true depth, too. Default 0 */
  int overwrite;     /* 1: write into a folder that is not empty. Default 0 */
} pags_synth_options;

PAGS_API pags_synth_options pags_synth_options_default(void);

/* A courtyard of 8x8 m, z up, floor at z = 0, walls 3 m high at x, y = +-4, with boxes and balls about its middle,
 * seen from cameras that go around at 3.0 m from the z axis, 1.15 to 1.85 m high. Surfaces are Lambertian and lit by a
 * sun with hard shadows and a sky dome, so that every point has one colour from everywhere.
 *
 * Writes into `folder`, made if missing: images/0001.png ..., transforms.json (nerfstudio; pinhole without
 * distortion), points.ply and, if asked for, depth/0001.exr ... (channel Z: camera z in metres at the pixel's centre,
 * 0 for sky). transforms.json comes last: without it the folder is no data set. The same bytes for any number of
 * threads. `progress` may be NULL. Errors: PAGS_ERROR_ARGUMENT (an option out of range), _IO, _MEMORY, _UNSUPPORTED
 * (Embree or OpenImageIO failed), PAGS_CANCELLED. */
PAGS_API pags_result pags_synth_room(const char *folder, const pags_synth_options *options, pags_tasks *tasks,
                                     pags_progress_fn *progress, void *user);

#ifdef __cplusplus
}
#endif
#endif
