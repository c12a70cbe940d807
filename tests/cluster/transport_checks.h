/* SPDX-License-Identifier: Apache-2.0 */
/* What every kind of transport must do, checked on all ranks at once. */
#ifndef PAGS_TESTS_TRANSPORT_CHECKS_H
#define PAGS_TESTS_TRANSPORT_CHECKS_H

#include "cluster/transport.h"

/* Runs all checks on this rank. Returns "" or what was wrong, valid until the next call on this thread. `large` > 0:
 * one exchange sends this number of bytes from rank 0 to the last rank. */
const char *transport_checks(pags_transport *transport, int64_t large);

#endif
