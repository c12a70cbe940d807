/* SPDX-License-Identifier: Apache-2.0 */
/* Makes SOG and glTF files without the library's readers and writers, except the wrapper of libwebp. Functions abort
 * if memory runs out. */
#ifndef PAGS_TESTS_WEB_FILES_H
#define PAGS_TESTS_WEB_FILES_H

#include "splat_files.h"

/* A lossless picture of `width` x `height` pixels whose channels are value(i, channel). */
file_bytes make_webp(int width, int height, uint8_t (*value)(int i, int channel));

/* A SOG of 5 Gaussians in pictures of 4 x 4 pixels, of version 1 or 2 and SH degree 0 or 1; sog_pixel gives its
 * pixels. files[0] is meta.json, the others are in the order of sog_names. */
enum { SOG_FILES = 8, SOG_COUNT = 5 };
extern const char *const sog_names[SOG_FILES];
void make_sog(int version, int sh_degree, file_bytes files[SOG_FILES]);
uint8_t sog_pixel(int file, int i, int channel);
void free_sog(file_bytes files[SOG_FILES]);

/* A zip archive of the files whose size isn't 0; `deflate` packs them. `prefix` comes before the names. */
file_bytes make_zip(const char *const *names, const file_bytes *files, int count, const char *prefix, int deflate);

/* Makes a .glb file of the JSON and the binary chunk. */
file_bytes make_glb(const char *json, const file_bytes *chunk);

#endif
