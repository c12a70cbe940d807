/* SPDX-License-Identifier: Apache-2.0 */
/* pags train: from photographs to a scene folder. */
#include "cli/interrupt.h"
#include "cli/session.h"
#include "cli/verbs.h"

#include <math.h>
#include <pags/dataset.h>
#include <pags/train.h>
#include <stdlib.h>
#include <string.h>
#include "base/text.h"

typedef struct train_arguments {
  pags_session session;
  const char *output;
  pags_dataset_options dataset;
  int reconstruction;
  const char *prune_rate;
  pags_train_config config;
  pags_train_options options;
} train_arguments;

#define AT(member) offsetof(train_arguments, member)
#define CONFIG(member) offsetof(train_arguments, config.member)
#define RUN(member) offsetof(train_arguments, options.member)
#define STEPS "steps of 30 000"

static const pags_option options[] = {
    PAGS_TEXT("output", 'o', AT(output), "SCENE", NULL, "folder to write the scene to; needed unless --estimate"),

    PAGS_GROUP("The run"),
    PAGS_VALUE("iterations", 'n', INT64, CONFIG(schedule.iterations), 1, PAGS_UNLIMITED, "N", "steps", NULL,
               "how long to train; the schedule stretches with it"),
    PAGS_VALUE("schedule-iterations", 0, INT64, CONFIG(schedule.schedule_iterations), 0, PAGS_UNLIMITED, "N", "steps",
               "0: as --iterations", "stretch the schedule over so many; steps beyond run at its end rates"),
    PAGS_FLAG("resume", 0, RUN(resume),
              "go on from SCENE's checkpoint, or start where there is neither that nor a scene; --iterations may be "
              "larger than before"),
    PAGS_FLAG("overwrite", 0, RUN(overwrite), "train afresh into a SCENE that is not empty"),
    PAGS_VALUE("checkpoint-every", 0, INT64, RUN(checkpoint_every), 0, PAGS_UNLIMITED, "N", "steps; 0: only at the end",
               NULL, "write a checkpoint every N steps"),
    PAGS_VALUE("log-every", 0, INT64, RUN(log_every), 1, PAGS_UNLIMITED, "N", "steps", NULL,
               "add a line to SCENE/log.jsonl every N steps"),
    PAGS_VALUE("preview-every", 0, INT64, RUN(preview_every), 0, PAGS_UNLIMITED, "N", "steps; 0: none", NULL,
               "write a preview PNG every N steps"),
    PAGS_VALUE("time-limit", 0, DURATION, RUN(time_limit_seconds), 1, PAGS_UNLIMITED, "TIME", "90s, 30m, 2h", "none",
               "set the number of steps from the speed measured early, so that the run fits; not reproducible"),
    PAGS_VALUE("max-bad-rows", 0, INT64, RUN(bad_rows_most), 0, PAGS_UNLIMITED, "N", "updates", NULL,
               "fail when more updates than that had to be left out because a number wasn't finite"),
    PAGS_FLAG("estimate", 0, RUN(estimate), "run 50 steps, print minutes and memory of the whole run, write nothing"),
    PAGS_VALUE("seed", 0, UINT64, CONFIG(schedule.seed), 0, 0, "N", NULL, NULL, "of everything random"),

    PAGS_GROUP("The photographs"),
    PAGS_VALUE("downscale", 0, DOUBLE, AT(dataset.downscale), 1, 64, "F", "times", NULL, "shrink the photographs"),
    PAGS_VALUE(
        "split-every", 0, INT, AT(dataset.split_every), 0, 1e9, "N", "views or time steps; 0: none",
        "8; driving sets 4",
        "hold out every Nth photograph, in file-name order, for eval; of driving sets all cameras of every Nth time "
        "step"),
    PAGS_FLAG("reconstruction", 0, AT(reconstruction), "hold nothing out: train on every photograph"),
    PAGS_TEXT("colmap", 0, AT(dataset.colmap), "FOLDER", NULL,
              "take cameras and points from this COLMAP model even where transforms.json exists"),
    PAGS_FLAG("allow-missing", 0, AT(dataset.allow_missing),
              "leave out views whose photograph is missing; without it they are an error"),
    PAGS_DRIVING_OPTIONS(AT(dataset)),
    PAGS_VALUE("random-points", 0, INT64, AT(dataset.random_points), 1, 1e8, "N", NULL, NULL,
               "how many points to start from where the data set has none"),
    PAGS_VALUE("image-cache", 0, SIZE, RUN(image_cache), 1, PAGS_UNLIMITED, "SIZE", "bytes; K, M, G",
               "1G, at most a quarter of the memory allowed", "memory for decoded photographs"),

    PAGS_GROUP("Driving scenes (see docs/driving.md)"),
    PAGS_FLAG("no-objects", 0, CONFIG(objects.objects), "leave moving things in the background"),
    PAGS_FLAG("no-tracks", 0, CONFIG(objects.tracks), "take poses of moving objects as labelled"),
    PAGS_FLAG("no-fourier", 0, CONFIG(objects.fourier), "no object's colour changes over time"),
    PAGS_FLAG("no-sky", 0, CONFIG(sky.sky), "no cube map behind everything"),
    PAGS_FLAG("no-lidar-start", 0, CONFIG(start.lidar_start), "don't start from LiDAR points"),
    PAGS_FLAG("no-exposure", 0, CONFIG(exposure.exposure), "no gain and offset per photograph"),
    PAGS_FLAG("no-box-prune", 0, CONFIG(objects.box_prune), "keep objects' Gaussians that stray out of their boxes"),
    PAGS_VALUE("depth-weight", 0, DOUBLE, CONFIG(losses.depth_weight), 0, 1e3, "W", "per metre; 0: none", NULL,
               "of the LiDAR depth term"),
    PAGS_VALUE("depth-share", 0, DOUBLE, CONFIG(losses.depth_share), 0.01, 1, "F", NULL, NULL,
               "of LiDAR samples that count, those that fit best"),
    PAGS_VALUE("lidar-pull", 0, DOUBLE, CONFIG(density.lidar_pull), 0, 1, "F", "0: none", NULL,
               "move Gaussians of the background by this share of the way to a plane that LiDAR shows near them, as "
               "often as densify's "
               "interval"),
    PAGS_VALUE("sky-weight", 0, DOUBLE, CONFIG(losses.sky_weight), 0, 1e3, "W", "0: none", NULL,
               "of the sky opacity term"),
    PAGS_VALUE("object-weight", 0, DOUBLE, CONFIG(losses.object_weight), 0, 1e3, "W", "0: none", NULL,
               "of the object opacity term, once densifying is over"),
    PAGS_VALUE("tracks-from", 0, INT64, CONFIG(objects.tracks_from), 0, PAGS_UNLIMITED, "N", STEPS, NULL,
               "optimise poses after this step"),
    PAGS_VALUE("track-translation-rate", 0, DOUBLE, CONFIG(objects.track_translation_rate), 0, 1, "R", "metres", NULL,
               "learning rate of objects' positions; falls to a tenth"),
    PAGS_VALUE("track-rotation-rate", 0, DOUBLE, CONFIG(objects.track_rotation_rate), 0, 1, "R", "radians", NULL,
               "learning rate of objects' rotations; falls to a tenth"),
    PAGS_VALUE("fourier-from", 0, INT64, CONFIG(objects.fourier_from), 0, PAGS_UNLIMITED, "N", STEPS, NULL,
               "decide then whose colour changes over time"),
    PAGS_VALUE("fourier-gain", 0, DOUBLE, CONFIG(objects.fourier_gain), 0, 100, "G", "dB", NULL,
               "what that must promise on an object's pixels"),
    PAGS_VALUE("sky-rate", 0, DOUBLE, CONFIG(sky.sky_rate), 0, 1, "R", NULL, NULL,
               "learning rate of the sky; falls to a hundredth"),
    PAGS_VALUE("exposure-rate", 0, DOUBLE, CONFIG(exposure.exposure_rate), 0, 1, "R", NULL, NULL,
               "learning rate of exposures; falls to a tenth"),
    PAGS_VALUE("extent-most", 0, DOUBLE, CONFIG(start.extent_most), 1e-3, 1e6, "D", "metres", NULL,
               "upper bound of the background's extent, which rates and sizes are relative to"),

    PAGS_GROUP("Bounds"),
    PAGS_VALUE("max-gaussians", 0, INT64, CONFIG(size_limit.max_gaussians), 0, 2147483584.0, "N", NULL,
               "0: none; 1000000 with --strategy mcmc",
               "never have more Gaussians; with --preset: keep those with the highest scores at its last prune"),
    PAGS_VALUE("max-memory", 0, SIZE, RUN(max_memory), 0, PAGS_UNLIMITED, "SIZE", "bytes; K, M, G; 0: none",
               "four fifths of what affinity and cgroup allow, less the image cache",
               "turned into a bound on Gaussians by their number and the picture's size"),

    PAGS_VALUE("target-size", 0, DOUBLE, CONFIG(size_limit.target_size), 0, 1e9, "MB", "10^6 bytes; 0: none", NULL,
               "never have more Gaussians than scene.json, models and sky of the finished scene may hold in MB"),
    PAGS_VALUE("sh-error", 0, DOUBLE, CONFIG(size_limit.sh_error), 0, 255, "E", "255ths; 0: all keep theirs", NULL,
               "let each Gaussian of the scene keep the lowest degree of spherical harmonics that changes its colour "
               "by no more "
               "than E from wherever a training view sees it"),

    PAGS_GROUP("Priority (see docs/priority.md)"),
    PAGS_CHOICE("preset", CONFIG(priority.preset), "none|lean|short|paper", NULL,
                "prune by score: lean: after steps 4000, 8000, ... 20 000 of 30 000, what loses least; the paper's: "
                "short: after 10 000, 15 000, "
                "20 000, 25 000 of 30 000; paper: after 10 000, 15 000, ... 45 000 of 50 000"),
    PAGS_VALUE("alpha", 0, DOUBLE, CONFIG(priority.alpha), 0, 1, "A", NULL, NULL,
               "how much of the score is what shows vehicles and people; the rest is what the picture hangs on"),
    PAGS_CHOICE("hybrid", CONFIG(priority.hybrid), "preset|sum|product", "preset: product with lean, otherwise sum",
                "the score: sum: A times the one plus 1 - A times the other; product: the other, times 1 - A where "
                "nothing critical is shown"),
    PAGS_VALUE("critical-weight", 0, DOUBLE, CONFIG(priority.critical_weight), 1, 100, "W", "times",
               "1; 1 + 5 A with --preset lean", "count pixels that show vehicles and people W times in the loss"),
    PAGS_VALUE("critical-growth", 0, DOUBLE, CONFIG(priority.critical_growth), 1, 100, "G", "times",
               "as --critical-weight",
               "count them G times where it is decided what to clone and split; 1: no more than the rest"),
    PAGS_TEXT("prune-rate", 0, AT(prune_rate), "EARLY/LATE", "0.6/0.3; 0.5/0.2 with lean",
              "share of the Gaussians removed at the first three prunes, and at those after"),
    PAGS_VALUE("prune-floor", 0, INT64, CONFIG(priority.prune_floor), 0, 2147483584.0, "N", NULL, NULL,
               "prune no object below so many Gaussians"),
    PAGS_CHOICE("s-sem", CONFIG(priority.s_sem), "pass|init|overlap", NULL,
                "what shows vehicles and people: by weight in the photographs, anew at each prune; as at the start; or "
                "by mere overlap"),
    PAGS_CHOICE("s-grad", CONFIG(priority.s_grad), "rank|minmax|log", NULL, "how the other score is brought to 0..1"),
    PAGS_CHOICE("s-grad-from", CONFIG(priority.s_grad_from), "pass|training", NULL,
                "take it from a pass over the training views, or from the loss's gradients since the last prune"),

    PAGS_GROUP("Density"),
    PAGS_CHOICE(
        "strategy", CONFIG(density.strategy), "default|mcmc", NULL,
        "default: clone, split, prune and reset (Kerbl et al. 2023); mcmc: relocate, grow and shake (Kheradmand "
        "et al. 2024)"),
    PAGS_VALUE("densify-from", 0, INT64, CONFIG(density.densify_from), 0, PAGS_UNLIMITED, "N", STEPS, NULL,
               "densify after this step"),
    PAGS_VALUE("densify-until", 0, INT64, CONFIG(density.densify_until), 0, PAGS_UNLIMITED, "N", STEPS,
               "15000; 12000 with --preset lean, 25000 with short", "densify before this step"),
    PAGS_VALUE("densify-every", 0, INT64, CONFIG(density.densify_every), 1, PAGS_UNLIMITED, "N", STEPS, NULL,
               "how often, but at most once a pass over the training views"),
    PAGS_VALUE("densify-gradient", 0, DOUBLE, CONFIG(density.densify_gradient), 0, PAGS_UNLIMITED, "G", "NDC", NULL,
               "mean screen gradient above which to clone or split"),
    PAGS_FLAG("absgrad", 0, CONFIG(density.absgrad), "judge by absolute per-pixel gradients (Ye et al. 2024)"),
    PAGS_VALUE("absgrad-gradient", 0, DOUBLE, CONFIG(density.absgrad_gradient), 0, PAGS_UNLIMITED, "G", "NDC", NULL,
               "the threshold with --absgrad"),
    PAGS_VALUE("dense-percent", 0, DOUBLE, CONFIG(density.dense_percent), 0, PAGS_UNLIMITED, "F",
               "of the scene's extent", NULL, "larger Gaussians are split, smaller ones cloned"),
    PAGS_VALUE("split-divisor", 0, DOUBLE, CONFIG(density.split_divisor), 1, 100, "F", NULL, NULL,
               "children's sigma is the parent's over this"),
    PAGS_FLAG("revised-opacity", 0, CONFIG(density.revised_opacity),
              "children of a split get 1 - sqrt(1 - o) (Rota Bulo et al. 2024)"),
    PAGS_VALUE("prune-opacity", 0, DOUBLE, CONFIG(density.prune_opacity), 0, 1, "F", NULL, NULL,
               "Gaussians below are removed"),
    PAGS_VALUE("prune-scale", 0, DOUBLE, CONFIG(density.prune_scale), 0, PAGS_UNLIMITED, "F", "of the scene's extent",
               NULL, "larger Gaussians are removed once opacities were reset"),
    PAGS_VALUE("reset-every", 0, INT64, CONFIG(density.reset_every), 1, PAGS_UNLIMITED, "N", STEPS, NULL,
               "how often opacities are reset, but at most once in three passes"),
    PAGS_VALUE("reset-opacity", 0, DOUBLE, CONFIG(density.reset_opacity), 0, 1, "F", NULL, NULL,
               "upper bound that a reset sets"),
    PAGS_FLAG("dropout", 0, CONFIG(priority.dropout),
              "leave Gaussians out of steps at random, the less the higher their semantic priority"),
    PAGS_VALUE("dropout-beta", 0, DOUBLE, CONFIG(priority.dropout_beta), 0, 1, "F", NULL, NULL,
               "how much semantic priority protects: the share left out is (1 - F priority) gamma step / steps"),
    PAGS_VALUE("dropout-gamma", 0, DOUBLE, CONFIG(priority.dropout_gamma), 0, 0.9, "F", NULL, NULL,
               "share of Gaussians without priority that the last step leaves out"),
    PAGS_VALUE("mcmc-growth", 0, DOUBLE, CONFIG(mcmc.mcmc_growth), 0, 10, "F", NULL, NULL,
               "mcmc: share of new Gaussians per densify step"),
    PAGS_VALUE("mcmc-noise", 0, DOUBLE, CONFIG(mcmc.mcmc_noise), 0, PAGS_UNLIMITED, "F", "times the position rate",
               NULL, "mcmc: noise on positions"),
    PAGS_VALUE("mcmc-opacity-reg", 0, DOUBLE, CONFIG(mcmc.mcmc_opacity_reg), 0, PAGS_UNLIMITED, "F", NULL, NULL,
               "mcmc: weight of the mean opacity in the loss"),
    PAGS_VALUE("mcmc-scale-reg", 0, DOUBLE, CONFIG(mcmc.mcmc_scale_reg), 0, PAGS_UNLIMITED, "F", NULL, NULL,
               "mcmc: weight of the mean sigma in the loss"),

    PAGS_GROUP("Optimiser, loss and start"),
    PAGS_VALUE("position-rate", 0, DOUBLE, CONFIG(optimiser.position_rate_begin), 0, PAGS_UNLIMITED, "R",
               "times the extent", NULL, "learning rate of positions at the start"),
    PAGS_VALUE("position-rate-end", 0, DOUBLE, CONFIG(optimiser.position_rate_end), 0, PAGS_UNLIMITED, "R",
               "times the extent", NULL, "and at the end; log-linear between"),
    PAGS_VALUE("scale-rate", 0, DOUBLE, CONFIG(optimiser.scale_rate), 0, PAGS_UNLIMITED, "R", NULL, NULL,
               "learning rate of ln sigma"),
    PAGS_VALUE("rotation-rate", 0, DOUBLE, CONFIG(optimiser.rotation_rate), 0, PAGS_UNLIMITED, "R", NULL, NULL,
               "learning rate of quaternions"),
    PAGS_VALUE("opacity-rate", 0, DOUBLE, CONFIG(optimiser.opacity_rate), 0, PAGS_UNLIMITED, "R", NULL, NULL,
               "learning rate of opacity logits"),
    PAGS_VALUE("sh-dc-rate", 0, DOUBLE, CONFIG(optimiser.sh_dc_rate), 0, PAGS_UNLIMITED, "R", NULL, NULL,
               "learning rate of the constant colour term"),
    PAGS_VALUE("sh-rest-rate", 0, DOUBLE, CONFIG(optimiser.sh_rest_rate), 0, PAGS_UNLIMITED, "R", NULL, NULL,
               "learning rate of the higher colour terms"),
    PAGS_VALUE("beta1", 0, DOUBLE, CONFIG(optimiser.beta1), 0, 0.95, "F", NULL, NULL,
               "Adam's decay of the first moment"),
    PAGS_VALUE("beta2", 0, DOUBLE, CONFIG(optimiser.beta2), 0.95, 0.99999, "F", NULL, NULL,
               "Adam's decay of the second moment"),
    PAGS_VALUE("epsilon", 0, DOUBLE, CONFIG(optimiser.epsilon), 1e-20, 1, "F", NULL, NULL,
               "added to the root of Adam's second moment"),
    PAGS_VALUE("ssim-weight", 0, DOUBLE, CONFIG(losses.ssim_weight), 0, 1, "W", NULL, NULL,
               "the loss is (1 - W) L1 + W (1 - SSIM)"),
    PAGS_FLAG("random-start", 0, CONFIG(start.random_start),
              "where the data set has no points, start from random ones instead of matching the photographs"),
    PAGS_VALUE("init-opacity", 0, DOUBLE, CONFIG(start.init_opacity), 0, 1, "F", NULL, NULL,
               "opacity of the first Gaussians"),
    PAGS_VALUE("init-scale", 0, DOUBLE, CONFIG(start.init_scale), 0, PAGS_UNLIMITED, "F",
               "times the distance to the 3 nearest neighbours", NULL, "their sigma"),
    PAGS_VALUE("init-scale-max", 0, DOUBLE, CONFIG(start.init_scale_max), 0, PAGS_UNLIMITED, "F",
               "of the scene's extent", NULL, "upper bound of their sigma"),

    PAGS_GROUP("Picture"),
    PAGS_VALUE("sh-degree", 0, INT, CONFIG(color.sh_degree), 0, 3, "0..3", NULL, "3; driving sets 1",
               "highest degree of the spherical harmonics of colour"),
    PAGS_VALUE("sh-interval", 0, INT64, CONFIG(color.sh_interval), 0, PAGS_UNLIMITED, "N", STEPS, NULL,
               "one degree more every so many steps"),
    PAGS_VALUE("quarter-until", 0, DOUBLE, CONFIG(schedule.quarter_until), 0, 1, "F", "of the schedule", NULL,
               "train at a quarter of the size until then"),
    PAGS_VALUE("half-until", 0, DOUBLE, CONFIG(schedule.half_until), 0, 1, "F", "of the schedule", NULL,
               "train at half of the size until then"),
    PAGS_VALUE("resolution-floor", 0, INT, CONFIG(schedule.resolution_floor), 1, 65535, "N", "pixels", NULL,
               "skip levels whose shorter side would be smaller"),
    PAGS_FLAG("antialiased", 0, CONFIG(picture.antialiased),
              "scale opacities by what the low-pass takes (Mip-Splatting's 2D filter)"),
    PAGS_VALUE("low-pass", 0, DOUBLE, CONFIG(picture.low_pass), 0, 100, "V", "px^2", NULL,
               "added to both variances on the screen"),
    PAGS_VALUE("near", 0, DOUBLE, CONFIG(picture.near_plane), 1e-6, PAGS_UNLIMITED, "Z", "metres", NULL,
               "don't draw Gaussians nearer than this"),
    PAGS_VALUE("background", 0, COLOR, CONFIG(picture.background), 0, 0, "R,G,B", "sRGB, 0..1", NULL,
               "colour behind everything"),
    PAGS_VALUE("cluster-size", 0, INT, CONFIG(picture.cluster_size), 16, 256, "N", "Gaussians; a multiple of 16", NULL,
               "culled together; changes speed, not results"),
    PAGS_SESSION_OPTIONS(train_arguments),
    {0}};

