/* SPDX-License-Identifier: Apache-2.0 */
/* Includes the header of Embree 3 or 4, whichever CMake found, and turns Embree's error codes into results. For the two
 * files that use Embree: synth/stage.c traces rays, exporters/proxy/mesh_query.c finds nearest points. */
#ifndef PAGS_BASE_EMBREE_H
#define PAGS_BASE_EMBREE_H

#include <pags/base.h>

#include "base/memory.h"

#if PAGS_EMBREE >= 4 /* major version, from CMake */
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

/* A device that builds on one thread: it makes the same tree every time, and with it the same choice between two
 * primitives that are equally near. NULL on failure. */
static inline RTCDevice pags_embree_device(void) {
  return rtcNewDevice("threads=1");
}

/* PAGS_OK, or the device's last error; NULL: that of creating a device. */
static inline pags_result pags_embree_check(RTCDevice device) {
  const enum RTCError code = rtcGetDeviceError(device);
  if (code == RTC_ERROR_NONE)
    return PAGS_OK;
  if (code == RTC_ERROR_OUT_OF_MEMORY)
    return pags_out_of_memory("Embree");
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "Embree failed with error %d", (int)code);
}

/* As pags_embree_check, for a call that returned NULL: an error even where the device reports none. */
static inline pags_result pags_embree_failed(RTCDevice device) {
  const pags_result result = pags_embree_check(device);
  return result != PAGS_OK ? result : pags_fail(PAGS_ERROR_UNSUPPORTED, "Embree failed without an error code");
}

#endif
