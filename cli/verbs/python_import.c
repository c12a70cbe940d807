/* SPDX-License-Identifier: Apache-2.0 */
/* Starts the Python package pags_recordings (tools/recordings), never from the working directory: a file of the package
 * is started by its path, or that directory is removed from Python's path. */
#include "cli/verbs/verbs.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "port/port.h"

enum { WORDS = 24 };

#ifdef _WIN32
static const char python[] = "python";
static const char own_python[] = "/.venv/Scripts/python.exe";
#else
static const char python[] = "python3";
static const char own_python[] = "/.venv/bin/python";
#endif

/* Runs the installed package if its version matches. */
static const char installed[] =
    "import sys\n"
    "sys.path[:] = [p for p in sys.path if p]\n"
    "try:\n"
    "  from pags_recordings import __version__\n"
    "  from pags_recordings.__main__ import main\n"
    "except ImportError:\n"
    "  sys.exit('pags: importing ' + sys.argv[1] + ' needs the Python package pags-recordings ' + '" PAGS_VERSION_STRING
    "' + ', which is expected in ../share/pags/recordings beside this program, or installed for ' + sys.executable)\n"
    "if __version__ != '" PAGS_VERSION_STRING
    "':\n"
    "  sys.exit('pags: the Python package pags-recordings is of version ' + __version__ + ', this program is ' + "
    "'" PAGS_VERSION_STRING
    "' + '; install that one')\n"
    "sys.exit(main())\n";

bool pags_python_import_knows(const char *kind) {
  static const char *const kinds[] = {"argoverse2", "nuscenes", "pandaset", "waymo2", "kitti360", "ncore", "photos"};
  for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
    if (strcmp(kind, kinds[i]) == 0)
      return true;
  return false;
}

/* Finds the package next to the program: installed, or in the source tree of a build. */
static char *find_beside(void) {
  static const char *const places[] = {"../share/pags/recordings", "../tools/recordings"};
  char folder[4096], *found = NULL;
  const bool known = pags_port_program_folder(folder, sizeof folder);
  for (size_t i = 0; known && !found && i < sizeof places / sizeof *places; i++) {
    char *path = pags_text_format("%s/%s", folder, places[i]);
    if (path && pags_folder_has(path, "run.py"))
      found = path;
    else
      free(path);
  }
  return found;
}

pags_result pags_python_import(const char *kind, const char *source, const char *folder,
                               const pags_import_options *options, int pictures, const char *json, bool quiet) {
  const char *words[WORDS];
  char span[64], count[16];
  int n = 0;
  char *beside = find_beside();
  char *script = beside ? pags_path_join(beside, "run.py") : NULL;
  char *own = beside ? pags_text_format("%s%s", beside, own_python) : NULL;
  if (beside && (!script || !own))
    return pags_out_of_memory("the path of run.py");
  words[n++] = own && pags_file_exists(own) ? own : python;
  if (!script)
    words[n++] = "-c";
  words[n++] = script ? script : installed;
  words[n++] = kind;
  words[n++] = source;
  words[n++] = "--output";
  words[n++] = folder;
  if (options->cameras) {
    words[n++] = "--cameras";
    words[n++] = options->cameras;
  }
  if (options->frame_first > 0 || options->frame_last >= 0) {
    snprintf(span, sizeof span, "%lld-", (long long)options->frame_first);
    if (options->frame_last >= 0)
      snprintf(span + strlen(span), sizeof span - strlen(span), "%lld", (long long)options->frame_last);
    words[n++] = "--frames";
    words[n++] = span;
  }
  if (options->sequence) {
    words[n++] = "--sequence";
    words[n++] = options->sequence;
  }
  if (pictures > 0) {
    snprintf(count, sizeof count, "%d", pictures);
    words[n++] = "--pictures";
    words[n++] = count;
  }
  if (options->overwrite)
    words[n++] = "--overwrite";
  if (json) {
    words[n++] = "--json";
    words[n++] = json;
  }
  if (quiet)
    words[n++] = "--quiet";
  words[n] = NULL;
  fflush(NULL);
  pags_port_set_environment("PAGS_RECORDINGS_FOR", "pags");
  pags_port_become(words);
  const pags_result result =
      pags_fail(PAGS_ERROR_UNSUPPORTED,
                "importing %s needs Python: %s can't be started; install Python 3.9 or later and "
                "its packages numpy, pillow, pandas and pyarrow",
                kind, words[0]);
  free(own);
  free(script);
  free(beside);
  return result;
}
