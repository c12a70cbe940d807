/* SPDX-License-Identifier: Apache-2.0 */
/* The program pags: prints the general help, or finds the verb and runs it. */
#include "cli/common/ranks.h"
#include "cli/verbs/verbs.h"
#include "port/port.h"
#include "simd/kernels.h"

#include <build_facts.h>
#include <locale.h>

const char pags_program_name[] = "pags";

typedef struct verb_entry {
  const char *name, *summary;
  int (*run)(int argc, char **argv); /* NULL: the verb is not in this build */
  const char *lacking;               /* what this build lacks: of the verb, or if run is NULL the library; or NULL */
  bool shares;                       /* it runs on several ranks, which share its work out */
} verb_entry;

/* CMake defines PAGS_WITH_* for the optional parts that are built. */
#ifdef PAGS_WITH_SYNTH
#define IF_SYNTH(function) function, NULL
#else
#define IF_SYNTH(function) NULL, "Embree (CMake option PAGS_EMBREE)"
#endif
#ifdef PAGS_WITH_PROXIES
#define EXPORT_LACKS NULL
#else
#define EXPORT_LACKS "proxies, glTF and USD (CMake options PAGS_EXPORT and PAGS_EMBREE)"
#endif
#ifdef PAGS_WITH_IMPORT
#define IF_IMPORT(function) function, NULL
#else
#define IF_IMPORT(function) NULL, "the library import"
#endif

#ifdef PAGS_WITH_VIEW
#define IF_VIEW(function) function, NULL
#else
#define IF_VIEW(function) NULL, "libwebsockets (Debian: libwebsockets-dev; CMake option PAGS_VIEW)"
#endif

/* Runs a verb on one process or, if it shares its work out, on all ranks of a job. */
static int run_verb(const verb_entry *verb, int argc, char **argv) {
  if (pags_ranks_join() != PAGS_OK) {
    fprintf(stderr, "pags: %s\n", pags_error_message());
    return PAGS_EXIT_FAILED;
  }
  int code = PAGS_EXIT_USAGE;
  char name[32];
  snprintf(name, sizeof name, "pags %s", verb->name);
  pags_lock_set_holder(name);
  if (!pags_ranks_lead())
    pags_options_silence();
  if (verb->shares || !pags_ranks())
    code = verb->run(argc, argv);
  else if (pags_ranks_lead())
    fprintf(stderr,
            "pags: '%s' runs as one process, but mpirun started %d; only train, render and eval run on several ranks\n",
            verb->name, pags_transport_ranks(pags_ranks()));
  pags_ranks_leave();
  return code;
}

static const verb_entry verbs[] = {
    {"train", "Reconstruct a scene from posed photographs", pags_verb_train, NULL, true},
    {"render", "Render pictures of a scene or a splat file", pags_verb_render, NULL, true},
    {"eval", "Compare a scene with its photographs: PSNR, SSIM, LPIPS", pags_verb_eval, NULL, true},
    {"view", "Show a scene in a browser", IF_VIEW(pags_verb_view), false},
    {"report", "Write an HTML report of a scene, or of two scenes side by side", pags_verb_report, NULL, false},
    {"info", "Describe a data set, scene, splat file, camera path, image or checkpoint", pags_verb_info, NULL, false},
    {"export", "Export proxy meshes, splat files or a web page of a scene", pags_verb_export, EXPORT_LACKS, false},
    {"import", "Import kitti, waymo, argoverse2, nuscenes, pandaset, waymo2, kitti360, ncore, or photos",
     IF_IMPORT(pags_verb_import), false},
    {"split", "Split a long drive into blocks that are trained separately", pags_verb_split, NULL, false},
    {"merge", "Merge the scenes of a split drive's blocks", pags_verb_merge, NULL, false},
    {"synth", "Generate a synthetic data set with ground truth", IF_SYNTH(pags_verb_synth), false},
};
enum { VERB_COUNT = sizeof verbs / sizeof verbs[0] };

/* Prints the version alone in the first line, then the facts of the build (cmake/build_facts.cmake). */
static void print_version(void) {
  static const char *const names[] = {"avx512", "avx2", "neon", "scalar"};
  printf("pags %s\n", PAGS_VERSION_STRING);
  printf("commit:   %s\n", PAGS_BUILD_COMMIT);
  printf("compiler: %s\n", PAGS_BUILD_COMPILER);
  printf("kernels:  ");
  for (size_t i = 0; i < sizeof names / sizeof *names; i++)
    if (pags_kernels_named(names[i]))
      printf("%s ", names[i]);
  const char *why = NULL;
  const pags_kernels *const used = pags_kernels_get(&why);
  printf("run here; %s%s\n", used ? used->name : why, used ? " is used" : "");
  printf("with:    %s\nwithout: %s\n", PAGS_BUILD_WITH, PAGS_BUILD_WITHOUT);
}

static int run(int argc, char **argv) {
  if (argc < 2) {
    fprintf(stderr, "pags: no verb given; 'pags --help' lists them\n");
    return PAGS_EXIT_USAGE;
  }
  if (!strcmp(argv[1], "--help") || !strcmp(argv[1], "-h") || !strcmp(argv[1], "help")) {
    printf("usage: pags VERB [arguments]\n\n");
    printf("Priority-Adaptive Gaussian Splatting on CPUs, version %s\n\n", PAGS_VERSION_STRING);
    for (int i = 0; i < VERB_COUNT; i++)
      printf("  %-8s %s%s%s\n", verbs[i].name, verbs[i].summary, verbs[i].lacking ? "; this build lacks " : "",
             verbs[i].lacking ? verbs[i].lacking : "");
    printf(
        "\n'pags VERB --help' lists a verb's options with units and defaults. 'pags --version' prints version and "
        "build.\n");
    printf("Exit codes: 0 done, 1 failed, 2 wrong usage, 3 interrupted with its state saved.\n");
    return PAGS_EXIT_OK;
  }
  if (!strcmp(argv[1], "--version")) {
    print_version();
    return PAGS_EXIT_OK;
  }
  for (int i = 0; i < VERB_COUNT; i++)
    if (!strcmp(argv[1], verbs[i].name)) {
      if (verbs[i].run)
        return run_verb(&verbs[i], argc - 2, argv + 2);
      fprintf(stderr, "pags: '%s' is not in this build, which lacks %s\n", verbs[i].name, verbs[i].lacking);
      return PAGS_EXIT_FAILED;
    }

  /* The verb is unknown: suggest the nearest one. */
  if (!strcmp(argv[1], "bench")) {
    fprintf(stderr,
            "pags: 'bench' is not a verb; benchmarks are in the program pags-bench, in the same folder of a build\n");
    return PAGS_EXIT_USAGE;
  }
  pags_nearest nearest = {.word = argv[1]};
  for (int i = 0; i < VERB_COUNT; i++)
    pags_nearest_add(&nearest, verbs[i].name);
  if (nearest.name)
    fprintf(stderr, "pags: unknown verb '%s'; did you mean '%s'?\n", argv[1], nearest.name);
  else
    fprintf(stderr, "pags: unknown verb '%s'; 'pags --help' lists them\n", argv[1]);
  return PAGS_EXIT_USAGE;
}

int main(int argc, char **argv) {
  setlocale(LC_ALL, "C");
  pags_port_begin_program(&argc, &argv);
  pags_port_let_writes_fail();
  return pags_output_end(run(argc, argv));
}
