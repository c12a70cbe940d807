/* SPDX-License-Identifier: Apache-2.0 */
/* PAGS: Priority-Adaptive Gaussian Splatting on CPUs.
 *
 * Conventions of the whole API
 *   World      right-handed, metres. `up` is stated per scene: +z (driving data), -y (COLMAP, bare PLY) or unknown.
 *   Camera     OpenCV axes: x right, y down, z forward. Poses are `world_from_camera` in double.
 *   Pixels     image corners lie at 0 and width/height; the centre of pixel i lies at i + 0.5.
 *   Time       seconds, double.
 *   Quaternion (w, x, y, z); need not be of unit length: users normalise.
 *   Gaussian   scales are stored as ln sigma (metres), opacity as a logit, colour as spherical harmonics of
 *              display-referred sRGB, exactly as the INRIA PLY stores them.
 *   Origin     every float position is relative to the double `origin` of its scene, so that UTM or ECEF coordinates
 *              lose nothing.
 *   Matrices   row-major; points are columns: p_world = M * p_camera.
 *
 * Errors. A function that can fail returns a pags_result and leaves one line of text for the calling thread, which
 * names the file, the place in it and what was expected. Nothing in the library prints or exits. A wrong argument of
 * the programmer's asserts; wrong data never does.
 *
 * Threads. Objects have no hidden global state. Two threads may use two objects at once; one object belongs to one
 * thread at a time unless its header says otherwise. */
#ifndef PAGS_BASE_H
#define PAGS_BASE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define PAGS_API __attribute__((visibility("default")))
#define PAGS_PRINTF(format_index, first_index) __attribute__((format(printf, format_index, first_index)))
#else
#define PAGS_API
#define PAGS_PRINTF(format_index, first_index)
#endif

#define PAGS_VERSION_MAJOR 0
#define PAGS_VERSION_MINOR 1
#define PAGS_VERSION_PATCH 0
#define PAGS_VERSION_STRING "0.1.0"

typedef enum pags_result {
  PAGS_OK = 0,
  PAGS_ERROR_ARGUMENT,    /* a value outside of its documented range */
  PAGS_ERROR_IO,          /* a file can't be opened, read or written */
  PAGS_ERROR_FORMAT,      /* a file doesn't hold what its format asks for */
  PAGS_ERROR_MEMORY,      /* an allocation failed */
  PAGS_ERROR_LIMIT,       /* a stated limit (count, size, budget) would be exceeded */
  PAGS_ERROR_UNSUPPORTED, /* this build or this machine lacks a part; the message says which */
  PAGS_CANCELLED          /* a callback or pags_tasks_cancel asked to stop */
} pags_result;

/* Stores one line for the calling thread (printf style, at most 1023 bytes, no newline) and returns `code`, so that
 * `return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected a number", path, line);` reads as what it does. */
PAGS_API pags_result pags_fail(pags_result code, const char *format, ...) PAGS_PRINTF(2, 3);

/* The last line stored by this thread; never NULL, valid until this thread's next failing call. */
PAGS_API const char *pags_error_message(void);

/* "format error", "cancelled", ...; static strings. */
PAGS_API const char *pags_result_name(pags_result code);

/* Returns from the calling function with the result of `call` unless it is PAGS_OK. */
#define PAGS_TRY(call)                    \
  do {                                    \
    pags_result pags_try_result = (call); \
    if (pags_try_result != PAGS_OK)       \
      return pags_try_result;             \
  } while (0)

/* Which way is up in a scene or data set. */
typedef enum pags_up { PAGS_UP_UNKNOWN, PAGS_UP_Z, PAGS_UP_MINUS_Y } pags_up;

/* Long work reports through this. `fraction` lies in [0, 1]; returning 0 cancels with PAGS_CANCELLED. */
typedef int pags_progress_fn(void *user, double fraction, const char *what);

#ifdef __cplusplus
}
#endif
#endif
