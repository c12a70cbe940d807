/* A closed quad control cage whose subdivision surface (Catmull and Clark 1978) follows a closed surface. */
#ifndef PAGS_EXPORTERS_CAGE_H
#define PAGS_EXPORTERS_CAGE_H

#include "shell.h"

#ifdef __cplusplus
extern "C" {
#endif

/* `level` 0: the cage itself; 1..3: subdivided so often, vertices on the limit surface. Quads are written as two triangles. */
pags_result pags_shell_cage(const pags_shell *surface, int level, pags_shell *out);

#ifdef __cplusplus
}
#endif
#endif
