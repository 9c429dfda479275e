# Finds a library that `io` reads some recordings with, in a build of evmarker and where it is installed.
#
# evmarker_find_codec(lz4) sets EVMARKER_lz4_FOUND, _INCLUDE_DIR, _LIBRARY and _PACKAGE, that of Debian.
macro(evmarker_find_codec codec)
  set(evmarker_header_lz4 lz4frame.h)
  set(evmarker_header_zstd zstd.h)
  set(evmarker_header_bz2 bzlib.h)
  set(evmarker_header_hdf5 hdf5.h)
  set(evmarker_header_sqlite3 sqlite3.h)
  set(EVMARKER_${codec}_PACKAGE lib${codec}-dev)
  # Debian has HDF5 with and without MPI side by side.
  find_path(EVMARKER_${codec}_INCLUDE_DIR ${evmarker_header_${codec}} PATH_SUFFIXES hdf5/serial)
  find_library(EVMARKER_${codec}_LIBRARY ${codec} PATH_SUFFIXES hdf5/serial)
  mark_as_advanced(EVMARKER_${codec}_INCLUDE_DIR EVMARKER_${codec}_LIBRARY)
  set(EVMARKER_${codec}_FOUND FALSE)
  if(EVMARKER_${codec}_INCLUDE_DIR AND EVMARKER_${codec}_LIBRARY)
    set(EVMARKER_${codec}_FOUND TRUE)
  endif()
endmacro()
