/* pags train: from photographs to a scene folder. */
#include "interrupt.h"
#include "session.h"
#include "verbs.h"

#include <math.h>
#include <pags/dataset.h>
#include <pags/train.h>
#include <stdlib.h>
#include <string.h>

typedef struct train_arguments {
  pags_session session;
  const char *output;
  pags_dataset_options dataset;
  int reconstruction;
  pags_train_config config;
  pags_train_options options;
} train_arguments;

#define AT(member) offsetof(train_arguments, member)
#define CONFIG(member) offsetof(train_arguments, config.member)
#define RUN(member) offsetof(train_arguments, options.member)
#define GROUP(text) {.type = PAGS_OPTION_GROUP, .help = text}
#define STEPS "steps of 30 000"

static const pags_option options[] = {
    {.name = "output", .short_name = 'o', .type = PAGS_OPTION_STRING, .offset = AT(output), .metavar = "SCENE",
     .help = "folder to write the scene to; needed unless --estimate"},

    GROUP("The run"),
    {.name = "iterations", .short_name = 'n', .type = PAGS_OPTION_INT64, .offset = CONFIG(iterations), .minimum = 1,
     .maximum = HUGE_VAL, .metavar = "N", .unit = "steps", .help = "how long to train; the schedule stretches with it"},
    {.name = "schedule-iterations", .type = PAGS_OPTION_INT64, .offset = CONFIG(schedule_iterations), .minimum = 0,
     .maximum = HUGE_VAL, .metavar = "N", .unit = "steps", .fallback = "0: as --iterations",
     .help = "stretch the schedule over so many; steps beyond run at its end rates"},
    {.name = "resume", .type = PAGS_OPTION_FLAG, .offset = RUN(resume),
     .help = "go on from SCENE's checkpoint, or start where there is none; --iterations may be larger than before"},
    {.name = "overwrite", .type = PAGS_OPTION_FLAG, .offset = RUN(overwrite),
     .help = "train afresh into a SCENE that is not empty"},
    {.name = "checkpoint-every", .type = PAGS_OPTION_INT64, .offset = RUN(checkpoint_every), .minimum = 0,
     .maximum = HUGE_VAL, .metavar = "N", .unit = "steps; 0: only at the end", .help = "write a checkpoint every N steps"},
    {.name = "log-every", .type = PAGS_OPTION_INT64, .offset = RUN(log_every), .minimum = 1, .maximum = HUGE_VAL,
     .metavar = "N", .unit = "steps", .help = "add a line to SCENE/log.jsonl every N steps"},
    {.name = "preview-every", .type = PAGS_OPTION_INT64, .offset = RUN(preview_every), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "N", .unit = "steps; 0: none", .help = "write a preview PNG every N steps"},
    {.name = "time-limit", .type = PAGS_OPTION_DURATION, .offset = RUN(time_limit_seconds), .minimum = 1,
     .maximum = HUGE_VAL, .metavar = "TIME", .unit = "90s, 30m, 2h", .fallback = "none",
     .help = "set the number of steps from the speed measured early, so that the run fits; not reproducible"},
    {.name = "estimate", .type = PAGS_OPTION_FLAG, .offset = RUN(estimate),
     .help = "run 50 steps, print minutes and memory of the whole run, write nothing"},
    {.name = "seed", .type = PAGS_OPTION_UINT64, .offset = CONFIG(seed), .metavar = "N", .help = "of everything random"},

    GROUP("The photographs"),
    {.name = "downscale", .type = PAGS_OPTION_DOUBLE, .offset = AT(dataset.downscale), .minimum = 1, .maximum = 64,
     .metavar = "F", .unit = "times", .help = "shrink the photographs"},
    {.name = "split-every", .type = PAGS_OPTION_INT, .offset = AT(dataset.split_every), .minimum = 0, .maximum = 1e9,
     .metavar = "N", .unit = "views; 0: none", .help = "hold out every Nth photograph, in file-name order, for eval"},
    {.name = "reconstruction", .type = PAGS_OPTION_FLAG, .offset = AT(reconstruction),
     .help = "hold nothing out: train on every photograph"},
    {.name = "colmap", .type = PAGS_OPTION_STRING, .offset = AT(dataset.colmap), .metavar = "FOLDER",
     .help = "take cameras and points from this COLMAP model even where transforms.json exists"},
    {.name = "allow-missing", .type = PAGS_OPTION_FLAG, .offset = AT(dataset.allow_missing),
     .help = "leave out views whose photograph is missing; without it they are an error"},
    {.name = "random-points", .type = PAGS_OPTION_INT64, .offset = AT(dataset.random_points), .minimum = 1, .maximum = 1e8,
     .metavar = "N", .help = "Gaussians to start from where the data set has no points"},
    {.name = "image-cache", .type = PAGS_OPTION_SIZE, .offset = RUN(image_cache), .minimum = 1, .maximum = HUGE_VAL,
     .metavar = "SIZE", .unit = "bytes; K, M, G", .fallback = "1G, at most a quarter of the memory allowed",
     .help = "memory for decoded photographs"},

    GROUP("Bounds"),
    {.name = "max-gaussians", .type = PAGS_OPTION_INT64, .offset = CONFIG(max_gaussians), .minimum = 0,
     .maximum = 2147483584.0, .metavar = "N", .fallback = "0: none; 1000000 with --strategy mcmc",
     .help = "never have more Gaussians"},
    {.name = "max-memory", .type = PAGS_OPTION_SIZE, .offset = RUN(max_memory), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "SIZE", .unit = "bytes; K, M, G; 0: none",
     .fallback = "four fifths of what affinity and cgroup allow, less the image cache",
     .help = "turned into a bound on Gaussians by their number and the picture's size"},

    GROUP("Density"),
    {.name = "strategy", .type = PAGS_OPTION_ENUM, .offset = CONFIG(strategy), .metavar = "default|mcmc",
     .help = "default: clone, split, prune and reset (Kerbl et al. 2023); mcmc: relocate, grow and shake (Kheradmand et al. "
             "2024)"},
    {.name = "densify-from", .type = PAGS_OPTION_INT64, .offset = CONFIG(densify_from), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "N", .unit = STEPS, .help = "densify after this step"},
    {.name = "densify-until", .type = PAGS_OPTION_INT64, .offset = CONFIG(densify_until), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "N", .unit = STEPS, .help = "densify before this step"},
    {.name = "densify-every", .type = PAGS_OPTION_INT64, .offset = CONFIG(densify_every), .minimum = 1, .maximum = HUGE_VAL,
     .metavar = "N", .unit = STEPS, .help = "how often, but at most once a pass over the training views"},
    {.name = "densify-gradient", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(densify_gradient), .minimum = 0,
     .maximum = HUGE_VAL, .metavar = "G", .unit = "NDC", .help = "mean screen gradient above which to clone or split"},
    {.name = "absgrad", .type = PAGS_OPTION_FLAG, .offset = CONFIG(absgrad),
     .help = "judge by absolute per-pixel gradients (Ye et al. 2024)"},
    {.name = "absgrad-gradient", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(absgrad_gradient), .minimum = 0,
     .maximum = HUGE_VAL, .metavar = "G", .unit = "NDC", .help = "the threshold with --absgrad"},
    {.name = "dense-percent", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(dense_percent), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "F", .unit = "of the scene's extent", .help = "larger Gaussians are split, smaller ones cloned"},
    {.name = "split-divisor", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(split_divisor), .minimum = 1, .maximum = 100,
     .metavar = "F", .help = "children's sigma is the parent's over this"},
    {.name = "revised-opacity", .type = PAGS_OPTION_FLAG, .offset = CONFIG(revised_opacity),
     .help = "children of a split get 1 - sqrt(1 - o) (Rota Bulo et al. 2024)"},
    {.name = "prune-opacity", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(prune_opacity), .minimum = 0, .maximum = 1,
     .metavar = "F", .help = "Gaussians below are removed"},
    {.name = "prune-scale", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(prune_scale), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "F", .unit = "of the scene's extent", .help = "larger Gaussians are removed once opacities were reset"},
    {.name = "reset-every", .type = PAGS_OPTION_INT64, .offset = CONFIG(reset_every), .minimum = 1, .maximum = HUGE_VAL,
     .metavar = "N", .unit = STEPS, .help = "how often opacities are reset, but at most once in three passes"},
    {.name = "reset-opacity", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(reset_opacity), .minimum = 0, .maximum = 1,
     .metavar = "F", .help = "upper bound that a reset sets"},
    {.name = "mcmc-growth", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(mcmc_growth), .minimum = 0, .maximum = 10,
     .metavar = "F", .help = "mcmc: share of new Gaussians per densify step"},
    {.name = "mcmc-noise", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(mcmc_noise), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "F", .unit = "times the position rate", .help = "mcmc: noise on positions"},
    {.name = "mcmc-opacity-reg", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(mcmc_opacity_reg), .minimum = 0,
     .maximum = HUGE_VAL, .metavar = "F", .help = "mcmc: weight of the mean opacity in the loss"},
    {.name = "mcmc-scale-reg", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(mcmc_scale_reg), .minimum = 0,
     .maximum = HUGE_VAL, .metavar = "F", .help = "mcmc: weight of the mean sigma in the loss"},

    GROUP("Optimiser, loss and start"),
    {.name = "position-rate", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(position_rate_begin), .minimum = 0,
     .maximum = HUGE_VAL, .metavar = "R", .unit = "times the extent", .help = "learning rate of positions at the start"},
    {.name = "position-rate-end", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(position_rate_end), .minimum = 0,
     .maximum = HUGE_VAL, .metavar = "R", .unit = "times the extent", .help = "and at the end; log-linear between"},
    {.name = "scale-rate", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(scale_rate), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "R", .help = "learning rate of ln sigma"},
    {.name = "rotation-rate", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(rotation_rate), .minimum = 0,
     .maximum = HUGE_VAL, .metavar = "R", .help = "learning rate of quaternions"},
    {.name = "opacity-rate", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(opacity_rate), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "R", .help = "learning rate of opacity logits"},
    {.name = "sh-dc-rate", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(sh_dc_rate), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "R", .help = "learning rate of the constant colour term"},
    {.name = "sh-rest-rate", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(sh_rest_rate), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "R", .help = "learning rate of the higher colour terms"},
    {.name = "beta1", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(beta1), .minimum = 0, .maximum = 0.9999,
     .metavar = "F", .help = "Adam's decay of the first moment"},
    {.name = "beta2", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(beta2), .minimum = 0, .maximum = 0.999999,
     .metavar = "F", .help = "Adam's decay of the second moment"},
    {.name = "epsilon", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(epsilon), .minimum = 0, .maximum = 1, .metavar = "F",
     .help = "added to the root of Adam's second moment"},
    {.name = "ssim-weight", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(ssim_weight), .minimum = 0, .maximum = 1,
     .metavar = "W", .help = "the loss is (1 - W) L1 + W (1 - SSIM)"},
    {.name = "init-opacity", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(init_opacity), .minimum = 0, .maximum = 1,
     .metavar = "F", .help = "opacity of the first Gaussians"},
    {.name = "init-scale", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(init_scale), .minimum = 0, .maximum = HUGE_VAL,
     .metavar = "F", .unit = "times the distance to the 3 nearest neighbours", .help = "their sigma"},
    {.name = "init-scale-max", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(init_scale_max), .minimum = 0,
     .maximum = HUGE_VAL, .metavar = "F", .unit = "of the scene's extent", .help = "upper bound of their sigma"},

    GROUP("Picture"),
    {.name = "sh-degree", .type = PAGS_OPTION_INT, .offset = CONFIG(sh_degree), .minimum = 0, .maximum = 3, .metavar = "0..3",
     .help = "highest degree of the spherical harmonics of colour"},
    {.name = "sh-interval", .type = PAGS_OPTION_INT64, .offset = CONFIG(sh_interval), .minimum = 1, .maximum = HUGE_VAL,
     .metavar = "N", .unit = STEPS, .help = "one degree more every so many steps"},
    {.name = "quarter-until", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(quarter_until), .minimum = 0, .maximum = 1,
     .metavar = "F", .unit = "of the schedule", .help = "train at a quarter of the size until then"},
    {.name = "half-until", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(half_until), .minimum = 0, .maximum = 1,
     .metavar = "F", .unit = "of the schedule", .help = "train at half of the size until then"},
    {.name = "resolution-floor", .type = PAGS_OPTION_INT, .offset = CONFIG(resolution_floor), .minimum = 1,
     .maximum = 65535, .metavar = "N", .unit = "pixels", .help = "skip levels whose shorter side would be smaller"},
    {.name = "antialiased", .type = PAGS_OPTION_FLAG, .offset = CONFIG(antialiased),
     .help = "scale opacities by what the low-pass takes (Mip-Splatting's 2D filter)"},
    {.name = "low-pass", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(low_pass), .minimum = 0, .maximum = 100,
     .metavar = "V", .unit = "px^2", .help = "added to both variances on the screen"},
    {.name = "near", .type = PAGS_OPTION_DOUBLE, .offset = CONFIG(near_plane), .minimum = 1e-6, .maximum = HUGE_VAL,
     .metavar = "Z", .unit = "metres", .help = "don't draw Gaussians nearer than this"},
    {.name = "background", .type = PAGS_OPTION_COLOR, .offset = CONFIG(background), .metavar = "R,G,B",
     .unit = "sRGB, 0..1", .help = "colour behind everything"},
    {.name = "cluster-size", .type = PAGS_OPTION_INT, .offset = CONFIG(cluster_size), .minimum = 16, .maximum = 256,
     .metavar = "N", .unit = "Gaussians; a multiple of 16", .help = "culled together; changes speed, not results"},
    PAGS_SESSION_OPTIONS(train_arguments),
    {0}};

