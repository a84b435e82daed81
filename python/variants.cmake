# BROMWICH_PYTHON_VARIANTS: the compiled part once more for each of these, with vector instructions that not every
# processor has. The package chooses one when it is imported. Each is a build of its own: code for different instructions
# in one shared object would share the templates of Eigen.
set(BROMWICH_PYTHON_VARIANTS "" CACHE STRING "Vector instructions for which _core is built again: avx2;avx512")

set(arch_avx2 x86-64-v3)
set(arch_avx512 x86-64-v4)
set(inherited
    BROMWICH_STUDIES BROMWICH_TRANSFORM BROMWICH_WARNINGS_AS_ERRORS CMAKE_BUILD_TYPE CMAKE_CXX_COMPILER CMAKE_CXX_FLAGS
    CMAKE_MAKE_PROGRAM CMAKE_PREFIX_PATH CMAKE_UNITY_BUILD Python_EXECUTABLE SKBUILD_SOABI SKBUILD_SABI_COMPONENT)

add_custom_target(bromwich_python_package ALL DEPENDS bromwich_python bromwich_python_processor)
include(ExternalProject)
foreach(variant IN LISTS BROMWICH_PYTHON_VARIANTS)
  if(NOT DEFINED arch_${variant})
    message(FATAL_ERROR "BROMWICH_PYTHON_VARIANTS: found '${variant}'; use avx2, avx512 or both")
  endif()
  set(values -DBROMWICH_ARCH:STRING=${arch_${variant}} -DBROMWICH_NATIVE:BOOL=OFF -DBROMWICH_PYTHON:STRING=ON
             -DBROMWICH_PYTHON_VARIANTS:STRING= -DBUILD_TESTING:BOOL=OFF
             -DBROMWICH_CUDA:STRING=OFF) # _cuda.so is there once
  foreach(name IN LISTS inherited)
    if(DEFINED ${name})
      list(APPEND values "-D${name}:STRING=${${name}}")
    endif()
  endforeach()
  set(dir ${CMAKE_CURRENT_BINARY_DIR}/variant-${variant})
  ExternalProject_Add(
    bromwich_python_${variant}
    PREFIX ${dir}
    BINARY_DIR ${dir}/build
    SOURCE_DIR ${PROJECT_SOURCE_DIR}
    CMAKE_CACHE_ARGS ${values}
    BUILD_COMMAND ${CMAKE_COMMAND} --build ${dir}/build --target bromwich_python
    BUILD_ALWAYS ON
    USES_TERMINAL_BUILD ON
    INSTALL_COMMAND ""
    DEPENDS bromwich_python) # one after the other: each takes all cores
  add_dependencies(bromwich_python_package bromwich_python_${variant})
  install(
    DIRECTORY ${dir}/build/python/bromwich/
    DESTINATION bromwich/_variants/${variant}
    COMPONENT python EXCLUDE_FROM_ALL
    FILES_MATCHING PATTERN "_core.*so")
endforeach()
