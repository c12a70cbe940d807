/* SPDX-License-Identifier: Apache-2.0 */
/* Includes the header of Embree 3 or 4, whichever was found, and turns Embree's error codes into results. Only
 * stage.c uses Embree. */
#ifndef PAGS_SYNTH_EMBREE_H
#define PAGS_SYNTH_EMBREE_H

#include <pags/base.h>

#include "base/memory.h"

#if PAGS_EMBREE >= 4 /* major version, from CMake */
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

static inline pags_result pags_embree_failed(RTCDevice device) {
  const enum RTCError code = rtcGetDeviceError(device);
  if (code == RTC_ERROR_OUT_OF_MEMORY)
    return pags_out_of_memory("Embree");
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "Embree failed with error %d", (int)code);
}

#endif
