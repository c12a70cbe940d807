# SPDX-License-Identifier: Apache-2.0
# Libraries for proxies, glTF and synthetic data.

# config(NAME TARGET LIBRARY DEFINITIONS...): what find_package(NAME) reads.
function(config name target library)
  set(folder ${CMAKE_CURRENT_BINARY_DIR}/${name}Config.cmake)
  file(WRITE ${folder} "get_filename_component(prefix \${CMAKE_CURRENT_LIST_DIR}/../../.. ABSOLUTE)\nadd_library(${target} STATIC IMPORTED)\n"
    "set_target_properties(${target} PROPERTIES IMPORTED_LOCATION \${prefix}/lib/lib${library}.a INTERFACE_INCLUDE_DIRECTORIES \${prefix}/include\n"
    "  INTERFACE_COMPILE_DEFINITIONS \"${ARGN}\")\n")
  install(FILES ${folder} DESTINATION lib/cmake/${name})
endfunction()

library(meshoptimizer meshoptimizer src/*.cpp)
install(FILES ${PAGS_SOURCES}/meshoptimizer/src/meshoptimizer.h DESTINATION include)
config(meshoptimizer meshoptimizer::meshoptimizer meshoptimizer)

library(qhull_r qhull src/libqhull_r/*.c)
target_include_directories(qhull_r PRIVATE ${PAGS_SOURCES}/qhull/src)
file(GLOB headers ${PAGS_SOURCES}/qhull/src/libqhull_r/*.h)
install(FILES ${headers} DESTINATION include/libqhull_r)

# OpenSubdiv: the tables of refinement and stencils, without evaluators for graphics cards.
library(osdCPU opensubdiv opensubdiv/sdc/*.cpp opensubdiv/vtr/*.cpp opensubdiv/far/*.cpp opensubdiv/version.cpp)
install(DIRECTORY ${PAGS_SOURCES}/opensubdiv/opensubdiv DESTINATION include FILES_MATCHING PATTERN "*.h")

# tinygltf without the readers and writers of pictures, which PAGS doesn't call.
set(no_pictures TINYGLTF_NO_STB_IMAGE TINYGLTF_NO_STB_IMAGE_WRITE)
library(tinygltf tinygltf tiny_gltf.cc)
target_include_directories(tinygltf PRIVATE ${PAGS_SOURCES}/nlohmann-json3/single_include)
target_compile_definitions(tinygltf PRIVATE ${no_pictures})
install(FILES ${PAGS_SOURCES}/tinygltf/tiny_gltf.h DESTINATION include)
install(DIRECTORY ${PAGS_SOURCES}/nlohmann-json3/single_include/nlohmann DESTINATION include)
config(TinyGLTF TinyGLTF::TinyGLTF tinygltf ${no_pictures})

# Embree by its own build, with its own threads in place of TBB: the kinds of geometry that PAGS uses, for SSE2 or NEON alone, which serve every
# processor. Its intersectors of curves would be compiled even so and take most of the time; they are left out of its list. A friend function of
# its curves names a member that isn't there, which clang passes over with -fdelayed-template-parsing. On Windows M_PI has to be asked for, and its
# version resource, which a static library doesn't need, would ask for windres.
set(rays -DEMBREE_MAX_ISA=SSE2)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "arm64|aarch64")
  set(rays -DEMBREE_MAX_ISA=NEON -DEMBREE_ARM=ON) # which on Linux it finds out after it has chosen the compiler's flags
endif()
set(definitions "")
if(WIN32)
  set(definitions -D_USE_MATH_DEFINES)
endif()
include(ExternalProject)
ExternalProject_Add(embree SOURCE_DIR ${PAGS_SOURCES}/embree INSTALL_DIR ${CMAKE_INSTALL_PREFIX} DOWNLOAD_COMMAND "" UPDATE_COMMAND ""
  PATCH_COMMAND sed -i -e /curve_intersector_virtual/d -e /embree.rc/d <SOURCE_DIR>/kernels/CMakeLists.txt
  COMMAND ${CMAKE_COMMAND} -E touch <SOURCE_DIR>/readme.pdf
  CMAKE_ARGS -DCMAKE_BUILD_TYPE=Release -DCMAKE_TOOLCHAIN_FILE=${CMAKE_TOOLCHAIN_FILE} -DPAGS_TARGET=${PAGS_TARGET} -DPAGS_CROSS=${PAGS_CROSS}
    -DCMAKE_INSTALL_PREFIX=${CMAKE_INSTALL_PREFIX} -DCMAKE_INSTALL_LIBDIR=lib -DEMBREE_IGNORE_CMAKE_CXX_FLAGS=OFF
    "-DCMAKE_CXX_FLAGS=-w -ffp-contract=off -fdelayed-template-parsing ${definitions}" -DEMBREE_TUTORIALS=OFF -DBUILD_TESTING=OFF -DEMBREE_STATIC_LIB=ON
    -DEMBREE_ISPC_SUPPORT=OFF -DEMBREE_TASKING_SYSTEM=INTERNAL ${rays} -DEMBREE_GEOMETRY_CURVE=OFF -DEMBREE_GEOMETRY_SUBDIVISION=OFF
    -DEMBREE_GEOMETRY_GRID=OFF -DEMBREE_GEOMETRY_POINT=OFF)
