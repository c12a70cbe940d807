/* SPDX-License-Identifier: Apache-2.0 */
/* The transport over MPI. One thread of each process, the progress thread, makes all calls of MPI. It
 * sends heartbeats while the rank's own thread computes. Between two polls the progress thread sleeps; MPI's own
 * waiting would keep a processor busy.
 *
 * Every quarter of a second the progress thread sends a heartbeat to every other rank, with the progress that
 * pags_transport_tell reported. A rank that sends no heartbeat for the time of the watchdog is given up: its process is
 * stopped or gone, or the link is down. The last heartbeat of a rank says that it leaves. After it no message between
 * the two ranks is pending, and MPI can be ended.
 *
 * A large part is split into messages of CHUNK bytes, since MPI counts in int. */
#include <assert.h>
#include <stdarg.h>
#include <stdio.h>

#include "base/clock.h"
#include "base/memory.h"
#include "cluster/backend.h"
#include "cluster/mpi_calls.h"
#include "port/module.h"
#include "port/port.h"

/* ---- The launcher ---- */

/* Number of ranks according to the launcher; 0: unknown. */
static int find_started_ranks(void) {
  const char *const open_mpi = getenv("OMPI_COMM_WORLD_SIZE"), *const text = open_mpi ? open_mpi : getenv("PMI_SIZE");
  return text ? (int)strtol(text, NULL, 10) : 0;
}

bool pags_transport_started_by_mpi(void) {
  return getenv("OMPI_COMM_WORLD_SIZE") || getenv("PMI_SIZE") || getenv("PMIX_RANK");
}

#ifndef PAGS_WITH_MPI

pags_result pags_transport_create_mpi(pags_transport **transport) {
  *transport = NULL;
  if (find_started_ranks() == 1)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "started as one of several by mpirun, but this build has no MPI: configure with -DPAGS_MPI=ON "
                   "(Debian: libopenmpi-dev)");
}

#else

enum {
  CHUNK = 64 << 20,
  HEARTBEAT_TAG = 32767,
  TAGS = 32767,     /* of transfers, in turn */
  LEAVING_MS = 1000 /* maximum delay of messages that a rank sent before its last heartbeat */
};
static const double heartbeat_every_ms = 250;

typedef struct heartbeat {
  int64_t done;
  int32_t ends_early, leaves;
} heartbeat;

/* Another rank. Only the progress thread uses it, except for `last`, which the lock guards. */
typedef struct peer {
  heartbeat sent, received; /* buffers of the messages under way */
  pags_mpi_request send, receive;
  bool sending, said_leaving;
  double heard_ms, left_ms; /* left_ms: when its last heartbeat came; 0: not yet */
  heartbeat last;
} peer;

/* A transfer that is pending, in the order of the calls. */
typedef struct request {
  struct request *next;
  int tag;
  int64_t count; /* messages: for each rank its chunks sent, then its chunks received */
  int64_t left;  /* pieces that aren't over */
  bool done;
  struct piece {
    pags_mpi_request request;
    char *data;
    int bytes, rank;
    bool receives, over;
  } pieces[];
} request;

typedef struct mpi_transport {
  pags_transport base;
  const pags_mpi *mpi;
  double watchdog;
  char library[128];
  pthread_t progress;
  peer *peers;
  int64_t number; /* of the next transfer */

  pthread_mutex_t lock; /* guards what follows */
  pthread_cond_t changed;
  request *submitted; /* not yet seen by the progress thread, last first */
  heartbeat own;
  bool started, leaving, over; /* over: the progress thread has ended MPI */
  bool failed;                 /* to be aborted */
  int silent;                  /* the rank that was given up; -1: none */
  bool gave_up;                /* this rank failed first, and reports the failure */
  char broken[1024];           /* why calls fail; "": they don't */
} mpi_transport;

/* ---- The progress thread ---- */

/* Records the first failure; every later call of the rank's own thread fails. */
static void break_down(mpi_transport *self, int silent, const char *why) {
  pthread_mutex_lock(&self->lock);
  if (!self->broken[0]) {
    snprintf(self->broken, sizeof self->broken, "%s", why);
    self->silent = silent;
  }
  pthread_cond_broadcast(&self->changed);
  pthread_mutex_unlock(&self->lock);
}