static const pags_positional positionals[] = {
    {"DATASET", "a folder with transforms.json (nerfstudio, instant-ngp) or a COLMAP model and images, or a transforms file"},
    {NULL, NULL}};

static const pags_verb verb = {
    .name = "train",
    .usage = "DATASET -o SCENE [options]",
    .about = "Reconstructs a scene from posed photographs. Ctrl-C or SIGTERM writes a checkpoint and the scene as it stands and "
             "exits with 3; --resume goes on to the same bits as if nothing had happened. Options counted in \"" STEPS
             "\" are multiplied by iterations / 30 000.",
    .positionals = positionals,
    .options = options};

typedef struct watcher {
  pags_progress progress;
} watcher;

static int show_progress(void *user, const pags_train_progress *now) {
  watcher *watch = user;
  char eta[32], size[24] = "";
  if (!pags_progress_due(&watch->progress))
    return 1;
  if (now->level > 1)
    snprintf(size, sizeof size, ", 1/%d size", now->level);
  pags_progress_show(&watch->progress, "step %lld of %lld%s, %.1f it/s, %lld Gaussians, loss %.4f, PSNR %.2f dB, %s left",
                     (long long)now->step, (long long)now->iterations, size, now->it_per_second,
                     (long long)now->gaussians, now->loss, now->psnr,
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
             (long long)arguments->config.iterations,
             pags_format_duration(result->estimated_seconds, time, sizeof time),
             pags_format_bytes((double)result->estimated_bytes, memory, sizeof memory));
    return;
  }
  pags_say(&arguments->session, "%s: %lld Gaussians after %lld steps; %s in this run, %.1f it/s at the end, peak memory %s\n",
           arguments->output, (long long)result->gaussians, (long long)result->iterations,
           pags_format_duration(result->seconds, time, sizeof time), result->iterations_per_second,
           pags_format_bytes((double)result->peak_rss_bytes, memory, sizeof memory));
}

