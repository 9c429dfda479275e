# Settings of a build of evmarker itself. A project that uses evmarker never reads this file.

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "Build type" FORCE)
endif()
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_VERIFY_INTERFACE_HEADER_SETS ON)

find_program(EVMARKER_CCACHE ccache)
mark_as_advanced(EVMARKER_CCACHE)
if(EVMARKER_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${EVMARKER_CCACHE})
endif()
