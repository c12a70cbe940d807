/* SPDX-License-Identifier: Apache-2.0 */
/* WebP pictures through libwebp; the only file that includes its headers. */
#include "scene/webp.h"

#include <string.h>

#ifdef PAGS_WITH_WEBP
#include <webp/decode.h>
#include <webp/encode.h>

#include "base/file.h"
#include "base/memory.h"

pags_result pags_webp_decode(const char *path, const uint8_t *bytes, size_t size, int64_t least, int64_t most,
                             pags_webp *out) {
  WebPBitstreamFeatures features;
  *out = (pags_webp){0};
  if (WebPGetFeatures(bytes, size, &features) != VP8_STATUS_OK)
    return pags_fail_at(path, "expected a WebP picture, the only kind that PAGS reads of a SOG");
  if (features.has_animation)
    return pags_fail_at(path, "expected a single WebP picture, found an animation");
  const int64_t pixels = (int64_t)features.width * features.height;
  if (pixels < least || pixels > most)
    return pags_fail_at(path, "expected %lld to %lld pixels, found %d x %d", (long long)least, (long long)most,
                        features.width, features.height);
  PAGS_AUTOFREE uint8_t *rgba = malloc(4 * (size_t)pixels);
  PAGS_CHECK_MEMORY(rgba, "%s: %d x %d pixels", path, features.width, features.height);
  if (!WebPDecodeRGBAInto(bytes, size, rgba, 4 * (size_t)pixels, 4 * features.width))
    return pags_fail_at(path, "the WebP picture is damaged or cut off");
  *out = (pags_webp){features.width, features.height, features.format == 1, pags_take(&rgba)};
  return PAGS_OK;
}

pags_result pags_webp_encode(const uint8_t *rgba, int width, int height, uint8_t **bytes, size_t *size) {
  WebPConfig config;
  WebPPicture picture;
  WebPMemoryWriter writer;
  *bytes = NULL;
  *size = 0;
  if (!WebPConfigInit(&config) || !WebPPictureInit(&picture))
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "libwebp has another version than the one that PAGS was built with");
  config.lossless = 1;
  config.exact = 1; /* keeps the colours of pixels whose alpha is 0 */
  config.quality = 75;
  config.method = 4;
  picture.use_argb = 1;
  picture.width = width;
  picture.height = height;
  WebPMemoryWriterInit(&writer);
  picture.writer = WebPMemoryWrite;
  picture.custom_ptr = &writer;
  const int encoded = WebPPictureImportRGBA(&picture, rgba, 4 * width) && WebPEncode(&config, &picture);
  WebPPictureFree(&picture);
  /* The block is copied, since the caller uses free(). */
  uint8_t *copy = encoded ? malloc(writer.size) : NULL;
  if (copy) {
    memcpy(copy, writer.mem, writer.size);
    *bytes = copy;
    *size = writer.size;
  }
  WebPMemoryWriterClear(&writer);
  return copy ? PAGS_OK : pags_out_of_memory("a WebP picture of %d x %d pixels", width, height);
}

#else

pags_result pags_webp_decode(const char *path, const uint8_t *bytes, size_t size, int64_t least, int64_t most,
                             pags_webp *out) {
  (void)bytes, (void)size, (void)least, (void)most;
  *out = (pags_webp){0};
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: this build of PAGS reads no SOG, since it has no libwebp", path);
}

pags_result pags_webp_encode(const uint8_t *rgba, int width, int height, uint8_t **bytes, size_t *size) {
  (void)rgba, (void)width, (void)height;
  *bytes = NULL;
  *size = 0;
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "this build of PAGS writes no SOG, since it has no libwebp");
}

#endif
