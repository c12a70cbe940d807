/* SPDX-License-Identifier: Apache-2.0 */
/* The masks that lie beside the photographs: FOLDER/TTT_C.png, TTT the frame's number, C the camera's. */
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
