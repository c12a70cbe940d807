/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the mask pictures of a view: FOLDER/TTT_C.png, where TTT is the number of the frame and C that of the
 * camera. */
#include "dataset/driving/masks.h"

#include <stdlib.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"

pags_result pags_driving_find_mask(const pags_driving *driving, const char *folder, const pags_parsed_view *view,
                                   char **out) {
  *out = pags_text_format("%s/%s/%0*d_%d.png", driving->root, folder, driving->digits, view->frame, view->sensor);
  if (!*out)
    return pags_out_of_memory("%s", driving->root);
  if (!pags_file_exists(*out)) {
    free(*out);
    *out = NULL;
  }
  return PAGS_OK;
}
