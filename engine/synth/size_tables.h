/* SPDX-License-Identifier: Apache-2.0 */
/* Quantiles of the scales and opacities of Gaussians in trained street scenes, from which surface.c draws the
 * Gaussians of a town. Measured by scripts/size_tables.py.
 *
 * Ground and house fronts were measured on the background of a trained real street (`pags train pandaset-002
 * --iterations 10000`; 3 cameras of 960x540, SH degree 1, 753 thousand Gaussians): 22 x 8 m of road in front of the
 * car (33 thousand Gaussians) and two house fronts 20 and 28 m next to it (8 thousand). Things were measured on parked
 * cars and trees of a trained synthetic street (`pags synth street`; 40 frames, 3 cameras of 480x270; 3,000 steps; 59
 * thousand Gaussians), because few of them are visible in the real one. House fronts in that synthetic street are
 * fainter, since it was trained for far fewer steps: half of the opacities lie below 0.12 instead of 0.27, and the
 * optical thickness (sum of -ln(1 - alpha) along a line at right angles to the wall) is 4 instead of 8 to 14.
 *
 * The axes of a Gaussian are sorted by length. The logarithm of the longest scale, the two differences of logarithms
 * from each axis to the next shorter one and the logit of opacity are drawn jointly, with the rank correlations of
 * opacity with the first two; the rank correlations between the axes are below 0.13 and are left out. */
#ifndef PAGS_SYNTH_SIZE_TABLES_H
#define PAGS_SYNTH_SIZE_TABLES_H

enum { PAGS_QUANTILES = 9 };

/* Densities of the trained scenes, in Gaussians per square metre of surface */
#define PAGS_TRAINED_DENSITY \
  150.0 /* of surfaces not listed below, from the synthetic street; pags_surface.area is weighted relative to it */
#define PAGS_TRAINED_FRONTS 107.0 /* measured: 81 to 133 */
#define PAGS_TRAINED_GROUND 189.0
#define PAGS_TRAINED_CARS 225.0  /* for cars and people; measured on the street side of parked cars */
#define PAGS_TRAINED_LEAVES 37.0 /* chosen so that tree crowns look closed */

#define PAGS_TRAINED_SPREAD \
  0.03f /* sigma of the distance of means from the surface, metres: half of that measured on road and fronts */
#define PAGS_TRAINED_DEGREE_1 0.0354f /* standard deviation of each SH coefficient of degree 1 */

/* The cumulative probabilities that the tables below are given at. */
static const float pags_quantile_shares[PAGS_QUANTILES] = {0.01f, 0.05f, 0.15f, 0.30f, 0.50f,
                                                           0.70f, 0.85f, 0.95f, 0.99f};

typedef struct pags_size_table {
  float ln_long[PAGS_QUANTILES]; /* ln of the sigma of the longest axis, metres; below: ln of the ratios of axes */
  float ln_middle_by_long[PAGS_QUANTILES], ln_short_by_middle[PAGS_QUANTILES];
  float logit_opacity[PAGS_QUANTILES];
  float opacity_with_long, opacity_with_middle; /* rank correlations of opacity with the first two rows */
} pags_size_table;

static const pags_size_table pags_size_ground = {
    .ln_long = {-4.273f, -3.641f, -3.102f, -2.670f, -2.277f, -1.917f, -1.611f, -1.282f, -0.916f},
    .ln_middle_by_long = {-3.490f, -2.471f, -1.654f, -1.075f, -0.641f, -0.338f, -0.159f, -0.051f, -0.010f},
    .ln_short_by_middle = {-3.709f, -2.727f, -1.815f, -1.145f, -0.704f, -0.391f, -0.187f, -0.058f, -0.011f},
    .logit_opacity = {-5.538f, -4.351f, -3.011f, -2.020f, -0.932f, 0.685f, 2.706f, 4.501f, 6.027f},
    .opacity_with_long = 0.02f,
    .opacity_with_middle = -0.08f};

static const pags_size_table pags_size_fronts = {
    .ln_long = {-3.047f, -2.646f, -2.301f, -2.052f, -1.714f, -1.214f, -0.853f, -0.488f, -0.072f},
    .ln_middle_by_long = {-6.627f, -4.403f, -2.771f, -1.760f, -0.998f, -0.528f, -0.237f, -0.072f, -0.012f},
    .ln_short_by_middle = {-4.585f, -3.470f, -2.282f, -1.444f, -0.802f, -0.427f, -0.193f, -0.060f, -0.011f},
    .logit_opacity = {-5.540f, -4.679f, -3.548f, -2.463f, -0.985f, 0.620f, 2.257f, 4.114f, 5.911f},
    .opacity_with_long = 0.38f,
    .opacity_with_middle = 0.10f};

static const pags_size_table pags_size_things = {
    .ln_long = {-3.501f, -3.133f, -2.790f, -2.526f, -2.262f, -1.997f, -1.752f, -1.453f, -1.054f},
    .ln_middle_by_long = {-3.900f, -2.329f, -1.546f, -1.019f, -0.644f, -0.362f, -0.175f, -0.056f, -0.011f},
    .ln_short_by_middle = {-3.107f, -1.999f, -1.232f, -0.785f, -0.487f, -0.275f, -0.137f, -0.046f, -0.009f},
    .logit_opacity = {-6.610f, -5.736f, -3.604f, -2.561f, -1.633f, -0.515f, 0.981f, 2.639f, 3.950f}};

#endif
