# Writes the header OUT with the commit that SOURCE stands at, "-dirty" if files other than goldens differ from it; at
# every build, but only if it has changed.
execute_process(COMMAND git describe --always WORKING_DIRECTORY ${SOURCE}
                OUTPUT_VARIABLE git OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
execute_process(COMMAND git status --porcelain -- . ":(exclude)golden" WORKING_DIRECTORY ${SOURCE}
                OUTPUT_VARIABLE changed OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
if(changed)
  string(APPEND git "-dirty")
endif()
file(CONFIGURE OUTPUT ${OUT} CONTENT "#pragma once\n\n#define SULCUS_GIT \"${git}\"\n")
