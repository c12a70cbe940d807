/* SPDX-License-Identifier: Apache-2.0 */
/* What the decoders and encoders of picture files share: checks, messages and a growing block. */
#include <string.h>

#include "image/formats.h"

pags_result pags_encoded_check(const pags_encoded *file, const pags_picture_info *info, uint64_t least) {
  if (info->width < 1 || info->width > PAGS_IMAGE_MAX_SIDE || info->height < 1 || info->height > PAGS_IMAGE_MAX_SIDE ||
      info->channels < 1)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: %lld x %lld pixels with %d channels, expected sides of 1..%d", file->path,
                     (long long)info->width, (long long)info->height, info->channels, PAGS_IMAGE_MAX_SIDE);
  if (least > file->size)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: can't be decoded: the file has %zu bytes, too few for %lld x %lld pixels",
                     file->path, file->size, (long long)info->width, (long long)info->height);
  return PAGS_OK;
}

pags_result pags_encoded_bad(const pags_encoded *file, const char *what, const char *name, const char *text) {
  return pags_fail(PAGS_ERROR_FORMAT, "%s: %s: %s: %s", file->path, what, name, text);
}

bool pags_sink_put(pags_sink *sink, const void *bytes, size_t size) {
  if (size > sink->capacity - sink->size) {
    const size_t grown = sink->capacity + sink->capacity / 2 + 4096;
    const size_t wanted = sink->size + size > grown ? sink->size + size : grown;
    uint8_t *const block = wanted >= size ? realloc(sink->bytes, wanted) : NULL;
    if (!block)
      return false;
    sink->bytes = block;
    sink->capacity = wanted;
  }
  memcpy(sink->bytes + sink->size, bytes, size);
  sink->size += size;
  return true;
}
