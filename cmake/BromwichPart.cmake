# bromwich_part(NAME SOURCES...): a part of the command in the shared object bromwich_NAME.so beside it, installed below
# the libraries, which it loads when it is needed (files/loaded_part.hpp). The target is bromwich_NAME_part.
function(bromwich_part name)
  set(part bromwich_${name}_part)
  add_library(${part} MODULE ${ARGN})
  set_target_properties(
    ${part}
    PROPERTIES OUTPUT_NAME bromwich_${name}
               PREFIX ""
               UNITY_BUILD OFF
               LIBRARY_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR})
  target_link_libraries(${part} PRIVATE bromwich_part_abi bromwich_build_options)
  set(exported ${PROJECT_SOURCE_DIR}/files/exported_part.map)
  target_link_options(${part} PRIVATE LINKER:--as-needed LINKER:--version-script=${exported})
  set_property(TARGET ${part} APPEND PROPERTY LINK_DEPENDS ${exported})
  install(TARGETS ${part} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/bromwich)
endfunction()
