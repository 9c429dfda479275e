# Toolchain: GCC for aarch64 Linux on another processor, and QEMU, which runs what it builds. See tests/aarch64.sh.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)

set(CMAKE_TRY_COMPILE_PLATFORM_VARIABLES EVMARKER_SYSROOT) # configuring compiles small projects, which read this file, too
set(EVMARKER_SYSROOT "" CACHE PATH "Folder of an aarch64 Debian, with the libraries")
if(NOT IS_DIRECTORY "${EVMARKER_SYSROOT}/usr/lib/aarch64-linux-gnu")
  message(FATAL_ERROR "EVMARKER_SYSROOT: '${EVMARKER_SYSROOT}' holds no aarch64 Debian (bash tests/aarch64.sh makes one)")
endif()
set(CMAKE_SYSROOT ${EVMARKER_SYSROOT})
set(CMAKE_CROSSCOMPILING_EMULATOR qemu-aarch64 -L ${CMAKE_SYSROOT})

set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