static const pags_positional positionals[] = {{"DATASET",
                                               "a folder with transforms.json (nerfstudio, instant-ngp) or a COLMAP "
                                               "model and images, a transforms file, or a driving set in "
                                               "drivestudio's layout"},
                                              {NULL, NULL}};

static const pags_verb verb = {
    .name = "train",
    .usage = "DATASET -o SCENE [options]",
    .about =
        "Reconstructs a scene from posed photographs. Ctrl-C or SIGTERM writes a checkpoint and the scene as it "
        "stands and exits with 3; --resume goes on to the same bits as if nothing had happened. Options counted in "
        "\"" STEPS "\" are multiplied by iterations / 30 000.",
    .positionals = positionals,
    .options = options};

static int show_progress(void *user, const pags_train_progress *now) {
  pags_progress *progress = user;
  char eta[32], size[24] = "", bad[48] = "";
  if (!pags_progress_due(progress))
    return 1;
  if (now->level > 1)
    snprintf(size, sizeof size, ", 1/%d size", now->level);
  if (now->bad_rows > 0)
    snprintf(bad, sizeof bad, ", %lld rows left out", (long long)now->bad_rows);
  pags_progress_show(progress, "step %lld of %lld%s, %.1f it/s, %lld Gaussians, loss %.4f, PSNR %.2f dB%s, %s left",
                     (long long)now->step, (long long)now->iterations, size, now->it_per_second,
                     (long long)now->gaussians, now->loss, now->psnr, bad,
                     pags_format_duration(now->eta_seconds, eta, sizeof eta));
  return 1;
}

