# `cpack` in a finished build makes two Debian packages: libevmarker-dev, and of the programs evmarker-tools.
find_program(EVMARKER_DPKG_DEB dpkg-deb)
mark_as_advanced(EVMARKER_DPKG_DEB)
if(NOT EVMARKER_DPKG_DEB)
  return()
endif()

set(packages dev)
set(package_of_dev libevmarker-dev)
set(package_of_tools evmarker-tools)
if(EVMARKER_BUILD_EXAMPLES)
  list(APPEND packages tools)
endif()

# --- The programs: names like `info` and `convert` are taken, so each begins with evmarker_ where all programs are ---

# Those that list their options with --help.
set(names calibrate calibration convert evaluate info make_board print_board replay simulate track_camera track_file)
find_program(EVMARKER_HELP2MAN help2man)
mark_as_advanced(EVMARKER_HELP2MAN)
if(EVMARKER_BUILD_EXAMPLES AND NOT EVMARKER_HELP2MAN)
  message(STATUS "help2man is not found: the programs are packaged without pages of the manual")
endif()
set(pages "")
foreach(name IN LISTS names)
  if(NOT TARGET ${name})
    continue()
  endif()
  set(link ${PROJECT_BINARY_DIR}/package/evmarker_${name})
  file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/package)
  file(CREATE_LINK ../${CMAKE_INSTALL_LIBEXECDIR}/evmarker/${name} ${link} SYMBOLIC)
  install(TARGETS ${name} DESTINATION ${CMAKE_INSTALL_LIBEXECDIR}/evmarker COMPONENT tools EXCLUDE_FROM_ALL)
  install(FILES ${link} DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT tools EXCLUDE_FROM_ALL)
  if(EVMARKER_HELP2MAN)
    set(page ${PROJECT_BINARY_DIR}/package/evmarker_${name}.1.gz)
    add_custom_command(
      OUTPUT ${page}
      COMMAND ${CMAKE_COMMAND} -D HELP2MAN=${EVMARKER_HELP2MAN} -D PROGRAM=$<TARGET_FILE:${name}>
              -D VERSION=${PROJECT_VERSION} -D PAGE=${page} -P ${PROJECT_SOURCE_DIR}/cmake/ManualPage.cmake
      DEPENDS ${name} ${PROJECT_SOURCE_DIR}/cmake/ManualPage.cmake
      VERBATIM
    )
    list(APPEND pages ${page})
    install(FILES ${page} DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT tools EXCLUDE_FROM_ALL)
  endif()
endforeach()
if(pages)
  add_custom_target(manual_pages ALL DEPENDS ${pages})
endif()

# --- What Debian wants beside -----------------------------------------------------------------------------------------

set(CPACK_PACKAGE_CONTACT "The evmarker authors <maintainers@evmarker.invalid>"
    CACHE STRING "Maintainer of the packages"
)
string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
foreach(package IN LISTS packages)
  set(name ${package_of_${package}})
  set(changelog ${PROJECT_BINARY_DIR}/package/${name}/changelog)
  file(WRITE ${changelog} "evmarker (${PROJECT_VERSION}) unstable; urgency=medium\n\n"
                          "  * Version ${PROJECT_VERSION}.\n\n -- ${CPACK_PACKAGE_CONTACT}  ${date}\n"
  )
  execute_process(COMMAND gzip -9nf ${changelog} COMMAND_ERROR_IS_FATAL ANY)
  install(FILES ${changelog}.gz DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${name} COMPONENT ${package} EXCLUDE_FROM_ALL)
  install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${name} RENAME copyright
          COMPONENT ${package} EXCLUDE_FROM_ALL
  )
endforeach()

set(CPACK_GENERATOR DEB)
set(CPACK_COMPONENTS_ALL ${packages})
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "tracks fiducial markers with an event camera")

set(CPACK_COMPONENT_DEV_DESCRIPTION
    "Headers of evmarker, which tracks fiducial markers (ArUco, AprilTag)\nin 6 degrees of freedom, event by event."
)
set(CPACK_DEBIAN_DEV_PACKAGE_NAME ${package_of_dev})
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS "libeigen3-dev (>= 3.4)")
set(CPACK_DEBIAN_DEV_PACKAGE_RECOMMENDS
    "libopencv-dev (>= 4.5), libopencv-contrib-dev (>= 4.5), libreaderwriterqueue-dev"
)
set(CPACK_DEBIAN_DEV_PACKAGE_SUGGESTS "libbz2-dev, libhdf5-dev, liblz4-dev, libsqlite3-dev, libzstd-dev")

set(CPACK_COMPONENT_TOOLS_DESCRIPTION
    "Programs that track fiducial markers (ArUco, AprilTag) in recordings\nof event cameras, convert, calibrate, simulate and measure."
)
set(CPACK_DEBIAN_TOOLS_PACKAGE_NAME ${package_of_tools})
set(CPACK_DEBIAN_TOOLS_PACKAGE_SECTION science)
set(CPACK_DEBIAN_TOOLS_PACKAGE_SHLIBDEPS ON)
include(CPack)