static void describe_dataset(const train_arguments *arguments, const pags_dataset *dataset) {
  int64_t count = pags_dataset_view_count(dataset), held_out = 0, points;
  const float *xyz;
  const uint8_t *rgb;
  int random;
  for (int64_t i = 0; i < count; ++i)
    held_out += pags_dataset_view(dataset, i)->test;
  pags_dataset_points(dataset, &points, &xyz, &rgb, &random);
  const pags_camera *camera = &pags_dataset_view(dataset, 0)->camera;
  pags_say(&arguments->session, "%s: %lld views of %dx%d to train on, %lld held out, %lld %s (%s)\n",
           pags_dataset_path(dataset), (long long)(count - held_out), camera->width, camera->height, (long long)held_out,
           (long long)points, random ? "random points" : "points", pags_dataset_kind(dataset));
}

static pags_result train(train_arguments *arguments, const char *path, pags_train_result *result) {
  pags_dataset *dataset;
  watcher watch;
  PAGS_TRY(pags_dataset_open(path, &arguments->dataset, &dataset));
  if (pags_dataset_view_count(dataset) > 0)
    describe_dataset(arguments, dataset);
  watch.progress = pags_progress_begin(arguments->session.people);
  arguments->options.dataset = dataset;
  arguments->options.output = arguments->output;
  arguments->options.tasks = arguments->session.tasks;
  arguments->options.cancel = pags_interrupt_flag();
  arguments->options.progress = show_progress;
  arguments->options.progress_user = &watch;
  pags_interrupt_install(NULL); /* the trainer polls the flag and comes to the end of its step */
  pags_result status = pags_train(&arguments->config, &arguments->options, result);
  pags_progress_end(&watch.progress);
  pags_dataset_close(dataset);
  return status;
}

static int usage_conflict(const train_arguments *arguments, const pags_parsed *parsed) {
  if (!arguments->output && !arguments->options.estimate)
    return pags_usage_error(&verb, "-o SCENE is missing; usage: pags train %s", verb.usage);
  if (arguments->options.resume && arguments->options.overwrite)
    return pags_usage_error(&verb, "--resume and --overwrite exclude each other");
  if (arguments->reconstruction && pags_option_given(parsed, "split-every"))
    return pags_usage_error(&verb, "--reconstruction and --split-every exclude each other");
  if (arguments->config.cluster_size % 16)
    return pags_usage_error(&verb, "--cluster-size: expected a multiple of 16, got '%d'", arguments->config.cluster_size);
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
  if (usage_conflict(&arguments, &parsed))
    return PAGS_EXIT_USAGE;
  if (arguments.reconstruction)
    arguments.dataset.split_every = 0;
  arguments.dataset.seed = arguments.config.seed;
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
    outcome = pags_fail(PAGS_CANCELLED, "interrupted after step %lld; the state is saved in %s, --resume goes on from it",
                        (long long)result.iterations, arguments.output);
  return pags_session_end(&arguments.session, outcome);
}
