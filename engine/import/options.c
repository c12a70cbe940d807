/* SPDX-License-Identifier: Apache-2.0 */
/* Parses the texts of an importer's options that choose cameras ("0,2,3") and frames ("10-50"). */
#include "import/options.h"

#include <stdlib.h>

pags_import_options pags_import_options_default(void) {
  return (pags_import_options){.frame_last = -1};
}

pags_result pags_import_cameras(const char *text, int limit, int usual, int numbers[16], int *count) {
  unsigned chosen = (1U << usual) - 1;
  if (text) {
    chosen = 0;
    const char *at = text;
    for (;;) {
      char *end = NULL;
      const long number = *at >= '0' && *at <= '9' ? strtol(at, &end, 10) : -1;
      if (!end || number < 0 || number >= limit || (*end && *end != ','))
        return pags_fail(PAGS_ERROR_ARGUMENT, "cameras: expected numbers of 0..%d separated by commas, got '%s'",
                         limit - 1, text);
      if (chosen & 1U << number)
        return pags_fail(PAGS_ERROR_ARGUMENT, "cameras: %ld is named twice in '%s'", number, text);
      chosen |= 1U << number;
      if (!*end)
        break;
      at = end + 1;
    }
  }
  *count = 0;
  for (int i = 0; i < limit; i++)
    if (chosen & 1U << i)
      numbers[(*count)++] = i;
  return PAGS_OK;
}

pags_result pags_import_frames(const pags_import_options *options, int64_t count, int64_t *first, int64_t *last) {
  *first = options->frame_first;
  *last = options->frame_last < 0 || options->frame_last >= count ? count - 1 : options->frame_last;
  if (*first < 0 || *first > *last)
    return pags_fail(PAGS_ERROR_ARGUMENT, "frames: nothing is left of %lld to %lld; the source has %lld, from 0 on",
                     (long long)*first, (long long)options->frame_last, (long long)count);
  return PAGS_OK;
}
