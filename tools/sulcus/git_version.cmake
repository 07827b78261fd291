# Writes the header OUT with the commit that SOURCE stands at, "-dirty" if files differ from it; at every build, but
# only if it has changed.
execute_process(COMMAND git describe --always --dirty WORKING_DIRECTORY ${SOURCE}
                OUTPUT_VARIABLE git OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
file(CONFIGURE OUTPUT ${OUT} CONTENT "#pragma once\n\n#define SULCUS_GIT \"${git}\"\n")
