# bromwich_discover_suites(TARGET [PREFIX p] [FILTER f] [ENVIRONMENT e...]): one test of ctest for each suite of a program
# of GoogleTest. (gtest_discover_tests makes one for each test: two thousand processes, most of them shorter than their
# start.) ctest -R names a suite; PROGRAM --gtest_filter=Suite.Test runs one test.

if(CMAKE_SCRIPT_MODE_FILE)
  # After a build: PROGRAM lists its tests, OUTPUT says which suites ctest runs.
  execute_process(COMMAND ${PROGRAM} --gtest_list_tests --gtest_filter=${FILTER} OUTPUT_VARIABLE listed COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX REPLACE "#[^\n]*" "" listed "${listed}") # values of parameters
  string(REGEX MATCHALL "[^\n]+" listed "${listed}")
  set(suites "")
  foreach(line IN LISTS listed)
    if(line MATCHES "^  ([^ ]+)")
      list(APPEND tests_of_${suite} "${suite}.${CMAKE_MATCH_1}")
    elseif(line MATCHES "^([^ ]+)\\. *$") # blanks before the type of a typed suite
      set(suite ${CMAKE_MATCH_1})
      list(APPEND suites ${suite})
    elseif(NOT line MATCHES "^Running main")
      message(FATAL_ERROR "${PROGRAM} --gtest_list_tests: neither a suite nor a test: '${line}'")
    endif()
  endforeach()
  if(NOT suites)
    message(FATAL_ERROR "${PROGRAM} --gtest_filter=${FILTER} lists no suite of tests")
  endif()
  # The last lines of a run where every test is skipped; after failures there are others.
  string(ASCII 10 newline)
  set(all_skipped "PASSED  . 0 tests.${newline}(.  SKIPPED [^${newline}]*${newline})+$")
  set(lines "")
  foreach(suite IN LISTS suites)
    list(LENGTH tests_of_${suite} count) # the longest begin first, as far as this tells
    set(tests ${suite}.*)
    if(NOT FILTER STREQUAL "*")
      list(JOIN tests_of_${suite} ":" tests)
    endif()
    string(
      APPEND
      lines
      "add_test([=[${PREFIX}${suite}]=] [=[${PROGRAM}]=] [=[--gtest_filter=${tests}]=])\n"
      "set_tests_properties([=[${PREFIX}${suite}]=] PROPERTIES ENVIRONMENT [=[${ENVIRONMENT}]=] TIMEOUT 1800 COST ${count}"
      " SKIP_REGULAR_EXPRESSION [=[${all_skipped}]=])\n")
  endforeach()
  file(WRITE ${OUTPUT} "${lines}")
  return()
endif()

function(bromwich_discover_suites target)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "PREFIX;FILTER" "ENVIRONMENT")
  if(NOT arg_FILTER)
    set(arg_FILTER "*")
  endif()
  set(listing ${CMAKE_CURRENT_BINARY_DIR}/${target}_suites.cmake)
  add_custom_command(
    TARGET ${target}
    POST_BUILD
    BYPRODUCTS ${listing}
    COMMAND
      ${CMAKE_COMMAND} -D PROGRAM=$<TARGET_FILE:${target}> -D "PREFIX=${arg_PREFIX}" -D "FILTER=${arg_FILTER}" -D
      "ENVIRONMENT=${arg_ENVIRONMENT}" -D OUTPUT=${listing} -P ${CMAKE_CURRENT_FUNCTION_LIST_FILE}
    VERBATIM)
  # Until the program is built, ctest has one test that fails and names it.
  set(included ${CMAKE_CURRENT_BINARY_DIR}/${target}_include.cmake)
  file(WRITE ${included} "if(EXISTS [=[${listing}]=])\n  include([=[${listing}]=])\nelse()\n"
                         "  add_test(${target}_NOT_BUILT ${target}_NOT_BUILT)\nendif()\n")
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${included})
endfunction()
