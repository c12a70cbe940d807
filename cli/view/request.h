/* SPDX-License-Identifier: Apache-2.0 */
/* What a page asks for: one JSON object a message. Anything may come; what is accepted is within the bounds below. */
#ifndef PAGS_CLI_VIEW_REQUEST_H
#define PAGS_CLI_VIEW_REQUEST_H

#include <pags/camera.h>
#include <stdbool.h>

enum {
  PAGS_VIEW_MESSAGE = 16384, /* bytes of a message, at most */
  PAGS_VIEW_SIDE = 2048,     /* pixels a side of a picture, at most */
  PAGS_VIEW_HIDDEN = 1024    /* objects that can be hidden at once */
};

typedef enum pags_view_channel {
  PAGS_VIEW_COLOR,
  PAGS_VIEW_DEPTH,    /* near is bright; metres by a logarithm */
  PAGS_VIEW_PRIORITY, /* as heat */
  PAGS_VIEW_CRITICAL, /* what isn't critical is grey */
  PAGS_VIEW_OBJECT,   /* a colour an object */
  PAGS_VIEW_SIZE,     /* of Gaussians as heat; metres by a logarithm */
  PAGS_VIEW_PHOTOGRAPH,
  PAGS_VIEW_DIFFERENCE, /* |picture - photograph|, three times */
  PAGS_VIEW_CHANNELS
} pags_view_channel;

/* What is looked at. */
typedef struct pags_view_look {
  pags_camera camera; /* checked; at most PAGS_VIEW_SIDE a side; time NaN: the scene's begin */
  pags_view_channel channel;
  int64_t view; /* recorded view of PHOTOGRAPH and DIFFERENCE, whose camera is drawn; -1: none */
  int64_t solo; /* the only object to draw; -1: everything */
  int hidden_count;
  int32_t hidden[PAGS_VIEW_HIDDEN]; /* objects that aren't drawn; may name some that the scene doesn't have */
  bool full;                        /* full quality even while moving (Early-Z alone) */
  bool early_z;                     /* false: full quality without it, to see what it saves */
  int64_t serial;                   /* the page's number of this look, which the picture repeats */
} pags_view_look;

typedef enum pags_view_kind {
  PAGS_VIEW_LOOK,
  PAGS_VIEW_PICK, /* what is at a pixel of the picture last looked at */
  PAGS_VIEW_GOT,  /* the page has the picture with that serial: the next one may be sent */
  /* of a page on a run (board.h): */
  PAGS_VIEW_RUN,        /* how it stands, and the curves from a point on */
  PAGS_VIEW_CHECKPOINT, /* write one */
  PAGS_VIEW_STOP        /* end it as Ctrl-C does */
} pags_view_kind;

typedef struct pags_view_request {
  pags_view_kind kind;
  pags_view_look look; /* LOOK */
  double x, y;         /* PICK: pixels of the look's camera */
  int64_t serial;
  int64_t edition, from; /* RUN: which curves the page has, and how many points of them */
} pags_view_request;

/* Reads a message. PAGS_ERROR_FORMAT, PAGS_ERROR_LIMIT or PAGS_ERROR_MEMORY, with a message that can be shown. */
pags_result pags_view_request_parse(const char *text, size_t size, pags_view_request *out);

#endif
