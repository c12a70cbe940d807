# SPDX-License-Identifier: Apache-2.0
# The targets `tests` and `quick_tests`: the programs defined in tests/ and below.
function(pags_targets_below folder list)
  get_property(found DIRECTORY ${folder} PROPERTY BUILDSYSTEM_TARGETS)
  get_property(folders DIRECTORY ${folder} PROPERTY SUBDIRECTORIES)
  foreach(inner ${folders})
    pags_targets_below(${inner} below)
    list(APPEND found ${below})
  endforeach()
  set(${list} ${found} PARENT_SCOPE)
endfunction()

pags_targets_below(${PROJECT_SOURCE_DIR}/tests programs)
list(FILTER programs EXCLUDE REGEX "^(check_scaling|fuzz_targets)$")
set(quick ${programs})
list(FILTER quick INCLUDE REGEX "^(test_(unit|kernels)_|pags_on_cpu$)")
list(FILTER quick EXCLUDE REGEX "^test_unit_(decoders|drive|export)$") # tests/CMakeLists.txt has the reason
add_custom_target(tests DEPENDS ${programs})
add_custom_target(quick_tests DEPENDS ${quick})
