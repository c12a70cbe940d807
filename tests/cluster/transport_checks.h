/* SPDX-License-Identifier: Apache-2.0 */
/* Checks that every kind of transport must pass, on all ranks at the same time. */
#ifndef PAGS_TESTS_TRANSPORT_CHECKS_H
#define PAGS_TESTS_TRANSPORT_CHECKS_H

#include "cluster/transport.h"

/* Runs all checks on this rank. Returns "" or a message about a fault, which is valid until the next call on this
 * thread. If `large` > 0, one exchange sends `large` bytes from rank 0 to the last rank. */
const char *transport_checks(pags_transport *transport, int64_t large);

#endif