/* Memory and image cache where the command line says nothing: from what this process may use. The cache changes no bit;
 * the bound matters only to runs that would not fit. */
static void default_memory(train_arguments *arguments, const pags_parsed *parsed) {
  uint64_t available = pags_available_memory();
  if (!pags_option_given(parsed, "image-cache") && arguments->options.image_cache > available / 4)
    arguments->options.image_cache = available / 4;
  if (!pags_option_given(parsed, "max-memory")) {
    uint64_t most = available / 5 * 4, cache = arguments->options.image_cache;
    arguments->options.max_memory = most > 2 * cache ? most - cache : most / 2;
  }
}

static pags_result write_json(const train_arguments *arguments, const pags_train_result *result) {
  pags_json_writer writer;
  pags_json_writer_init(&writer, 2);
  pags_json_begin_object(&writer, NULL);
  if (arguments->options.estimate) {
    pags_json_put_number(&writer, "estimated_seconds", result->estimated_seconds);
    pags_json_put_unsigned(&writer, "estimated_bytes", result->estimated_bytes);
  }
  pags_json_put_bool(&writer, "finished", result->finished != 0);
  pags_json_put_bool(&writer, "resumed", result->resumed != 0);
  pags_json_put_integer(&writer, "iterations", result->iterations);
  pags_json_put_number(&writer, "seconds", result->seconds);
  pags_json_put_integer(&writer, "gaussians", result->gaussians);
  pags_json_put_unsigned(&writer, "peak_rss_bytes", result->peak_rss_bytes);
  pags_json_put_number(&writer, "iterations_per_second", result->iterations_per_second);
  pags_json_put_number(&writer, "loss", result->loss);
  pags_json_put_number(&writer, "psnr", result->psnr);
  pags_json_put_integer(&writer, "bad_rows", result->bad_rows);
  if (result->bad_rows > 0)
    pags_json_put_string(&writer, "first_bad_row", result->first_bad_row);
  pags_json_put_unsigned(&writer, "heap_calls_steady", result->heap_calls_steady);
  pags_json_begin_object(&writer, "ms");
  pags_json_put_number(&writer, "wait", result->ms_wait);
  pags_json_put_number(&writer, "forward", result->ms_forward);
  pags_json_put_number(&writer, "loss", result->ms_loss);
  pags_json_put_number(&writer, "backward", result->ms_backward);
  pags_json_put_number(&writer, "density", result->ms_density);
  pags_json_end_object(&writer);
  pags_json_end_object(&writer);
  return pags_session_json(&arguments->session, &writer);
}

