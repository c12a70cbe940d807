/* SPDX-License-Identifier: Apache-2.0 */
/* The page of scene.html before and after its data, which cmake/page.cmake makes of cli/scene_html/page/. */
#ifndef PAGS_CLI_SCENE_HTML_PLAYER_H
#define PAGS_CLI_SCENE_HTML_PLAYER_H

#include <stddef.h>

extern const unsigned char pags_player_head[], pags_player_tail[];
extern const size_t pags_player_head_size, pags_player_tail_size;

#endif