/* Gives up a rank; `format`: what it does or did. */
static PAGS_PRINTF(3, 4) void lose_rank(mpi_transport *self, int rank, const char *format, ...) {
  char text[sizeof self->broken];
  const int length = snprintf(text, sizeof text, "rank %d of %d ", rank, self->base.ranks);
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text + length, sizeof text - (size_t)length, format, arguments);
  va_end(arguments);
  break_down(self, rank, text);
}

static bool start_pieces(mpi_transport *self, request *work) {
  bool right = true;
  for (int64_t i = 0; right && i < work->count; i++) {
    struct piece *p = &work->pieces[i];
    right = p->receives ? self->mpi->receive(p->data, p->bytes, p->rank, work->tag, &p->request)
                        : self->mpi->send(p->data, p->bytes, p->rank, work->tag, &p->request);
  }
  if (!right)
    break_down(self, -1, "MPI takes no more messages");
  return right;
}

/* Looks at the transfer's messages; true if one of them is newly over. */
static bool look_at(mpi_transport *self, request *work) {
  const int64_t before = work->left;
  for (int64_t i = 0; i < work->count; i++) {
    struct piece *p = &work->pieces[i];
    int bytes = 0;
    char why[300];
    if (p->over)
      continue;
    const int state = self->mpi->test(&p->request, &bytes, why, sizeof why);
    if (state < 0) {
      lose_rank(self, p->rank, "can't be reached: %s", why);
    } else if (state > 0 && p->receives && bytes != p->bytes) {
      lose_rank(self, p->rank, "sent %d bytes; expected %d", bytes, p->bytes);
    } else if (state > 0) {
      p->over = true;
      work->left--;
    } else if (p->receives && self->peers[p->rank].left_ms > 0 &&
               pags_clock_ms() - self->peers[p->rank].left_ms > LEAVING_MS) {
      lose_rank(self, p->rank, "has ended before its work was done");
    }
  }
  return work->left < before;
}

/* Receives the heartbeats of other ranks. */
static void receive_heartbeats(mpi_transport *self, double now) {
  for (int rank = 0; rank < self->base.ranks; rank++) {
    peer *p = &self->peers[rank];
    int bytes;
    char why[300];
    while (rank != self->base.rank && p->left_ms <= 0) {
      const int state = self->mpi->test(&p->receive, &bytes, why, sizeof why);
      if (state < 0)
        lose_rank(self, rank, "can't be reached: %s", why);
      if (state <= 0)
        break;
      p->heard_ms = now;
      p->left_ms = p->received.leaves ? now : 0;
      pthread_mutex_lock(&self->lock);
      p->last = p->received;
      pthread_mutex_unlock(&self->lock);
      if (!p->received.leaves &&
          !self->mpi->receive(&p->received, sizeof p->received, rank, HEARTBEAT_TAG, &p->receive)) {
        break_down(self, -1, "MPI takes no more messages");
        return;
      }
    }
    if (rank != self->base.rank && p->left_ms <= 0 && now - p->heard_ms > self->watchdog * 1e3)
      lose_rank(self, rank, "has been silent for %g s", self->watchdog);
  }
}

/* Sends a heartbeat to each rank to which none is pending. Returns whether all know that this rank leaves. */
static bool send_heartbeats(mpi_transport *self, const heartbeat *own) {
  bool known = true;
  for (int rank = 0; rank < self->base.ranks; rank++) {
    peer *p = &self->peers[rank];
    int bytes;
    char why[300];
    if (rank == self->base.rank)
      continue;
    if (p->sending && self->mpi->test(&p->send, &bytes, why, sizeof why) != 0)
      p->sending = false;
    if (!p->sending && !p->said_leaving) {
      p->sent = *own;
      p->sending = self->mpi->send(&p->sent, sizeof p->sent, rank, HEARTBEAT_TAG, &p->send);
      p->said_leaving = own->leaves != 0;
    }
    known &= p->said_leaving && !p->sending;
  }
  return known;
}

