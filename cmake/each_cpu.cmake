# SPDX-License-Identifier: Apache-2.0
# pags_test_each_cpu(NAME TARGET ARGS...): runs a test once per set of kernels, as NAME@scalar, NAME@avx2, ... A set that this
# machine does not support counts as skipped. pags_only_cpus limits the sets.
function(pags_test_each_cpu name target)
  set(cpus scalar)
  if(PAGS_SIMD AND CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    list(APPEND cpus avx2 avx512)
  elseif(PAGS_SIMD AND CMAKE_SYSTEM_PROCESSOR MATCHES "aarch64|arm64")
    list(APPEND cpus neon)
  endif()
  foreach(cpu ${cpus})
    if(pags_only_cpus AND NOT cpu IN_LIST pags_only_cpus)
      continue()
    endif()
    if(CMAKE_CROSSCOMPILING) # an emulator can't start a second program through the first
      add_test(NAME ${name}@${cpu} COMMAND ${target} ${ARGN})
      set_tests_properties(${name}@${cpu} PROPERTIES ENVIRONMENT "PAGS_CPU=${cpu}")
    else()
      add_test(NAME ${name}@${cpu} COMMAND pags_on_cpu ${cpu} $<TARGET_FILE:${target}> ${ARGN})
    endif()
    set_tests_properties(${name}@${cpu} PROPERTIES SKIP_RETURN_CODE 77 TIMEOUT 600${PAGS_PATIENCE})
  endforeach()
endfunction()
