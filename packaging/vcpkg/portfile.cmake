# An overlay port: vcpkg install bromwich --overlay-ports=packaging, with the sources of this checkout.
cmake_path(GET CMAKE_CURRENT_LIST_DIR PARENT_PATH packaging)
cmake_path(GET packaging PARENT_PATH SOURCE_PATH)

vcpkg_cmake_configure(
  SOURCE_PATH ${SOURCE_PATH}
  OPTIONS
    -DBROMWICH_CUDA=OFF
    -DBROMWICH_MPI=OFF
    -DBROMWICH_STUDIES=OFF
    -DBUILD_TESTING=OFF
    -DCMAKE_UNITY_BUILD=ON)
vcpkg_cmake_install()
vcpkg_cmake_config_fixup(PACKAGE_NAME bromwich CONFIG_PATH lib/cmake/bromwich DO_NOT_DELETE_PARENT_CONFIG_PATH)
vcpkg_cmake_config_fixup(PACKAGE_NAME bromwich_c CONFIG_PATH lib/cmake/bromwich_c)
vcpkg_fixup_pkgconfig()
vcpkg_copy_tools(TOOL_NAMES bromwich AUTO_CLEAN)
file(REMOVE_RECURSE ${CURRENT_PACKAGES_DIR}/debug/include ${CURRENT_PACKAGES_DIR}/debug/share)
vcpkg_install_copyright(FILE_LIST ${SOURCE_PATH}/LICENSE)