static bool all_have_left(const mpi_transport *self) {
  for (int rank = 0; rank < self->base.ranks; rank++)
    if (rank != self->base.rank && self->peers[rank].left_ms <= 0)
      return false;
  return true;
}

/* Joins the job and listens to the other ranks. */
static bool join(mpi_transport *self) {
  if (!self->mpi->begin(&self->base.rank, &self->base.ranks, self->library, sizeof self->library)) {
    snprintf(self->broken, sizeof self->broken, "MPI can't start");
    return false;
  }
  self->peers = calloc((size_t)self->base.ranks, sizeof *self->peers);
  for (int rank = 0; self->peers && rank < self->base.ranks; rank++) {
    peer *p = &self->peers[rank];
    p->heard_ms = pags_clock_ms();
    if (rank != self->base.rank)
      self->mpi->receive(&p->received, sizeof p->received, rank, HEARTBEAT_TAG, &p->receive);
  }
  if (!self->peers)
    snprintf(self->broken, sizeof self->broken, "out of memory for %d ranks", self->base.ranks);
  return self->peers != NULL;
}

/* Seconds to sleep between two polls: longer, the longer no message has been completed. A new transfer ends the sleep.
 * MPI moves a part of a message at each poll. Polls follow quickly for as long as a line of 0.4 Gb/s takes for the
 * pending bytes; otherwise the line would wait for them. */
static double choose_sleep(const request *active, bool busy, double idle_ms) {
  const double eager = 50e-6, patient = 1e-3, resting = 20e-3, eager_ms = 10, slow_bytes_a_ms = 50e3;
  int64_t pending = 0; /* bytes */
  for (const request *work = active; work; work = work->next)
    for (int64_t i = 0; i < work->count; i++)
      pending += work->pieces[i].over ? 0 : work->pieces[i].bytes;
  return !busy ? resting : idle_ms < eager_ms + (double)pending / slow_bytes_a_ms ? eager : patient;
}

static void *run_progress(void *argument) {
  mpi_transport *self = argument;
  pthread_mutex_lock(&self->lock);
  const bool joined = join(self);
  self->started = true;
  pthread_cond_broadcast(&self->changed);
  request *active = NULL;
  double looked_ms = pags_clock_ms(), moved_ms = looked_ms, sent_ms = 0;
  heartbeat sent = {0};
  while (joined && !self->failed) {
    /* Take new requests of the rank's own thread. */
    request *pending = NULL;
    for (request *next; self->submitted; self->submitted = next) {
      next = self->submitted->next;
      self->submitted->next = pending;
      pending = self->submitted;
    }
    heartbeat own = self->own;
    own.leaves = self->leaving;
    const bool broken = self->broken[0] != '\0';
    pthread_mutex_unlock(&self->lock);

    /* While this process was stopped, the silence of others doesn't count. */
    const double now = pags_clock_ms(), stopped_ms = now - looked_ms;
    for (int rank = 0; stopped_ms > 1000 && rank < self->base.ranks; rank++)
      self->peers[rank].heard_ms += stopped_ms;
    looked_ms = now;

    request **end = &active;
    while (*end)
      end = &(*end)->next;
    *end = pending;
    bool moved = pending != NULL;
    for (; pending && !broken; pending = pending->next)
      if (!start_pieces(self, pending))
        break;
    for (request *work = active; work && !broken; work = work->next)
      moved |= look_at(self, work);
    moved_ms = moved ? now : moved_ms;
    bool known = false;
    if (!broken) {
      receive_heartbeats(self, now);
      if (own.leaves || now - sent_ms >= heartbeat_every_ms || memcmp(&own, &sent, sizeof own) != 0) {
        known = send_heartbeats(self, &own);
        sent = own;
        sent_ms = now;
      }
    }

    pthread_mutex_lock(&self->lock);
    for (request **at = &active; *at;)
      if ((*at)->left == 0) {
        (*at)->done = true;
        *at = (*at)->next;
        pthread_cond_broadcast(&self->changed);
      } else {
        at = &(*at)->next;
      }
    if (known && !active && !self->broken[0] && all_have_left(self)) {
      pthread_mutex_unlock(&self->lock);
      self->mpi->end();
      pthread_mutex_lock(&self->lock);
      self->over = true;
      break;
    }
    if (!self->submitted && !self->failed)
      pags_port_condition_wait(&self->changed, &self->lock,
                               choose_sleep(active, active != NULL || (own.leaves && !broken), now - moved_ms));
  }
  const bool aborts = self->failed;
  pthread_cond_broadcast(&self->changed);
  pthread_mutex_unlock(&self->lock);
  if (aborts)
    self->mpi->abort(1);
  return NULL;
}

