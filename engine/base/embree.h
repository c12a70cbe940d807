/* SPDX-License-Identifier: Apache-2.0 */
/* Includes the header of Embree 3 or 4, whichever CMake found, and turns Embree's error codes into results. For the
 * two files that use Embree: synth/stage.c traces rays, exporters/proxy/mesh_query.c finds nearest points. */
#ifndef PAGS_BASE_EMBREE_H
#define PAGS_BASE_EMBREE_H

#include <pags/base.h>

#include "base/memory.h"

#if PAGS_EMBREE >= 4 /* major version, from CMake */
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

/* Creates an Embree device that builds on one thread: it then builds the same tree every time, and of two primitives
 * that are equally near, queries always find the same one. NULL on failure. */
static inline RTCDevice pags_embree_device(void) {
  return rtcNewDevice("threads=1");
}

/* Returns PAGS_OK or fails with the last error of `device`; NULL: with that of the last attempt to create a
 * device. */
static inline pags_result pags_embree_check(RTCDevice device) {
  const enum RTCError code = rtcGetDeviceError(device);
  if (code == RTC_ERROR_NONE)
    return PAGS_OK;
  if (code == RTC_ERROR_OUT_OF_MEMORY)
    return pags_out_of_memory("Embree");
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "Embree failed with error %d", (int)code);
}

/* For an Embree call that returned NULL: fails like pags_embree_check, but also if the device reports no error. */
static inline pags_result pags_embree_failed(RTCDevice device) {
  const pags_result result = pags_embree_check(device);
  return result != PAGS_OK ? result : pags_fail(PAGS_ERROR_UNSUPPORTED, "Embree failed without an error code");
}

#endif
