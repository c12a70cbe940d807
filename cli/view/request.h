/* SPDX-License-Identifier: Apache-2.0 */
/* Requests of a page: one JSON object per message. Any input may arrive; accepted values are within the bounds below.
 */
#ifndef PAGS_CLI_VIEW_REQUEST_H
#define PAGS_CLI_VIEW_REQUEST_H

#include <pags/camera.h>
#include <stdbool.h>

enum {
  PAGS_VIEW_MESSAGE = 16384, /* maximum bytes of a message */
  PAGS_VIEW_SIDE = 2048,     /* maximum width and height of a picture, pixels */
  PAGS_VIEW_HIDDEN = 1024    /* maximum number of hidden objects */
};

typedef enum pags_view_channel {
  PAGS_VIEW_COLOR,
  PAGS_VIEW_DEPTH,    /* logarithmic, near is bright */
  PAGS_VIEW_PRIORITY, /* heat map */
  PAGS_VIEW_CRITICAL, /* non-critical Gaussians are grey */
  PAGS_VIEW_OBJECT,   /* one colour per object */
  PAGS_VIEW_SIZE,     /* size of the Gaussians as a heat map, logarithmic */
  PAGS_VIEW_PHOTOGRAPH,
  PAGS_VIEW_DIFFERENCE, /* 3 |picture - photograph| */
  PAGS_VIEW_CHANNELS
} pags_view_channel;

/* A requested view. */
typedef struct pags_view_look {
  pags_camera camera; /* checked; at most PAGS_VIEW_SIDE pixels per side; time NaN: the start of the scene */
  pags_view_channel channel;
  int64_t view; /* recorded view of PHOTOGRAPH and DIFFERENCE, whose camera is drawn; -1: none */
  int64_t solo; /* the only object to draw; -1: everything */
  int hidden_count;
  int32_t hidden[PAGS_VIEW_HIDDEN]; /* hidden objects; indices outside of the scene are ignored */
  bool full;                        /* full quality even while moving (Early-Z alone) */
  bool early_z;                     /* false: full quality without it, to see what it saves */
  int64_t serial;                   /* number of this look in the page; repeated with its picture */
} pags_view_look;

typedef enum pags_view_kind {
  PAGS_VIEW_LOOK,
  PAGS_VIEW_PICK, /* find the object at a pixel of the latest look */
  PAGS_VIEW_GOT,  /* acknowledges the picture with this serial */
  /* for training runs (run_status.h): */
  PAGS_VIEW_RUN,        /* send status and curves, from a given point on */
  PAGS_VIEW_CHECKPOINT, /* write a checkpoint */
  PAGS_VIEW_STOP        /* stop, as with Ctrl-C */
} pags_view_kind;

typedef struct pags_view_request {
  pags_view_kind kind;
  pags_view_look look; /* LOOK */
  double x, y;         /* PICK: pixels of the look's camera */
  int64_t serial;
  int64_t edition, from; /* RUN: edition of the curves in the page, and the number of points it has */
} pags_view_request;

/* Parses a message. PAGS_ERROR_FORMAT, PAGS_ERROR_LIMIT or PAGS_ERROR_MEMORY, with a text to show. */
pags_result pags_view_request_parse(const char *text, size_t size, pags_view_request *out);

#endif
