# SPDX-License-Identifier: Apache-2.0
# cmake -DPROGRAM=pags -DFOLDER=bin -DSTRIP=strip -P copy_program.cmake: copies a program into FOLDER, and its shared libraries into
# FOLDER/lib, where the program searches first, so that it runs on machines without them. The parts of the C library stay the system's: they
# belong to kernel and loader. A cross build links statically; only its program is copied.
cmake_minimum_required(VERSION 3.24)
file(COPY ${PROGRAM} DESTINATION ${FOLDER})
get_filename_component(name ${PROGRAM} NAME)
execute_process(COMMAND ${STRIP} ${FOLDER}/${name} COMMAND_ERROR_IS_FATAL ANY)
if(ALONE)
  return()
endif()
file(GET_RUNTIME_DEPENDENCIES EXECUTABLES ${PROGRAM} RESOLVED_DEPENDENCIES_VAR found UNRESOLVED_DEPENDENCIES_VAR missing
  PRE_EXCLUDE_REGEXES "^ld-linux" "^lib(c|m|dl|rt|pthread)\\.so")
if(missing)
  message(FATAL_ERROR "${PROGRAM}: these shared libraries aren't found: ${missing}")
endif()
foreach(library ${found}) # the file itself under the name that the program loads: a zip keeps no links
  get_filename_component(name ${library} NAME)
  file(REAL_PATH ${library} file)
  file(MAKE_DIRECTORY ${FOLDER}/lib)
  file(COPY_FILE ${file} ${FOLDER}/lib/${name})
  execute_process(COMMAND ${STRIP} --strip-unneeded ${FOLDER}/lib/${name} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