/* ---- The rank's own thread ---- */

static void add_pieces(request *work, char *data, int64_t bytes, int rank, bool receives) {
  for (int64_t at = 0; at < bytes; at += CHUNK)
    work->pieces[work->count++] = (struct piece){
        .data = data + at, .bytes = (int)(bytes - at < CHUNK ? bytes - at : CHUNK), .rank = rank, .receives = receives};
}

static pags_result move(pags_transport *transport, const pags_part *parts) {
  mpi_transport *self = (mpi_transport *)transport;
  int64_t count = 0;
  for (int rank = 0; rank < transport->ranks; rank++)
    count += (parts[rank].send_bytes + CHUNK - 1) / CHUNK + (parts[rank].receive_bytes + CHUNK - 1) / CHUNK;
  request *work = calloc(1, sizeof *work + (size_t)count * sizeof *work->pieces);
  PAGS_CHECK_MEMORY(work, "messages to %d ranks", transport->ranks);
  for (int rank = 0; rank < transport->ranks; rank++) {
    add_pieces(work, parts[rank].receive, parts[rank].receive_bytes, rank, true);
    add_pieces(work, (char *)parts[rank].send, parts[rank].send_bytes, rank, false);
  }
  assert(work->count == count);
  work->left = count;
  work->tag = (int)(self->number++ % TAGS);
  pthread_mutex_lock(&self->lock);
  const bool submits = !self->broken[0];
  if (submits) {
    work->next = self->submitted;
    self->submitted = work;
  }
  pthread_cond_broadcast(&self->changed);
  while (!work->done && !self->broken[0])
    pags_port_condition_wait(&self->changed, &self->lock, 1);
  const bool done = work->done;
  pthread_mutex_unlock(&self->lock);
  if (done || !submits) /* else the progress thread may still use it; it is freed by the end of the process, soon */
    free(work);
  return done ? PAGS_OK : pags_fail(PAGS_ERROR_IO, "%s", self->broken);
}

static void tell(pags_transport *transport, int64_t done, bool ends_early) {
  mpi_transport *self = (mpi_transport *)transport;
  pthread_mutex_lock(&self->lock);
  self->own.done = done;
  self->own.ends_early = ends_early;
  pthread_mutex_unlock(&self->lock);
}

static void hear(const pags_transport *transport, int64_t *done, bool *ends_early) {
  mpi_transport *self = (mpi_transport *)transport;
  pthread_mutex_lock(&self->lock);
  for (int rank = 0; rank < transport->ranks; rank++) {
    const heartbeat *of = rank == transport->rank ? &self->own : &self->peers[rank].last;
    *done += of->done;
    *ends_early |= of->ends_early != 0;
  }
  *ends_early |= self->broken[0] != '\0';
  pthread_mutex_unlock(&self->lock);
}

static void give_up(pags_transport *transport, PAGS_UNUSED pags_result result, const char *message) {
  mpi_transport *self = (mpi_transport *)transport;
  pthread_mutex_lock(&self->lock);
  self->gave_up |= !self->broken[0];
  pthread_mutex_unlock(&self->lock);
  break_down(self, -1, message);
}

/* After the loss of a rank the lowest other rank reports for all. */
static bool speaks(const pags_transport *transport) {
  mpi_transport *self = (mpi_transport *)transport;
  pthread_mutex_lock(&self->lock);
  const int speaker = self->gave_up ? transport->rank : self->silent == 0 ? 1 : 0;
  pthread_mutex_unlock(&self->lock);
  return transport->rank == speaker;
}

