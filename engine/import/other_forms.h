/* SPDX-License-Identifier: Apache-2.0 */
/* Optional inputs that are there in another form than the importer reads: packed, of another ending, in other letters.
 * Passed over, they would look like inputs that are missing. */
#ifndef PAGS_IMPORT_OTHER_FORMS_H
#define PAGS_IMPORT_OTHER_FORMS_H

#include <pags/base.h>

/* PAGS_ERROR_FORMAT if `folder` lacks `name`, but has it in another form; `what` is read from it, in the plural. */
pags_result pags_other_form_check(const char *folder, const char *name, const char *what);
/* PAGS_ERROR_FORMAT if the folder is there and has files, but none that ends in `extension`. */
pags_result pags_other_files_check(const char *folder, const char *extension, const char *what);

#endif
