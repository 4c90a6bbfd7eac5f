# What `cmake --install` puts in place, and the Debian packages that cpack makes of it: s3lam (programs,
# configurations, man pages, completion) and s3lam-dev (headers, libraries, CMake package). Needs
# S3LAM_MODULES and S3LAM_PROGRAMS, the targets.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(S3LAM_CONFIGS_DIR ${CMAKE_INSTALL_DATADIR}/s3lam/configs)
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/s3lam)

# Debian gives each package its copyright under its own name.
set(documents ${CMAKE_INSTALL_DATADIR}/doc)
install(TARGETS ${S3LAM_PROGRAMS} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT runtime)
install(DIRECTORY configs/ DESTINATION ${S3LAM_CONFIGS_DIR} COMPONENT runtime)
install(FILES LICENSE DESTINATION ${documents}/s3lam RENAME copyright COMPONENT runtime)
install(FILES README.md DESTINATION ${documents}/s3lam COMPONENT runtime)
install(DIRECTORY ${PROJECT_BINARY_DIR}/manual/man1 DESTINATION ${CMAKE_INSTALL_MANDIR}
  COMPONENT runtime)
install(DIRECTORY ${PROJECT_BINARY_DIR}/manual/completions
  DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion COMPONENT runtime)

install(TARGETS ${S3LAM_MODULES} s3lam_all EXPORT s3lamTargets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev)
install(DIRECTORY include/s3lam DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT dev)
install(EXPORT s3lamTargets NAMESPACE s3lam:: DESTINATION ${package_dir} COMPONENT dev)
configure_package_config_file(cmake/s3lamConfig.cmake.in ${PROJECT_BINARY_DIR}/s3lamConfig.cmake
  INSTALL_DESTINATION ${package_dir} PATH_VARS S3LAM_CONFIGS_DIR)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/s3lamConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/s3lamConfig.cmake ${PROJECT_BINARY_DIR}/s3lamConfigVersion.cmake
  cmake/Findlibdeflate.cmake DESTINATION ${package_dir} COMPONENT dev)
install(FILES LICENSE DESTINATION ${documents}/s3lam-dev RENAME copyright COMPONENT dev)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_VENDOR "the s3lam authors")
set(CPACK_PACKAGE_CONTACT "the s3lam authors <s3lam@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Structure from motion with semantic planes")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL runtime dev)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME s3lam)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SUGGESTS colmap)
set(CPACK_DEBIAN_DEV_PACKAGE_NAME s3lam-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS "s3lam (= ${PROJECT_VERSION}), libceres-dev, libopencv-dev, \
libeigen3-dev, nlohmann-json3-dev, libspdlog-dev, libfmt-dev, libdeflate-dev, libsqlite3-dev")
set(CPACK_COMPONENT_DEV_DESCRIPTION "Headers, static libraries and CMake package of s3lam.")
include(CPack)
