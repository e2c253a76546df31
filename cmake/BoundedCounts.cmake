# cmake -DHEADERS=a.hpp;b.hpp -P BoundedCounts.cmake: lcm-gen's decoders make room for as many elements as a message says
# it has, before they look whether so many can be in it: one with a count of 2^31 - 1 takes 64 GB. Every element takes a
# byte or more, so a count beyond the bytes that are left is refused, as other faults are; so is the length of a text
# below one, from which one is subtracted. What lcm-gen makes is checked here, since a version that writes it otherwise
# would go unnoticed.
set(bounded 0)
foreach(header IN LISTS HEADERS)
  file(READ ${header} text)
  string(REGEX REPLACE "([\n] *)(this->[A-Za-z0-9_]+\\.resize\\((this->[a-z_]+)\\);)"
    "\\1if(\\3 < 0 || \\3 > maxlen - pos) return -1;\\1\\2" changed "${text}")
  string(REGEX REPLACE "if\\((__[A-Za-z0-9_]+_len__) > maxlen - pos\\) return -1;"
    "if(\\1 < 1 || \\1 > maxlen - pos) return -1;" changed "${changed}")
  if(NOT changed STREQUAL text)
    math(EXPR bounded "${bounded} + 1")
    file(WRITE ${header} "${changed}")
  endif()
endforeach()
if(bounded EQUAL 0)
  message(FATAL_ERROR "lcm-gen's decoders have no resize() that could be bounded: look at cmake/BoundedCounts.cmake")
endif()