static void free_transport(mpi_transport *self) {
  pthread_cond_destroy(&self->changed);
  pthread_mutex_destroy(&self->lock);
  free(self->peers);
  free(self);
}

static void destroy(pags_transport *transport, bool failed) {
  enum { FAILED_CODE = 1 };
  mpi_transport *self = (mpi_transport *)transport;
  /* Seconds, so that the rank that reports can do so, and mpirun can read it. */
  const double patience = speaks(transport) ? 0.5 : 3;
  pthread_mutex_lock(&self->lock);
  self->leaving = true;
  pthread_cond_broadcast(&self->changed);
  while (!failed && !self->over && !self->broken[0])
    pags_port_condition_wait(&self->changed, &self->lock, 1);
  if (!self->over) {
    const double until_ms = pags_clock_ms() + patience * 1e3, most_ms = 5000;
    for (double left; (left = until_ms - pags_clock_ms()) > 0;)
      pags_port_condition_wait(&self->changed, &self->lock, left * 1e-3);
    self->failed = true;
    pthread_cond_broadcast(&self->changed);
    for (double left;
         (left = until_ms + most_ms - pags_clock_ms()) > 0;) /* the progress thread's abort ends the process */
      pags_port_condition_wait(&self->changed, &self->lock, left * 1e-3);
    pags_port_exit_at_once(FAILED_CODE);
  }
  pthread_mutex_unlock(&self->lock);
  pthread_join(self->progress, NULL);
  free_transport(self);
}

/* ---- Joining ---- */

pags_result pags_transport_create_mpi(pags_transport **transport) {
  static const pags_backend backend = {move, tell, hear, give_up, speaks, destroy};
  *transport = NULL;
  const int started = find_started_ranks();
  if (started == 1)
    return PAGS_OK;
  pags_port_module module;
  pags_port_load_module("pags_mpi.so", PAGS_MODULE_DIR, PAGS_MPI_SYMBOL, PAGS_MPI_VERSION, &module);
  if (!module.table)
    return pags_fail(PAGS_ERROR_UNSUPPORTED,
                     "started as one of several by mpirun, but MPI can't be loaded: %s; expected pags_mpi.so in the "
                     "folder of the program or in ../lib/pags, and Open MPI (Debian: libopenmpi3) installed",
                     module.reason);
  /* With more ranks than cores Open MPI yields its time slice at each poll. The progress thread sleeps between polls;
   * yielding would make it wait once more for other threads that compute. */
  if (!getenv("OMPI_MCA_mpi_yield_when_idle"))
    pags_port_set_environment("OMPI_MCA_mpi_yield_when_idle", "0");
  mpi_transport *self = calloc(1, sizeof *self);
  PAGS_CHECK_MEMORY(self, "messages");
  *self = (mpi_transport){
      .base.backend = &backend, .mpi = module.table, .watchdog = pags_transport_watchdog(), .silent = -1};
  pthread_mutex_init(&self->lock, NULL);
  pags_port_condition_create(&self->changed);
  const pags_port_signals signals = pags_port_block_signals(); /* handlers run on the main thread */
  const bool running = pthread_create(&self->progress, NULL, run_progress, self) == 0;
  pags_port_restore_signals(&signals);
  if (!running) {
    free_transport(self);
    return pags_fail(PAGS_ERROR_MEMORY, "can't start a thread for messages");
  }
  pthread_mutex_lock(&self->lock);
  while (!self->started)
    pags_port_condition_wait(&self->changed, &self->lock, 1);
  pthread_mutex_unlock(&self->lock);
  if (self->broken[0])
    return pags_fail(PAGS_ERROR_IO, "%s", self->broken);
  if (started && started != self->base.ranks)
    return pags_fail(PAGS_ERROR_UNSUPPORTED,
                     "%d ranks were started, but %s sees %d: use the mpirun of the MPI that this build has", started,
                     self->library, self->base.ranks);
  *transport = &self->base;
  return PAGS_OK;
}

#endif
