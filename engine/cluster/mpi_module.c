/* SPDX-License-Identifier: Apache-2.0 */
/* The calls of MPI behind mpi_calls.h. */
#include "cluster/mpi_calls.h"

#include <mpi.h>
#include <stdio.h>
#include <string.h>

_Static_assert(sizeof(MPI_Request) <= sizeof(pags_mpi_request), "a request must fit");

static bool begin(int *rank, int *ranks, char *library, size_t size) {
  int provided, length = 0;
  char text[MPI_MAX_LIBRARY_VERSION_STRING] = "";
  if (MPI_Init_thread(NULL, NULL, MPI_THREAD_FUNNELED, &provided) != MPI_SUCCESS)
    return false;
  MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN);
  MPI_Comm_rank(MPI_COMM_WORLD, rank);
  MPI_Comm_size(MPI_COMM_WORLD, ranks);
  MPI_Get_library_version(text, &length);
  snprintf(library, size, "%.*s", (int)strcspn(text, ",\n"), text);
  return true;
}

static bool send(const void *data, int bytes, int to, int tag, pags_mpi_request *request) {
  MPI_Request sent;
  if (MPI_Isend(data, bytes, MPI_BYTE, to, tag, MPI_COMM_WORLD, &sent) != MPI_SUCCESS)
    return false;
  memcpy(request, &sent, sizeof sent);
  return true;
}

static bool receive(void *data, int bytes, int from, int tag, pags_mpi_request *request) {
  MPI_Request received;
  if (MPI_Irecv(data, bytes, MPI_BYTE, from, tag, MPI_COMM_WORLD, &received) != MPI_SUCCESS)
    return false;
  memcpy(request, &received, sizeof received);
  return true;
}

static int test(pags_mpi_request *request, int *bytes, char *why, size_t size) {
  MPI_Request tested;
  MPI_Status status;
  int done = 0;
  memcpy(&tested, request, sizeof tested);
  const int code = MPI_Test(&tested, &done, &status);
  memcpy(request, &tested, sizeof tested);
  if (code != MPI_SUCCESS) {
    char text[MPI_MAX_ERROR_STRING] = "";
    int length;
    MPI_Error_string(code, text, &length);
    snprintf(why, size, "%.*s", (int)strcspn(text, "\n"), text);
    return -1;
  }
  if (done)
    MPI_Get_count(&status, MPI_BYTE, bytes);
  return done;
}

static void end(void) {
  MPI_Finalize();
}

static void abort_all(int code) {
  MPI_Abort(MPI_COMM_WORLD, code);
}

const void *pags_mpi_table(void) {
  static const pags_mpi table = {PAGS_MPI_VERSION, begin, send, receive, test, end, abort_all};
  return &table;
}
