# SPDX-License-Identifier: Apache-2.0
# cmake -DPROGRAM=pags -DFOLDER=bin -DSTRIP=strip -P copy_program.cmake: copies a program into a folder and the shared libraries that it needs
# into FOLDER/lib, where the program looks first, so that it runs on machines that have none of them. Left to the system are the C library's
# parts, which belong to its kernel and loader. What a cross build links statically is copied alone: its libraries can't be asked for here.
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
foreach(library ${found}) # under the name that is asked for: the file itself, not a link, which a zip doesn't keep
  get_filename_component(name ${library} NAME)
  file(REAL_PATH ${library} file)
  file(MAKE_DIRECTORY ${FOLDER}/lib)
  file(COPY_FILE ${file} ${FOLDER}/lib/${name})
  execute_process(COMMAND ${STRIP} --strip-unneeded ${FOLDER}/lib/${name} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
