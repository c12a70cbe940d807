/* Sizes and opacities of a trained street's Gaussians, as quantiles.
 *
 * Measured by scripts/size_tables.py on the background of a scene that `pags train` made of `pags synth street` (40 frames, 3 cameras of
 * 480x270; 3,000 steps, degree 1, 350 thousand Gaussians), in the 37 m that the recording car drove along: on the road and the pavements
 * (82 thousand Gaussians), on house fronts 0.5 to 9 m high (88 thousand), on parked cars and trees (59 thousand). The axes of a
 * Gaussian are sorted by length; their logarithms' differences and the opacity are taken as independent (measured correlations of the three
 * and the logit of opacity: 0.45 long to middle axis, below 0.1 with opacity). There were 160 Gaussians a square metre of road and 139 of
 * fronts. */
#ifndef PAGS_SYNTH_SIZE_TABLES_H
#define PAGS_SYNTH_SIZE_TABLES_H

enum { PAGS_QUANTILES = 9 };

#define PAGS_TRAINED_DENSITY 150.0 /* Gaussians a square metre */
#define PAGS_TRAINED_LEAVES 0.25f  /* share of that on leaves, so that crowns close */
#define PAGS_TRAINED_CARS 1.5f    /* on cars and people: about 230 a square metre of the parked cars' street side */
#define PAGS_TRAINED_SPREAD 0.03f  /* sigma of the distance from the surface, metres: half of what road and fronts showed */
#define PAGS_TRAINED_DEGREE_1 0.0185f /* standard deviation of each coefficient of degree 1 */

static const float pags_quantile_shares[PAGS_QUANTILES] = {0.01f, 0.05f, 0.15f, 0.30f, 0.50f, 0.70f, 0.85f, 0.95f, 0.99f};

typedef struct pags_size_table {
  float ln_long[PAGS_QUANTILES]; /* ln sigma of the longest axis, metres */
  float ln_middle_by_long[PAGS_QUANTILES], ln_short_by_middle[PAGS_QUANTILES];
  float logit_opacity[PAGS_QUANTILES];
} pags_size_table;

static const pags_size_table pags_size_ground = {
    .ln_long = {-3.152f, -2.852f, -2.596f, -2.409f, -2.224f, -2.037f, -1.843f, -1.599f, -1.280f},
    .ln_middle_by_long = {-2.380f, -1.678f, -1.115f, -0.712f, -0.420f, -0.234f, -0.115f, -0.037f, -0.008f},
    .ln_short_by_middle = {-2.822f, -1.821f, -0.926f, -0.554f, -0.341f, -0.196f, -0.098f, -0.032f, -0.006f},
    .logit_opacity = {-6.613f, -5.925f, -3.438f, -2.531f, -1.711f, -0.742f, 0.502f, 1.946f, 3.222f}};

static const pags_size_table pags_size_fronts = {
    .ln_long = {-2.893f, -2.438f, -2.149f, -1.955f, -1.768f, -1.574f, -1.350f, -1.012f, -0.497f},
    .ln_middle_by_long = {-3.978f, -3.077f, -2.265f, -1.559f, -0.864f, -0.417f, -0.181f, -0.056f, -0.011f},
    .ln_short_by_middle = {-3.542f, -2.435f, -1.566f, -0.970f, -0.552f, -0.297f, -0.140f, -0.046f, -0.009f},
    .logit_opacity = {-6.571f, -5.030f, -3.523f, -2.744f, -1.984f, -1.093f, 0.216f, 2.127f, 3.899f}};

static const pags_size_table pags_size_things = {
    .ln_long = {-3.501f, -3.133f, -2.790f, -2.526f, -2.262f, -1.997f, -1.752f, -1.453f, -1.054f},
    .ln_middle_by_long = {-3.900f, -2.329f, -1.546f, -1.019f, -0.644f, -0.362f, -0.175f, -0.056f, -0.011f},
    .ln_short_by_middle = {-3.107f, -1.999f, -1.232f, -0.785f, -0.487f, -0.275f, -0.137f, -0.046f, -0.009f},
    .logit_opacity = {-6.610f, -5.736f, -3.604f, -2.561f, -1.633f, -0.515f, 0.981f, 2.639f, 3.950f}};

#endif
