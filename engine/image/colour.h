/* SPDX-License-Identifier: Apache-2.0 */
/* Colour spaces of picture files, and their conversion to sRGB (IEC 61966-2-1): ICC profiles of a matrix and three
 * curves (ICC.1:2022), code points of video (ITU-T H.273), gamma and primaries of PNG, primaries of EXR. */
#ifndef PAGS_IMAGE_COLOUR_H
#define PAGS_IMAGE_COLOUR_H

#include <stdbool.h>

#include <pags/image.h>

enum { PAGS_CURVE_STEPS = 1024 };

/* What a file says of its colours. Zeros: nothing, which is sRGB for integers and linear light with the primaries of
 * sRGB for floats. */
typedef struct pags_colour {
  pags_colour_kind kind;
  char name[PAGS_IMAGE_NAME];           /* of the space, for messages */
  bool encoded;                         /* float samples are encoded by the curves, too */
  float matrix[9];                      /* from the light of the picture to that of sRGB's primaries, row by row */
  float light[3][PAGS_CURVE_STEPS + 1]; /* linear light of the samples 0, 1/1024, ..., 1 of each channel */
} pags_colour;

/* A space that is not known, or not converted here. */
void pags_colour_set_unknown(pags_colour *out, const char *name);

/* An ICC profile. Profiles of tables alone, as those of CMYK are, are not converted. */
void pags_colour_set_icc(pags_colour *out, const uint8_t *profile, size_t size);

/* Primaries and transfer characteristics by their numbers in H.273. PQ and HLG are not converted. */
void pags_colour_set_cicp(pags_colour *out, int primaries, int transfer, bool full_range);

/* Samples that are light to the power of `gamma`, 0: by the curve of sRGB. `xy`: the chromaticities of red, green, blue
 * and white, NULL: those of sRGB. `name` NULL: by its numbers. */
void pags_colour_set_gamma(pags_colour *out, double gamma, const double xy[8], const char *name);
void pags_colour_set_adobe_rgb(pags_colour *out);

/* Primaries of linear light. */
void pags_colour_set_primaries(pags_colour *out, const double xy[8]);

/* Copies kind and name. */
void pags_colour_state(const pags_colour *colour, pags_image_facts *facts);

/* Converts a picture of 3 or 4 channels to display-referred sRGB of U8 with straight alpha. PAGS_ERROR_FORMAT for an
 * unknown space, PAGS_ERROR_MEMORY; then it stays as it was. */
pags_result pags_colour_convert(const pags_colour *colour, const char *path, pags_image *image);

/* Fails with PAGS_ERROR_FORMAT because the space of a picture is not known. */
pags_result pags_colour_refuse(const char *path, const char *space);

#endif
