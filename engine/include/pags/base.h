/* SPDX-License-Identifier: Apache-2.0 */
/* PAGS: Priority-Adaptive Gaussian Splatting on CPUs. This header holds the version, the result codes and error
 * messages, and the conventions that every other header of the C API relies on.
 *
 * Conventions of the whole API
 *   World      right-handed, metres. `up` is stated per scene: +z (driving data), -y (COLMAP, bare PLY), +y or unknown.
 *   Camera     OpenCV axes: x right, y down, z forward. Poses are `world_from_camera` in double.
 *   Pixels     the image's edges lie at 0 and width/height; the centre of pixel i lies at i + 0.5.
 *   Time       seconds, double.
 *   Quaternion (w, x, y, z); need not be of unit length: functions that read one normalise it.
 *   Gaussian   scales are stored as ln sigma (sigma in metres), opacity as a logit, colour as spherical harmonics of
 *              display-referred sRGB, exactly as the INRIA PLY stores them.
 *   Origin     every float position is relative to the double `origin` of its scene, so that UTM or ECEF coordinates
 *              lose no precision.
 *   Matrices   row-major; points are columns: p_world = M * p_camera.
 *
 * Errors. A function that can fail returns a pags_result. On failure it also stores one line of text for the calling
 * thread (pags_error_message), which names the file, the place in the file and what was expected. The library never
 * prints and never exits. A wrong argument that is a programming error (a NULL pointer, an index out of range) fails
 * an assert; wrong data never does.
 *
 * Threads. The library has no hidden state that its objects share. Two threads may use two objects at the same
 * time; one object may be used by one thread at a time unless its header says otherwise. */
#ifndef PAGS_BASE_H
#define PAGS_BASE_H

#include <stddef.h>
#include <stdint.h>

/* Between these, functions have C linkage in C++, too. */
#ifdef __cplusplus
#define PAGS_BEGIN_C extern "C" {
#define PAGS_END_C }
#else
#define PAGS_BEGIN_C
#define PAGS_END_C
#endif

/* Before a parameter that the type of a function demands and its body doesn't need. */
#define PAGS_UNUSED __attribute__((unused))

PAGS_BEGIN_C

#if defined(__GNUC__)
#define PAGS_API __attribute__((visibility("default")))
#if defined(__MINGW32__) && !defined(__clang__) /* where "printf" means the formats of Microsoft's old library */
#define PAGS_PRINTF(format_index, first_index) __attribute__((format(gnu_printf, format_index, first_index)))
#else
#define PAGS_PRINTF(format_index, first_index) __attribute__((format(printf, format_index, first_index)))
#endif
#else
#define PAGS_API
#define PAGS_PRINTF(format_index, first_index)
#endif

/* The version is written here alone: CMake, the packages and the add-on read it from these lines (docs/release.md). */
#define PAGS_VERSION_MAJOR 0
#define PAGS_VERSION_MINOR 2
#define PAGS_VERSION_PATCH 0
#define PAGS_VERSION_QUOTED(number) #number
#define PAGS_VERSION_DOTTED(major, minor, patch) \
  PAGS_VERSION_QUOTED(major) "." PAGS_VERSION_QUOTED(minor) "." PAGS_VERSION_QUOTED(patch)
#define PAGS_VERSION_STRING PAGS_VERSION_DOTTED(PAGS_VERSION_MAJOR, PAGS_VERSION_MINOR, PAGS_VERSION_PATCH)

typedef enum pags_result {
  PAGS_OK = 0,
  PAGS_ERROR_ARGUMENT,    /* a value lies outside of its documented range */
  PAGS_ERROR_IO,          /* a file can't be opened, read or written */
  PAGS_ERROR_FORMAT,      /* a file doesn't hold what its format requires */
  PAGS_ERROR_MEMORY,      /* an allocation failed */
  PAGS_ERROR_LIMIT,       /* a stated limit (a count or a size) would be exceeded */
  PAGS_ERROR_UNSUPPORTED, /* this build or this machine lacks a component; the message names the component */
  PAGS_CANCELLED          /* a callback or pags_tasks_cancel asked the work to stop */
} pags_result;

/* Stores one line of text as the calling thread's error message (printf style, at most 1023 bytes, no newline) and
 * returns `code`, so that a function can fail in one statement:
 *
 *     return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected a number", path, line);
 *
 * An argument may be the text of pags_error_message itself. */
PAGS_API pags_result pags_fail(pags_result code, const char *format, ...) PAGS_PRINTF(2, 3);

/* Returns the error message that the calling thread stored last, "" if it has stored none. Never NULL. The text
 * is valid until the next failing call on this thread. */
PAGS_API const char *pags_error_message(void);

/* Returns the name of a result code ("format error", "cancelled", ...), a static string. */
PAGS_API const char *pags_result_name(pags_result code);

/* Evaluates `call`, a pags_result, and returns it from the calling function unless it is PAGS_OK. */
#define PAGS_TRY(call)                    \
  do {                                    \
    pags_result pags_try_result = (call); \
    if (pags_try_result != PAGS_OK)       \
      return pags_try_result;             \
  } while (0)

/* The direction of the world that is up in a scene or data set: unknown, +z, -y or +y. */
typedef enum pags_up { PAGS_UP_UNKNOWN, PAGS_UP_Z, PAGS_UP_MINUS_Y, PAGS_UP_Y } pags_up;

/* A callback by which long work reports its progress. `fraction` is the share of the work that is done, 0..1;
 * `what` names the present stage of the work and is valid during the call only. Returning 0 cancels the work,
 * which then returns PAGS_CANCELLED; any other value continues it. */
typedef int pags_progress_fn(void *user, double fraction, const char *what);

PAGS_END_C
#endif
