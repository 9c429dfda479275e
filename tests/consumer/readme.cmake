# Includes one of the README's CMake samples, unchanged: that which begins with BEGIN. It links `your_program`.
file(READ ${CMAKE_CURRENT_LIST_DIR}/../../README.md page)
string(FIND "${page}" "```cmake\n${BEGIN}" begin)
if(begin EQUAL -1)
  message(FATAL_ERROR "README.md has no CMake sample that begins with '${BEGIN}'")
endif()
string(SUBSTRING "${page}" ${begin} -1 sample)
string(REGEX REPLACE "^```cmake\n([^`]*)```.*" "\\1" sample "${sample}")
file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/sample.cmake "${sample}")

add_executable(your_program ${CMAKE_CURRENT_LIST_DIR}/core.cpp)
include(${CMAKE_CURRENT_BINARY_DIR}/sample.cmake)
