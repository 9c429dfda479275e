# Makes a page of the manual of what a program answers to --help, under the name by which it is installed:
#   cmake -D HELP2MAN=help2man -D PROGRAM=info -D VERSION=0.2.0 -D PAGE=evmarker_info.1.gz -P cmake/ManualPage.cmake
cmake_minimum_required(VERSION 3.24)

get_filename_component(name ${PROGRAM} NAME)
get_filename_component(folder ${PAGE} DIRECTORY)
set(link ${folder}/called/evmarker_${name})
file(MAKE_DIRECTORY ${folder}/called)
file(CREATE_LINK ${PROGRAM} ${link} SYMBOLIC)
execute_process(COMMAND ${link} --help OUTPUT_VARIABLE help COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCH "^[^\n]*" summary "${help}")
string(REGEX REPLACE "\\.$" "" summary "${summary}")
string(REGEX REPLACE "\\.gz$" "" page ${PAGE})
execute_process(
  COMMAND ${HELP2MAN} --no-info --section 1 --source evmarker --version-string ${VERSION} --name ${summary}
          --output ${page} ${link}
  COMMAND_ERROR_IS_FATAL ANY
)
execute_process(COMMAND gzip -9nf ${page} COMMAND_ERROR_IS_FATAL ANY)
