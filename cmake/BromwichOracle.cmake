# bromwich_oracle: the independent dense oracle, the random scenes and the verdict on a result, which the tests and
# bromwich_random_scenes and bromwich_trust share.
include_guard(GLOBAL)
add_library(
  bromwich_oracle STATIC
  ${PROJECT_SOURCE_DIR}/tests/support/oracle.cpp ${PROJECT_SOURCE_DIR}/tests/support/oracle_collocation.cpp
  ${PROJECT_SOURCE_DIR}/tests/support/oracle_event_solution.cpp
  ${PROJECT_SOURCE_DIR}/tests/support/oracle_events.cpp ${PROJECT_SOURCE_DIR}/tests/support/oracle_galerkin.cpp
  ${PROJECT_SOURCE_DIR}/tests/support/oracle_modes.cpp
  ${PROJECT_SOURCE_DIR}/tests/support/oracle_steps.cpp
  ${PROJECT_SOURCE_DIR}/tests/support/random_scenes.cpp ${PROJECT_SOURCE_DIR}/tests/support/random_sources.cpp
  ${PROJECT_SOURCE_DIR}/tests/support/trust.cpp ${PROJECT_SOURCE_DIR}/tests/support/verdict.cpp)
target_link_libraries(bromwich_oracle PUBLIC bromwich::core PRIVATE bromwich::cpu bromwich_build_options)
# Its templates are large and its problems small: the time goes into compiling it.
target_compile_options(bromwich_oracle PRIVATE "$<$<CONFIG:Release>:-O1>")
find_package(fmt REQUIRED CONFIG) # the header was compiled with its definitions
target_compile_definitions(bromwich_oracle PRIVATE $<TARGET_PROPERTY:fmt::fmt,INTERFACE_COMPILE_DEFINITIONS>)
target_precompile_headers(bromwich_oracle REUSE_FROM bromwich_words)

# bromwich_engineering: random circuits, masses and tanks, and the oracle that solves them.
add_library(
  bromwich_engineering STATIC
  ${PROJECT_SOURCE_DIR}/tests/support/engineering_scene.cpp ${PROJECT_SOURCE_DIR}/tests/support/engineering_trial.cpp
  ${PROJECT_SOURCE_DIR}/tests/support/flow_base.cpp ${PROJECT_SOURCE_DIR}/tests/support/lemke.cpp
  ${PROJECT_SOURCE_DIR}/tests/support/random_circuits.cpp ${PROJECT_SOURCE_DIR}/tests/support/random_machines.cpp
  ${PROJECT_SOURCE_DIR}/tests/support/stepped_flow.cpp ${PROJECT_SOURCE_DIR}/tests/support/switched_flow.cpp)
target_link_libraries(bromwich_engineering PUBLIC bromwich::files bromwich::core PRIVATE bromwich_build_options)
