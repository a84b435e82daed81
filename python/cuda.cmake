# bromwich/_cuda.so: the CUDA backend for bromwich._core, which loads it when a device is wanted (kernels/cuda_plugin.hpp).
# The package is imported without it, and without the libraries of CUDA.
if(NOT BROMWICH_HAS_CUDA)
  return()
endif()
add_library(bromwich_python_cuda MODULE ../kernels/cuda_plugin.cpp ../kernels/cuda_plugin_abi.cpp)
target_link_libraries(bromwich_python_cuda PRIVATE bromwich::core bromwich::cuda bromwich_build_options)
target_link_options(bromwich_python_cuda PRIVATE LINKER:--as-needed
                    LINKER:--version-script=${CMAKE_CURRENT_SOURCE_DIR}/src/exported_cuda.map)
# NVIDIA's packages for Python stand beside this one.
set(beside cublas cuda_runtime cufft cu13)
list(TRANSFORM beside REPLACE "(.+)" "$ORIGIN/../nvidia/\\1/lib")
set_target_properties(
  bromwich_python_cuda
  PROPERTIES OUTPUT_NAME _cuda
             PREFIX ""
             LIBRARY_OUTPUT_DIRECTORY ${package_dir}
             BUILD_RPATH_USE_ORIGIN ON
             INSTALL_RPATH "${beside}")
add_dependencies(bromwich_python_package bromwich_python_cuda)
install(TARGETS bromwich_python_cuda LIBRARY DESTINATION bromwich COMPONENT python EXCLUDE_FROM_ALL)
