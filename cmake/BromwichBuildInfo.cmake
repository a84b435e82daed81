# bromwich_build_info: the generated header core/build_info.hpp, for programs that report what they were built from.
# The commit comes from the environment variable BROMWICH_COMMIT, else from git.
set(commit "$ENV{BROMWICH_COMMIT}")
if(NOT commit AND EXISTS ${PROJECT_SOURCE_DIR}/.git)
  find_package(Git QUIET)
  if(GIT_FOUND)
    execute_process(
      COMMAND ${GIT_EXECUTABLE} rev-parse --verify HEAD
      WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
      OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE
      ERROR_QUIET)
    # Configure again after each commit, so that reports name the right one.
    execute_process(
      COMMAND ${GIT_EXECUTABLE} rev-parse --git-path logs/HEAD
      WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
      OUTPUT_VARIABLE head_log OUTPUT_STRIP_TRAILING_WHITESPACE
      ERROR_QUIET)
    cmake_path(ABSOLUTE_PATH head_log BASE_DIRECTORY ${PROJECT_SOURCE_DIR})
    if(EXISTS ${head_log})
      set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${head_log})
    endif()
  endif()
endif()
if(NOT commit)
  set(commit unknown)
endif()
string(LENGTH "${commit}" digits)
if(NOT commit STREQUAL unknown AND NOT (digits EQUAL 40 AND commit MATCHES "^[0-9a-f]+$"))
  message(FATAL_ERROR "BROMWICH_COMMIT: found '${commit}'; give the 40 digits that git rev-parse HEAD prints")
endif()

string(TOUPPER "${CMAKE_BUILD_TYPE}" configuration)
set(flags ${CMAKE_CXX_FLAGS} ${CMAKE_CXX_FLAGS_${configuration}})
if(configuration MATCHES "^(RELEASE|RELWITHDEBINFO)$")
  list(APPEND flags ${bromwich_optimisation_flags})
endif()
list(JOIN flags " " flags)

configure_file(${PROJECT_SOURCE_DIR}/cmake/build_info.hpp.in ${PROJECT_BINARY_DIR}/generated/core/build_info.hpp @ONLY)
add_library(bromwich_build_info INTERFACE)
target_include_directories(bromwich_build_info INTERFACE ${PROJECT_BINARY_DIR}/generated)