static void report(const train_arguments *arguments, const pags_train_result *result) {
  char time[32], memory[32];
  if (arguments->options.estimate) {
    pags_say(&arguments->session, "%lld steps would take about %s and %s of memory\n",
             (long long)arguments->config.schedule.iterations,
             pags_format_duration(result->estimated_seconds, time, sizeof time),
             pags_format_bytes((double)result->estimated_bytes, memory, sizeof memory));
    return;
  }
  pags_say(&arguments->session,
           "%s: %lld Gaussians after %lld steps; %s in this run, %.1f it/s at the end, peak memory %s\n",
           arguments->output, (long long)result->gaussians, (long long)result->iterations,
           pags_format_duration(result->seconds, time, sizeof time), result->iterations_per_second,
           pags_format_bytes((double)result->peak_rss_bytes, memory, sizeof memory));
  if (result->bad_rows > 0)
    pags_say(&arguments->session, "%lld updates were left out because a number wasn't finite; the first was %s\n",
             (long long)result->bad_rows, result->first_bad_row);
}

static void describe_driving(const train_arguments *arguments, const pags_dataset *dataset) {
  int64_t objects = pags_dataset_object_count(dataset), moving = 0;
  for (int64_t i = 0; i < objects; i++)
    moving += pags_dataset_object(dataset, i)->moving;
  pags_say(&arguments->session, "%lld objects, %lld of them moving; %lld LiDAR sweeps\n", (long long)objects,
           (long long)moving, (long long)pags_dataset_sweep_count(dataset));
  for (int64_t i = 0; i < pags_dataset_note_count(dataset); i++)
    pags_say(&arguments->session, "  %s\n", pags_dataset_note(dataset, i));
}

