/* SPDX-License-Identifier: Apache-2.0 */
/* Owners that destroy at the end of a scope (base/memory.h), for the types that drawing needs:
 *
 *   PAGS_AUTO(pags_frame_destroy_auto) pags_frame *frame = NULL;
 *   PAGS_TRY(pags_frame_create(tasks, &frame)); */
#ifndef PAGS_FRAME_OWNERS_H
#define PAGS_FRAME_OWNERS_H

#include <pags/compose.h>
#include <pags/deadline.h>
#include <pags/frame.h>
#include <pags/tasks.h>

#include "base/memory.h"

PAGS_DEFINE_AUTO(pags_tasks, pags_tasks_destroy)
PAGS_DEFINE_AUTO(pags_composition, pags_composition_destroy)
PAGS_DEFINE_AUTO(pags_frame, pags_frame_destroy)
PAGS_DEFINE_AUTO(pags_deadline, pags_deadline_destroy)

#endif
