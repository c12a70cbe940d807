/* SPDX-License-Identifier: Apache-2.0 */
/* Pages of memory that can be made inaccessible, and the message of an access to such a page. */
#ifndef PAGS_TESTS_KERNELS_PAGES_H
#define PAGS_TESTS_KERNELS_PAGES_H

#include <stdbool.h>
#include <stddef.h>

typedef enum pages_access { PAGES_SHUT, PAGES_READ, PAGES_WRITE } pages_access;

size_t pages_size(void); /* size of a page in bytes */
/* Allocates `size` bytes, a multiple of a page, that may be read and written; NULL on failure. */
unsigned char *pages_make(size_t size);
bool pages_allow(unsigned char *pages, size_t size, pages_access access);
void pages_free(unsigned char *pages, size_t size);
/* On a crash, prints `where`, a text that may change until then, and ends the program. */
void pages_on_crash(const char *where);

#endif