static void describe_dataset(const train_arguments *arguments, const pags_dataset *dataset) {
  int64_t count = pags_dataset_view_count(dataset), held_out = 0, points;
  const float *xyz;
  const uint8_t *rgb;
  int random;
  for (int64_t i = 0; i < count; i++)
    held_out += pags_dataset_view(dataset, i)->test;
  pags_dataset_points(dataset, &points, &xyz, &rgb, &random);
  const pags_camera *camera = &pags_dataset_view(dataset, 0)->camera;
  if (pags_dataset_fps(dataset) > 0)
    describe_driving(arguments, dataset);
  const char *kind = !random ? "points" : arguments->config.start.random_start ? "random points" : "points to match";
  pags_say(&arguments->session, "%s: %lld views of %dx%d to train on, %lld held out, %lld %s (%s)\n",
           pags_dataset_path(dataset), (long long)(count - held_out), camera->width, camera->height,
           (long long)held_out, (long long)points, kind, pags_dataset_kind(dataset));
}

static pags_result train(train_arguments *arguments, const char *path, pags_train_result *result) {
  pags_dataset *dataset;
  PAGS_TRY(pags_dataset_open(path, &arguments->dataset, &dataset));
  if (pags_dataset_view_count(dataset) > 0)
    describe_dataset(arguments, dataset);
  pags_progress progress = pags_progress_begin(arguments->session.people);
  arguments->options.dataset = dataset;
  arguments->options.output = arguments->output;
  arguments->options.tasks = arguments->session.tasks;
  arguments->options.cancel = pags_interrupt_flag();
  arguments->options.progress = show_progress;
  arguments->options.progress_user = &progress;
  pags_interrupt_install(NULL); /* the trainer polls the flag and comes to the end of its step */
  pags_result status = pags_train(&arguments->config, &arguments->options, result);
  pags_progress_end(&progress);
  pags_dataset_close(dataset);
  return status;
}

