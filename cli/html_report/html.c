/* SPDX-License-Identifier: Apache-2.0 */
/* Implements html.h: escaping, table cells and pictures in base64 (RFC 4648). */
#include "cli/html_report/html.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/bytes.h"
#include "base/text.h"

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

void pags_html_text(pags_html *html, const char *text) {
  for (const char *s = text; *s;) {
    const unsigned char c = (unsigned char)*s;
    const char *entity = c == '&'    ? "&amp;"
                         : c == '<'  ? "&lt;"
                         : c == '>'  ? "&gt;"
                         : c == '"'  ? "&quot;"
                         : c == '\'' ? "&#39;"
                                     : NULL;
    const size_t length = pags_text_utf8(s);
    const bool control = c == 0x7F || (c < 0x20 && c != '\n' && c != '\t') || (c == 0xC2 && (unsigned char)s[1] < 0xA0);
    char code[8];
    if (entity)
      append(html, entity, strlen(entity));
    else if (!length)
      append(html, code, (size_t)snprintf(code, sizeof code, "\\x%02X", c));
    else if (control)
      append(html, "\xEF\xBF\xBD", 3);
    else
      append(html, s, length);
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
