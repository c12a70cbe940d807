/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the files that a data set names where the names were written on another system: with backslashes, in other
 * letter case, with another extension, or below a folder of another machine. A name that is a file is taken as it is.
 * Files found in another way are counted and reported once per kind. */
#ifndef PAGS_DATASET_FIND_FILE_H
#define PAGS_DATASET_FIND_FILE_H

#include <stdbool.h>

#include <pags/base.h>

#include "base/file.h"

typedef enum pags_spelling {
  PAGS_SPELLING_SAME,      /* as named, or with an extension where the name has none */
  PAGS_SPELLING_SLASHES,   /* backslashes read as slashes */
  PAGS_SPELLING_FOLDER,    /* the name's last components, below the data set's folder */
  PAGS_SPELLING_CASE,      /* other letter case */
  PAGS_SPELLING_EXTENSION, /* another extension of a picture */
  PAGS_SPELLING_SEVERAL,   /* no extension, and there are pictures of several */
  PAGS_SPELLINGS
} pags_spelling;

/* Zeroed at first; pags_file_finder_end frees it. */
typedef struct pags_file_finder {
  int64_t asked, counts[PAGS_SPELLINGS];
  char *named[PAGS_SPELLINGS], *found[PAGS_SPELLINGS]; /* the first of each kind */
  /* The folder that was listed last. */
  char *folder;
  pags_dir_list list;
} pags_file_finder;

/* Looks for the file `name`, relative to `folder` or absolute. *out is its path, freed by the caller; where there is no
 * such file it is the path that the name represents, and *exists is false. PAGS_ERROR_MEMORY; then *out is NULL. */
pags_result pags_find_file(pags_file_finder *finder, const char *folder, const char *name, char **out, bool *exists);

/* Returns the only folder in `folder` whose name is `name` but for letter case, freed by the caller; NULL if there is
 * none, or out of memory. */
char *pags_find_folder(pags_file_finder *finder, const char *folder, const char *name);

/* Logs a warning a kind of spelling and frees the finder. `what`: "pictures". */
void pags_file_finder_end(pags_file_finder *finder, const char *source, const char *what);

void pags_file_finder_drop(pags_file_finder *finder); /* frees it without a word */

/* Looks in `folder` for the file whose name is the first `length` bytes of `name` and `extension`. *out is its path,
 * freed by the caller; NULL: not found. PAGS_ERROR_MEMORY. */
pags_result pags_find_extension(const char *folder, const char *name, int length, const char *extension, char **out);

/* Whether a folder is a data set of transforms files or with a dataset.json. */
bool pags_folder_is_data_set(const char *folder);

/* Whether `word` is one of the words of `list`, which are separated by blanks, whatever the case of its letters. */
bool pags_words_have(const char *list, const char *word);
/* Takes the next word of the list and returns it, cut off after 63 bytes; NULL at the end. */
const char *pags_words_next(const char **list, char out[64]);

/* Whether a file of this name is a picture by its extension. */
bool pags_is_picture_name(const char *name);

#endif
