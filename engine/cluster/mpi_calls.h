/* SPDX-License-Identifier: Apache-2.0 */
/* The table through which transport_mpi.c reaches MPI (mpi_module.c, built as pags_mpi.so): the few calls that it
 * needs, none of which waits but `begin`, `end` and `abort`. All are called by the thread that calls `begin`.
 *
 * The module links none of the engine's code. */
#ifndef PAGS_CLUSTER_MPI_CALLS_H
#define PAGS_CLUSTER_MPI_CALLS_H

#include <stdbool.h>
#include <stddef.h>

#define PAGS_MPI_VERSION 1
#define PAGS_MPI_SYMBOL "pags_mpi_table"

/* A message under way: Holds an MPI_Request: a pointer or an int, depending on the MPI. */
typedef union pags_mpi_request {
  void *pointer;
  int number;
} pags_mpi_request;

typedef struct pags_mpi {
  int version;
  /* Joins the job; `library` gets one line that names the MPI. false: MPI can't start. */
  bool (*begin)(int *rank, int *ranks, char *library, size_t size);
  /* Messages are matched by their two ends, `tag` (0 .. 32767) and order. false: failed. */
  bool (*send)(const void *data, int bytes, int to, int tag, pags_mpi_request *request);
  bool (*receive)(void *data, int bytes, int from, int tag, pags_mpi_request *request);
  /* 1: the message is over, *bytes of it were received; 0: not yet; -1: it failed; `why` has the reason. */
  int (*test)(pags_mpi_request *request, int *bytes, char *why, size_t size);
  void (*end)(void);       /* all ranks together; nothing may be under way */
  void (*abort)(int code); /* ends the processes of all ranks */
} pags_mpi;

#if defined(__GNUC__)
__attribute__((visibility("default")))
#endif
const void *
pags_mpi_table(void);

#endif
