# bromwich_beside_core(NAME SOURCES...): the library bromwich_NAME of a folder beside core. Like core it needs Eigen and
# the C++ library only, and is compiled with the same headers and options.
function(bromwich_beside_core name)
  set(target bromwich_${name})
  add_library(${target} STATIC ${ARGN})
  add_library(bromwich::${name} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  target_include_directories(${target} BEFORE PRIVATE ${PROJECT_BINARY_DIR}/core_alone)
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    target_compile_options(${target} PRIVATE -Wno-psabi)
  endif()
  target_link_libraries(${target} PUBLIC bromwich::core PRIVATE $<BUILD_INTERFACE:bromwich_build_options>)
  target_precompile_headers(${target} REUSE_FROM bromwich_core)
endfunction()
