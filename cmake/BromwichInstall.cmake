# Installs the libraries and headers, and a package for find_package(bromwich).
include(CMakePackageConfigHelpers)

set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/bromwich)

set(libraries bromwich bromwich_core)
foreach(name IN LISTS BROMWICH_BESIDE_CORE)
  list(APPEND libraries bromwich_${name})
endforeach()
if(BROMWICH_CPU)
  list(APPEND libraries bromwich_cpu bromwich_openmp bromwich_cuda)
endif()
install(TARGETS ${libraries} EXPORT bromwichTargets)
set(headers ${CMAKE_INSTALL_INCLUDEDIR}/bromwich)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/bromwich/ DESTINATION ${headers} FILES_MATCHING PATTERN "*.hpp")
install(FILES ${PROJECT_BINARY_DIR}/generated/bromwich/bromwich.hpp DESTINATION ${headers})
if(BROMWICH_CPU)
  install(FILES ${PROJECT_SOURCE_DIR}/cpu/cpu_backend.hpp DESTINATION ${headers}/cpu)
  install(FILES ${PROJECT_SOURCE_DIR}/kernels/cuda_backend.hpp DESTINATION ${headers}/kernels)
endif()
install(EXPORT bromwichTargets NAMESPACE bromwich:: DESTINATION ${package_dir})

configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/bromwichConfig.cmake.in
                              ${PROJECT_BINARY_DIR}/bromwichConfig.cmake INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/bromwichConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/bromwichConfig.cmake ${PROJECT_BINARY_DIR}/bromwichConfigVersion.cmake
              ${PROJECT_SOURCE_DIR}/cmake/FindFFTW3.cmake DESTINATION ${package_dir})
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})

# pkg-config for other build systems. The CUDA libraries have no such file on every system: there find_package is the way.
if(NOT BROMWICH_HAS_CUDA)
  file(RELATIVE_PATH to_prefix /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
  # What is linked comes behind what needs it.
  set(pc_libs ${BROMWICH_BESIDE_CORE})
  list(REVERSE pc_libs)
  list(TRANSFORM pc_libs PREPEND -lbromwich_)
  list(JOIN pc_libs " " pc_libs)
  string(APPEND pc_libs " -lbromwich_core")
  set(pc_requires "")
  if(BROMWICH_CPU)
    set(pc_libs "-lbromwich_cpu -lbromwich_cuda ${pc_libs} ${OpenMP_CXX_FLAGS}")
    if(BROMWICH_TRANSFORM STREQUAL "FFTW")
      set(pc_requires fftw3)
    endif()
  endif()
  configure_file(${PROJECT_SOURCE_DIR}/cmake/bromwich.pc.in ${PROJECT_BINARY_DIR}/bromwich.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/bromwich.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endif()
