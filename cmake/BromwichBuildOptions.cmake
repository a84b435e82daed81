# Language level, warnings and optimisation of everything built here, in one target that is not exported. All targets
# take it, so that Eigen sees the same vector unit everywhere in the build.
include(CheckCXXCompilerFlag)

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)

set(bromwich_warning_flags -Wall -Wextra -Wpedantic -Wnon-virtual-dtor
                           $<IF:$<CXX_COMPILER_ID:GNU>,-Wshadow=local,-Wshadow>)
if(BROMWICH_WARNINGS_AS_ERRORS)
  list(APPEND bromwich_warning_flags -Werror)
endif()

# No -ffast-math: NaN is checked for, and sums keep their order.
set(bromwich_optimisation_flags -fno-math-errno -fno-trapping-math)
if(BROMWICH_ARCH)
  list(APPEND bromwich_optimisation_flags -march=${BROMWICH_ARCH})
elseif(BROMWICH_NATIVE)
  check_cxx_compiler_flag(-march=native BROMWICH_HAVE_MARCH_NATIVE)
  if(BROMWICH_HAVE_MARCH_NATIVE)
    list(APPEND bromwich_optimisation_flags -march=native)
  endif()
endif()

add_library(bromwich_build_options INTERFACE)
target_compile_options(
  bromwich_build_options INTERFACE ${bromwich_warning_flags}
                                   "$<$<CONFIG:Release,RelWithDebInfo>:${bromwich_optimisation_flags}>")
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  # False alarms of GCC 12 in inlined AVX-512 (GCC bug 105593) and std::string code; unoptimised builds keep them all.
  set(false_alarms -Wno-uninitialized -Wno-maybe-uninitialized -Wno-array-bounds -Wno-stringop-overflow -Wno-restrict)
  target_compile_options(bromwich_build_options INTERFACE "$<$<CONFIG:Release,RelWithDebInfo>:${false_alarms}>")
endif()
# Backends share out the work themselves. It also keeps Eigen's templates the same with and without OpenMP.
target_compile_definitions(bromwich_build_options INTERFACE EIGEN_DONT_PARALLELIZE)
# The compiler collects its garbage less often: a tenth of its time, for less than 1 GB.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  target_compile_options(bromwich_build_options
                         INTERFACE "$<$<COMPILE_LANGUAGE:CXX>:SHELL:--param ggc-min-expand=200 --param ggc-min-heapsize=500000>")
endif()
