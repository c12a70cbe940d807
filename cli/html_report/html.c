/* SPDX-License-Identifier: Apache-2.0 */
/* Implements html.h but for charts: escaping, numbers, tables, and pictures in base64 (RFC 4648). */
#include "cli/html_report/html.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include "base/bytes.h"
#include "base/memory.h"
#include "base/text.h"

void pags_html_destroy(pags_html *html) {
  for (int i = 0; i < PAGS_HTML_TEXTS; i++)
    free(html->texts[i].bytes);
  free(html->sink.bytes);
}

static void append(pags_html *html, pags_sink *sink, const void *bytes, size_t size) {
  html->failed = html->failed || !pags_sink_put(sink, bytes, size);
}

void pags_html_put(pags_html *html, const char *format, ...) {
  va_list list, again;
  va_start(list, format);
  va_copy(again, list);
  const size_t size = (size_t)vsnprintf(NULL, 0, format, list) + 1;
  PAGS_AUTOFREE char *text = malloc(size);
  if (text)
    vsnprintf(text, size, format, again);
  va_end(again);
  va_end(list);
  html->failed = html->failed || !text || !pags_sink_put(&html->sink, text, size - 1);
}

static pags_sink *next_text(pags_html *html) {
  pags_sink *const text = &html->texts[html->next++ % PAGS_HTML_TEXTS];
  text->size = 0;
  return text;
}

const char *pags_html_text(pags_html *html, const char *text) {
  pags_sink *const out = next_text(html);
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
      append(html, out, entity, strlen(entity));
    else if (!length)
      append(html, out, code, (size_t)snprintf(code, sizeof code, "\\x%02X", c));
    else if (control)
      append(html, out, "\xEF\xBF\xBD", 3);
    else
      append(html, out, s, length);
    s += length ? length : 1;
  }
  append(html, out, "", 1);
  return html->failed ? "" : (const char *)out->bytes;
}

static const char *keep(pags_html *html, const char *text) {
  pags_sink *const out = next_text(html);
  append(html, out, text, strlen(text) + 1);
  return html->failed ? "" : (const char *)out->bytes;
}

const char *pags_html_number(pags_html *html, int decimals, double value) {
  char digits[400]; /* all of a double's before the point, and some behind it */
  snprintf(digits, sizeof digits, "%.*f", decimals, value);
  return keep(html, isfinite(value) ? digits : "&ndash;");
}

const char *pags_html_count(pags_html *html, int64_t value) {
  char digits[24], text[32], *to = text;
  const int length = snprintf(digits, sizeof digits, "%lld", (long long)value);
  for (int i = 0; i < length; i++) {
    *to++ = digits[i];
    if ((length - 1 - i) % 3 == 0 && i + 1 < length && digits[i] != '-')
      *to++ = ' ';
  }
  *to = 0;
  return keep(html, text);
}

void pags_html_begin_table(pags_html *html, const char *heads) {
  pags_html_put(html, "<div class=\"wide\"><table>\n<thead><tr>");
  for (const char *head = heads; *head; head += *head != 0) {
    const bool number = *head == '#';
    const size_t length = strcspn(head, "|");
    pags_html_put(html, "<th%s scope=\"col\">%.*s</th>", number ? " class=\"n\"" : "", (int)(length - number),
                  head + number);
    head += length;
  }
  pags_html_put(html, "</tr></thead>\n<tbody>\n");
}

void pags_html_end_table(pags_html *html) {
  pags_html_put(html, "</tbody>\n</table></div>\n");
}

void pags_html_picture(pags_html *html, const pags_sink *jpeg, int width, int height, const char *caption) {
  pags_html_put(html, "<figure><img width=\"%d\" height=\"%d\" alt=\"%s\" src=\"data:image/jpeg;base64,", width, height,
                caption);
  for (size_t i = 0; i < jpeg->size; i += 3) {
    char four[4];
    pags_base64_three(jpeg->bytes + i, jpeg->size - i, four);
    append(html, &html->sink, four, sizeof four);
  }
  pags_html_put(html, "\"><figcaption><bdi>%s</bdi></figcaption></figure>", caption);
}
