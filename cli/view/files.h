/* SPDX-License-Identifier: Apache-2.0 */
/* The files of the page, which cmake/embed.cmake makes a part of the program from cli/view/page/ and cli/common/page/.
 */
#ifndef PAGS_CLI_VIEW_FILES_H
#define PAGS_CLI_VIEW_FILES_H

#include <stddef.h>

typedef struct pags_view_file {
  const char *name; /* NULL ends the list */
  const char *type; /* of HTTP's Content-Type */
  const unsigned char *bytes;
  size_t size;
} pags_view_file;

extern const pags_view_file pags_view_files[];

#endif
