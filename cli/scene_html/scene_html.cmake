# SPDX-License-Identifier: Apache-2.0
# pags export SCENE scene.html: what packs and writes it, and its page as a part of the program. The page shares modules with pags view's.
set(page ${CMAKE_CURRENT_SOURCE_DIR}/scene_html/page)
set(shared ${CMAKE_CURRENT_SOURCE_DIR}/common/page)
set(styles ${shared}/view.css ${page}/page.css)
set(scripts ${shared}/vector.js ${shared}/camera.js ${shared}/controls.js ${page}/unpack.js ${page}/drawing.js ${page}/sorter.js ${page}/motion.js
  ${page}/main.js)
list(JOIN styles "," style_list)
list(JOIN scripts "," script_list)
add_custom_command(OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/player.c
  COMMAND ${CMAKE_COMMAND} -DPAGE=${page}/page.html -DSTYLES=${style_list} -DSCRIPTS=${script_list} -DOUT=${CMAKE_CURRENT_BINARY_DIR}/player.c
    -P ${PROJECT_SOURCE_DIR}/cmake/page.cmake
  DEPENDS ${page}/page.html ${styles} ${scripts} ${PROJECT_SOURCE_DIR}/cmake/page.cmake VERBATIM)
target_sources(pags PRIVATE draw/describe.c scene_html/pack.c scene_html/write.c ${CMAKE_CURRENT_BINARY_DIR}/player.c)
target_link_libraries(pags PRIVATE ${PAGS_ZLIB})