static bool is_prune_rate(double share) {
  return share >= 0.0 && share <= 0.99;
}

/* "0.6/0.3" */
static int read_prune_rate(train_arguments *arguments) {
  const char *text = arguments->prune_rate;
  char *end = NULL;
  if (!text)
    return PAGS_EXIT_OK;
  arguments->config.priority.prune_early = pags_text_to_double(text, &end);
  if (end != text && *end == '/') {
    text = end + 1;
    arguments->config.priority.prune_late = pags_text_to_double(text, &end);
    if (end != text && !*end && is_prune_rate(arguments->config.priority.prune_early) &&
        is_prune_rate(arguments->config.priority.prune_late))
      return PAGS_EXIT_OK;
  }
  return pags_usage_error(&verb, "--prune-rate: expected EARLY/LATE, two numbers from 0 to 0.99, got '%s'",
                          arguments->prune_rate);
}

static int usage_conflict(const train_arguments *arguments, const pags_parsed *parsed) {
  if (!arguments->output && !arguments->options.estimate)
    return pags_usage_error(&verb, "-o SCENE is missing; usage: pags train %s", verb.usage);
  if (arguments->options.resume && arguments->options.overwrite)
    return pags_usage_error(&verb, "--resume and --overwrite exclude each other");
  if (arguments->reconstruction && pags_option_given(parsed, "split-every"))
    return pags_usage_error(&verb, "--reconstruction and --split-every exclude each other");
  if (pags_train_config_check(&arguments->config) != PAGS_OK)
    return pags_usage_error(&verb, "%s", pags_error_message());
  return PAGS_EXIT_OK;
}

