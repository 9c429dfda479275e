# Proves that the layers check finds each fault that it is there for, on small trees written here.
cmake_minimum_required(VERSION 3.24)

# Checks a tree of three good headers and one more, `path` with `text`, and expects to read `expected`.
function(expect expected path text)
  file(REMOVE_RECURSE ${SCRATCH})
  file(WRITE ${SCRATCH}/evmarker/base/ground.hpp "#pragma once\n// Ground.\n#include <vector>\n")
  file(WRITE ${SCRATCH}/evmarker/model/first.hpp
       "#pragma once\n// First.\n#include <Eigen/Core>\n#include \"evmarker/base/ground.hpp\"\n"
  )
  file(WRITE ${SCRATCH}/evmarker/io/reader.hpp "#pragma once\n// Reader.\n#include \"evmarker/model/first.hpp\"\n")
  file(WRITE ${SCRATCH}/evmarker/README.md "Rooms.\n")
  file(WRITE ${SCRATCH}/evmarker/${path} "${text}")
  execute_process(
    COMMAND ${CMAKE_COMMAND} -D INCLUDE_DIR=${SCRATCH} -P ${CHECK} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output
  )
  string(REGEX REPLACE "[ \n]+" " " output "${output}")
  string(FIND "${output}" "${expected}" found)
  if(expected MATCHES "headers are in order$")
    set(should_pass TRUE)
  else()
    set(should_pass FALSE)
  endif()
  if((result EQUAL 0 AND NOT should_pass) OR (NOT result EQUAL 0 AND should_pass) OR found EQUAL -1)
    message(FATAL_ERROR "${path} with\n${text}\nshould give '${expected}', gave (exit code ${result}):\n${output}")
  endif()
  message(STATUS "as expected: ${expected}")
endfunction()

set(head "#pragma once\n// Other.\n")
set(right "4 headers are in order")
expect("${right}" model/other.hpp "${head}#include <evmarker/base/ground.hpp>\n")
expect("${right}" model/other.hpp "${head}#include \"evmarker/model/first.hpp\"\n")
expect("${right}" evmarker.hpp "${head}#include \"evmarker/model/first.hpp\"\n")
expect("${right}" io/other.hpp "${head}#include \"evmarker/io/reader.hpp\"\n")
expect("${right}" opencv/other.hpp "${head}#include <opencv2/core/mat.hpp>\n")
expect("of a later room" base/other.hpp "${head}#include \"evmarker/model/first.hpp\"\n")
expect("includes evmarker/io/reader.hpp, which is outside of the core" model/other.hpp
       "${head}#include \"evmarker/io/reader.hpp\"\n"
)
expect("which is outside of the core" opencv/other.hpp "${head}#include \"evmarker/io/reader.hpp\"\n")
expect("which is outside of the core" evmarker.hpp "${head}#include \"evmarker/io/reader.hpp\"\n")
expect("which does not exist" model/other.hpp "${head}#include \"evmarker/nowhere.hpp\"\n")
expect("includes itself by way of others" base/ground.hpp "${head}#include \"evmarker/base/ground.hpp\"\n")
expect("includes opencv2/core.hpp" model/other.hpp "${head}  #  include <opencv2/core.hpp>\n")
expect("includes opencv2/core.hpp" io/other.hpp "${head}#include <opencv2/core.hpp>\n")
expect("includes sys/mman.h" model/other.hpp "${head}#include <sys/mman.h>\n")
expect("includes ground.hpp" base/other.hpp "${head}#include \"ground.hpp\"\n")
expect("does not say '// What it is." model/other.hpp "#pragma once\n\n// A line too late.\n")
expect("unknown room 'gui'" gui/other.hpp "${head}")
expect("unknown room ''" other.hpp "${head}")
expect("is neither a header nor a README" model/notes.txt "notes\n")
