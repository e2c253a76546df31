# cmake -DSOURCE=... -DOUT=... -P Revision.cmake: writes the source's git revision into a header, if it has changed.
# "unknown" where there is no git or no repository: a tar ball.
execute_process(COMMAND git -C ${SOURCE} describe --always --dirty --abbrev=12
  OUTPUT_VARIABLE revision ERROR_QUIET OUTPUT_STRIP_TRAILING_WHITESPACE RESULT_VARIABLE failed)
if(failed OR NOT revision)
  set(revision unknown)
endif()
set(text "#pragma once\n\nnamespace isorig::daemon {\ninline constexpr const char* kRevision = \"${revision}\";\n}  // namespace isorig::daemon\n")
set(present "")
if(EXISTS ${OUT})
  file(READ ${OUT} present)
endif()
if(NOT present STREQUAL text)
  file(WRITE ${OUT} "${text}")
endif()
