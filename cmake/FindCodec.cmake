# Finds a library that `io` reads some recordings with, in a build of evmarker and where it is installed.
#
# evmarker_find_codec(lz4) sets EVMARKER_lz4_FOUND, _INCLUDE_DIR, _LIBRARY and _PACKAGE, that of Debian.
macro(evmarker_find_codec codec)
  set(evmarker_header_lz4 lz4frame.h)
  set(evmarker_header_zstd zstd.h)
  set(EVMARKER_${codec}_PACKAGE lib${codec}-dev)
  find_path(EVMARKER_${codec}_INCLUDE_DIR ${evmarker_header_${codec}})
  find_library(EVMARKER_${codec}_LIBRARY ${codec})
  mark_as_advanced(EVMARKER_${codec}_INCLUDE_DIR EVMARKER_${codec}_LIBRARY)
  set(EVMARKER_${codec}_FOUND FALSE)
  if(EVMARKER_${codec}_INCLUDE_DIR AND EVMARKER_${codec}_LIBRARY)
    set(EVMARKER_${codec}_FOUND TRUE)
  endif()
endmacro()
