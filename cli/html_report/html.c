/* SPDX-License-Identifier: Apache-2.0 */
/* Implements html.h: escaping, table cells and pictures in base64 (RFC 4648). */
#include "cli/html_report/html.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/base64.h"

static void append(pags_html *html, const void *bytes, size_t size) {
  html->failed = html->failed || !pags_sink_put(&html->sink, bytes, size);
}

void pags_html_put(pags_html *html, const char *format, ...) {
  char text[2048];
  va_list list;
  va_start(list, format);
  const int length = vsnprintf(text, sizeof text, format, list);
  va_end(list);
  if (length < 0 || (size_t)length >= sizeof text)
    html->failed = true;
  else
    append(html, text, (size_t)length);
}

/* Length in bytes of the UTF-8 character at `s`, which is not ASCII; 0 if there is none: a stray byte, an overlong
 * form, a surrogate, or a code beyond U+10FFFF. */
static size_t utf8_length(const unsigned char *s) {
  const size_t length = s[0] >= 0xC2 && s[0] <= 0xDF   ? 2
                        : s[0] >= 0xE0 && s[0] <= 0xEF ? 3
                        : s[0] >= 0xF0 && s[0] <= 0xF4 ? 4
                                                       : 0;
  for (size_t i = 1; i < length; i++)
    if ((s[i] & 0xC0) != 0x80)
      return 0;
  const bool bad = (s[0] == 0xE0 && s[1] < 0xA0) || (s[0] == 0xED && s[1] > 0x9F) || (s[0] == 0xF0 && s[1] < 0x90) ||
                   (s[0] == 0xF4 && s[1] > 0x8F) || (s[0] == 0xC2 && s[1] < 0xA0);
  return bad ? 0 : length;
}

void pags_html_text(pags_html *html, const char *text) {
  static const char replacement[] = "\xEF\xBF\xBD";
  for (const unsigned char *s = (const unsigned char *)text; *s;) {
    const char *entity = *s == '&'    ? "&amp;"
                         : *s == '<'  ? "&lt;"
                         : *s == '>'  ? "&gt;"
                         : *s == '"'  ? "&quot;"
                         : *s == '\'' ? "&#39;"
                                      : NULL;
    const bool plain = (*s >= 0x20 && *s < 0x7F) || *s == '\n' || *s == '\t';
    const size_t length = plain ? 1 : *s < 0x80 ? 0 : utf8_length(s);
    if (entity)
      append(html, entity, strlen(entity));
    else if (length)
      append(html, s, length);
    else
      append(html, replacement, sizeof replacement - 1);
    s += length ? length : 1;
  }
}

void pags_html_element(pags_html *html, const char *name, const char *text) {
  pags_html_put(html, "<%s><bdi>", name);
  pags_html_text(html, text);
  pags_html_put(html, "</bdi></%.*s>", (int)strcspn(name, " "), name);
}

void pags_html_cell(pags_html *html, const char *text) {
  pags_html_element(html, "td", text);
}

void pags_html_number(pags_html *html, int decimals, double value) {
  if (isfinite(value))
    pags_html_put(html, "<td class=\"n\">%.*f</td>", decimals, value);
  else
    pags_html_put(html, "<td class=\"n\">&ndash;</td>");
}

const char *pags_html_thousands(int64_t value, char text[32]) {
  char digits[24];
  const int length = snprintf(digits, sizeof digits, "%lld", (long long)value);
  int to = 0;
  for (int i = 0; i < length; i++) {
    text[to++] = digits[i];
    if ((length - 1 - i) % 3 == 0 && i + 1 < length && digits[i] != '-')
      text[to++] = ' ';
  }
  text[to] = 0;
  return text;
}

void pags_html_count(pags_html *html, int64_t value) {
  char text[32];
  pags_html_put(html, "<td class=\"n\">%s</td>", pags_html_thousands(value, text));
}

void pags_html_begin_table(pags_html *html, const char *heads) {
  pags_html_put(html, "<div class=\"wide\"><table>\n<thead><tr>");
  for (const char *head = heads; *head; head++) {
    const size_t length = strcspn(head, "|");
    const bool number = *head == '#';
    pags_html_put(html, "<th%s scope=\"col\">%.*s</th>", number ? " class=\"n\"" : "", (int)(length - number),
                  head + number);
    head += length;
    if (!*head)
      break;
  }
  pags_html_put(html, "</tr></thead>\n<tbody>\n");
}

void pags_html_end_table(pags_html *html) {
  pags_html_put(html, "</tbody>\n</table></div>\n");
}

void pags_html_picture(pags_html *html, const pags_sink *jpeg, int width, int height, const char *caption) {
  pags_html_put(html, "<figure><img width=\"%d\" height=\"%d\" alt=\"", width, height);
  pags_html_text(html, caption);
  pags_html_put(html, "\" src=\"data:image/jpeg;base64,");
  for (size_t i = 0; i < jpeg->size; i += 3) {
    char four[4];
    pags_base64_three(jpeg->bytes + i, jpeg->size - i, four);
    append(html, four, sizeof four);
  }
  pags_html_put(html, "\">");
  pags_html_element(html, "figcaption", caption);
  pags_html_put(html, "</figure>");
}
