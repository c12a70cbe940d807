/* SPDX-License-Identifier: Apache-2.0 */
/* Writes HTML into memory: markup as it is, text escaped, numbers, and pictures as data URIs. */
#ifndef PAGS_CLI_HTML_REPORT_HTML_H
#define PAGS_CLI_HTML_REPORT_HTML_H

#include <pags/base.h>
#include <stdbool.h>

#include "image/encoded.h"

/* Zeros are an empty one. A failed allocation is remembered in `failed`. */
typedef struct pags_html {
  pags_sink sink; /* sink.bytes is freed by the owner */
  bool failed;
} pags_html;

/* Appends markup, formatted as by printf. Strings that come from files must not be among the arguments. */
void pags_html_put(pags_html *html, const char *format, ...) PAGS_PRINTF(2, 3);

/* Appends text that comes from anywhere: what HTML would read as markup is escaped, also within quotes; control
 * characters become U+FFFD, and a byte that isn't UTF-8 \xDF (its value). */
void pags_html_text(pags_html *html, const char *text);

/* Appends an element with such a text, isolated from the direction of the text around it: <name>text</name>. `name` may
 * have attributes behind it. */
void pags_html_element(pags_html *html, const char *name, const char *text);

/* Appends table cells: text; a number, a dash if it isn't finite; a count with grouped thousands. */
void pags_html_cell(pags_html *html, const char *text);
void pags_html_number(pags_html *html, int decimals, double value);
void pags_html_count(pags_html *html, int64_t value);

/* Begins a table in a box that scrolls sideways where it is too wide; `heads` are the texts of its head, separated by
 * '|', those of columns of numbers beginning with '#'. */
void pags_html_begin_table(pags_html *html, const char *heads);
void pags_html_end_table(pags_html *html);

/* Appends a JPEG file as a picture with a caption. */
void pags_html_picture(pags_html *html, const pags_sink *jpeg, int width, int height, const char *caption);

/* Writes a count with grouped thousands, "1 234 567", into `text`, which it returns. */
const char *pags_html_thousands(int64_t value, char text[32]);

#endif