int pags_verb_train(int argc, char **argv) {
  train_arguments arguments = {.dataset = pags_dataset_options_default(),
                               .config = pags_train_config_default(),
                               .options = pags_train_options_default()};
  pags_train_result result = {0};
  pags_parsed parsed;
  pags_parse_status status = pags_options_parse(&verb, argc, argv, &arguments, &parsed);
  if (status != PAGS_PARSE_OK)
    return status == PAGS_PARSE_HELP ? PAGS_EXIT_OK : PAGS_EXIT_USAGE;
  if (read_prune_rate(&arguments) || usage_conflict(&arguments, &parsed))
    return PAGS_EXIT_USAGE;
  if (arguments.reconstruction)
    arguments.dataset.split_every = 0;
  arguments.dataset.seed = arguments.config.schedule.seed;
  default_memory(&arguments, &parsed);

  pags_result outcome = pags_session_begin(&arguments.session);
  /* An absolute path, so that eval finds the data set again from any folder. */
  char *absolute = realpath(parsed.positionals[0], NULL);
  if (outcome == PAGS_OK)
    outcome = train(&arguments, absolute ? absolute : parsed.positionals[0], &result);
  free(absolute);
  if (outcome == PAGS_OK) {
    report(&arguments, &result);
    outcome = write_json(&arguments, &result);
  }
  if (outcome == PAGS_OK && !result.finished && !arguments.options.estimate)
    outcome =
        pags_fail(PAGS_CANCELLED, "interrupted after step %lld; the state is saved in %s, --resume goes on from it",
                  (long long)result.iterations, arguments.output);
  return pags_session_end(&arguments.session, outcome);
}
