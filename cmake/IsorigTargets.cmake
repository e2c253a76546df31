# Every folder is a room: a library target whose headers are seen only by those who link it.
# The include root of a room is a directory that holds one link, <room> -> <source>/<room>, so that
# `#include "model/slse.hpp"` compiles only for targets that link isorig_model. A folder in it with a CMakeLists.txt of
# its own is a room of its own and is left out: `#include "daemon/io/frame_service.hpp"` compiles only for those that link
# isorig_io. Two targets never share a folder: each would see the headers of both.

add_library(isorig_options INTERFACE)
target_compile_options(isorig_options INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wdouble-promotion
  -Wnon-virtual-dtor -Woverloaded-virtual -Wformat=2
  # Clang (the preset `fuzz`) warns of a float that is made a double on purpose as well: double{x}.
  $<$<CXX_COMPILER_ID:Clang>:-Wno-double-promotion>
  $<$<BOOL:${ISORIG_WERROR}>:-Werror>)
if(ISORIG_SANITIZE)
  # For the whole tree: a sanitizer that sees half of a program reports half of its faults.
  # -O1, as both sanitizers' manuals have it: the checks are the same, the tree compiles in two thirds of the time of -O2.
  add_compile_options(-O1 -fsanitize=${ISORIG_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${ISORIG_SANITIZE})
  if(ISORIG_SANITIZE MATCHES thread)
    # Boost.Asio has a fence, which the sanitizer does not see; what it orders is under a mutex as well.
    add_compile_options(-Wno-tsan)
  endif()
endif()
if(ISORIG_COVERAGE)
  # -O1: without any optimisation the tests in real time miss their deadlines. Atomic: threads count in the same place.
  add_compile_options(-O1 --coverage -fprofile-update=atomic -fprofile-abs-path)
  add_link_options(--coverage)
endif()

# isorig_loops_over_rows(<target>): most of its time goes into sums over the rows of recordings. -O2 of GCC 12 makes no
# vectors of loops whose length it does not know. Sanitizers and coverage keep their -O1.
function(isorig_loops_over_rows target)
  if(NOT ISORIG_SANITIZE AND NOT ISORIG_COVERAGE)
    target_compile_options(${target} PRIVATE $<$<CONFIG:RelWithDebInfo,Release>:-O3>)
  endif()
endfunction()

# What nearly every file reads is parsed once and not 700 times: a third of a whole build. GCC alone, since Clang refuses
# a header compiled with other definitions. A file still includes what it uses: -DISORIG_PCH=OFF is the check.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  option(ISORIG_PCH "Precompile the headers that nearly every file reads" ON)
endif()
if(ISORIG_PCH)
  # GCC takes a header only with the flags it was compiled with: programs like libraries, threads or none.
  set(CMAKE_CXX_COMPILE_OPTIONS_PIE -fPIC)
  # Out of a precompiled header GCC 12 warns of std::string's own copies (its bugs 105329, 105651).
  target_compile_options(isorig_options INTERFACE -pthread -Wno-array-bounds -Wno-restrict
    -Wno-stringop-overflow -Wno-stringop-overread)
  file(WRITE ${PROJECT_BINARY_DIR}/precompiled.cpp.in "")
  configure_file(${PROJECT_BINARY_DIR}/precompiled.cpp.in ${PROJECT_BINARY_DIR}/precompiled.cpp COPYONLY)
endif()

# GCC writes other bytes of the same headers in every tree. With CCACHE_PCH_EXTSUM, ccache knows them by this sum instead,
# of their text: what one tree has compiled, another finds.
function(isorig_precompiled_sum owner headers)
  list(TRANSFORM headers PREPEND "#include ")
  list(JOIN headers "\n" text)
  file(WRITE ${PROJECT_BINARY_DIR}/${owner}.hpp "${text}\n")
  get_target_property(eigen Eigen3::Eigen INTERFACE_INCLUDE_DIRECTORIES)
  list(TRANSFORM eigen PREPEND -I)
  execute_process(COMMAND ${CMAKE_CXX_COMPILER} -std=c++20 ${eigen} -x c++ -E -P ${PROJECT_BINARY_DIR}/${owner}.hpp
    OUTPUT_VARIABLE read COMMAND_ERROR_IS_FATAL ANY)
  string(SHA256 sum "${read}")
  file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/CMakeFiles/${owner}.dir/cmake_pch.hxx.gch.sum ${sum})
endfunction()

# isorig_precompiled(<target> [TEST])
function(isorig_precompiled target)
  if(NOT ISORIG_PCH)
    return()
  endif()
  set(owner isorig_precompiled)
  set(headers <algorithm> <array> <atomic> <chrono> <cmath> <cstdint> <filesystem> <fstream> <functional> <limits> <map>
              <memory> <mutex> <optional> <random> <set> <span> <sstream> <stdexcept> <string> <string_view> <thread>
              <utility> <variant> <vector> <Eigen/Core> <nlohmann/json.hpp>)
  set(links Eigen3::Eigen nlohmann_json::nlohmann_json)
  if("TEST" IN_LIST ARGN)
    string(APPEND owner _tests)
    list(APPEND headers <gmock/gmock.h> <gtest/gtest.h>)
    list(APPEND links GTest::gmock)
  endif()
  if(NOT TARGET ${owner})
    add_library(${owner} OBJECT ${PROJECT_BINARY_DIR}/precompiled.cpp)
    target_link_libraries(${owner} PRIVATE ${links} isorig_options)
    target_precompile_headers(${owner} PRIVATE ${headers})
    isorig_precompiled_sum(${owner} "${headers}")
  endif()
  target_precompile_headers(${target} REUSE_FROM ${owner})
endfunction()

# Several files of a target as one: what they all include is parsed once. isorig_recording, 18 files, needs 35 s of
# processor time one by one, 17 s by eights, 16 s by sixteens, 14 s as one; 20 s by eights without the precompiled headers.
# Eight: beyond, little is gained, and the second processor waits for the last file. After a change of one file the other
# seven are compiled too: the preset `dev` is without.
option(ISORIG_UNITY "Compile several files of a target at once" OFF)

# isorig_unity(<target>)
function(isorig_unity target)
  if(NOT ISORIG_UNITY)
    return()
  endif()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 8)
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    # GCC takes a .cpp that is included for a header, where a class with a member of an anonymous namespace's type is a
    # fault.
    target_compile_options(${target} PRIVATE -Wno-subobject-linkage)
  endif()
endfunction()

# Every symbol is bound at start: in the loop the first call of a function must cost what every other costs.
add_link_options(-Wl,-z,relro -Wl,-z,now)

# isorig_include_root(<room> <variable> [WHOLE]): WHOLE takes the rooms inside along.
function(isorig_include_root room out)
  set(source ${PROJECT_SOURCE_DIR}/${room})
  string(REPLACE / _ name ${room})
  if("WHOLE" IN_LIST ARGN)
    set(root ${PROJECT_BINARY_DIR}/include/${name}_whole)
  else()
    set(root ${PROJECT_BINARY_DIR}/include/${name})
    file(GLOB_RECURSE rooms_inside CONFIGURE_DEPENDS RELATIVE ${source} ${source}/*/CMakeLists.txt)
  endif()
  set(${out} ${root} PARENT_SCOPE)
  get_filename_component(above ${root}/${room} DIRECTORY)
  file(MAKE_DIRECTORY ${above})
  if(NOT rooms_inside)
    if(IS_DIRECTORY ${root}/${room} AND NOT IS_SYMLINK ${root}/${room})
      file(REMOVE_RECURSE ${root}/${room})  # of a time when it had rooms inside
    endif()
    file(CREATE_LINK ${source} ${root}/${room} SYMBOLIC)
    return()
  endif()
  # A link for each entry that is no room. Removed first, for those that have gone.
  file(REMOVE_RECURSE ${root}/${room})
  file(MAKE_DIRECTORY ${root}/${room})
  file(GLOB entries CONFIGURE_DEPENDS LIST_DIRECTORIES true RELATIVE ${source} ${source}/*)
  foreach(entry IN LISTS entries)
    if("${entry}/CMakeLists.txt" IN_LIST rooms_inside)
      continue()
    endif()
    if(rooms_inside MATCHES "(^|;)${entry}/")
      message(FATAL_ERROR "${room}/${entry} holds a room and is none itself; give it a CMakeLists.txt")
    endif()
    file(CREATE_LINK ${source}/${entry} ${root}/${room}/${entry} SYMBOLIC)
  endforeach()
endfunction()

# isorig_room(<room> [TARGET name] [OBJECT] SOURCES ... [LINKS public...] [PRIVATE private...])
# OBJECT: all of it is linked, for what only registers itself.
function(isorig_room room)
  cmake_parse_arguments(arg "OBJECT" "TARGET" "SOURCES;LINKS;PRIVATE" ${ARGN})
  if(NOT arg_TARGET)
    set(arg_TARGET isorig_${room})
  endif()
  get_property(other GLOBAL PROPERTY isorig_room_${room})
  if(other)
    message(FATAL_ERROR "${arg_TARGET} and ${other} share the folder ${room}/: an include against their direction would "
                        "compile. Give ${arg_TARGET} a folder with a CMakeLists.txt of its own")
  endif()
  set_property(GLOBAL PROPERTY isorig_room_${room} ${arg_TARGET})
  set_property(GLOBAL APPEND_STRING PROPERTY isorig_rooms "${room}\t${arg_TARGET}\t${arg_LINKS};${arg_PRIVATE}\n")
  isorig_include_root(${room} root)
  if(arg_SOURCES)
    set(kind STATIC)
    if(arg_OBJECT)
      set(kind OBJECT)
    endif()
    add_library(${arg_TARGET} ${kind} ${arg_SOURCES})
    target_include_directories(${arg_TARGET} PUBLIC ${root})
    target_link_libraries(${arg_TARGET} PUBLIC ${arg_LINKS} PRIVATE ${arg_PRIVATE} isorig_options)
    isorig_precompiled(${arg_TARGET})
    isorig_unity(${arg_TARGET})
  else()
    add_library(${arg_TARGET} INTERFACE)
    target_include_directories(${arg_TARGET} INTERFACE ${root})
    target_link_libraries(${arg_TARGET} INTERFACE ${arg_LINKS})
  endif()
endfunction()

# isorig_write_rooms(): what tests/style/rooms reads.
function(isorig_write_rooms)
  get_property(rooms GLOBAL PROPERTY isorig_rooms)
  file(WRITE ${PROJECT_BINARY_DIR}/rooms.tsv "${rooms}")
endfunction()

# isorig_program(<name> SOURCES ... LINKS ...)
function(isorig_program name)
  cmake_parse_arguments(arg "" "" "SOURCES;LINKS" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  target_link_libraries(${name} PRIVATE ${arg_LINKS} isorig_options)
  isorig_precompiled(${name})
  isorig_unity(${name})
endfunction()

# isorig_test(<name> SOURCES ... LINKS ... [REAL_TIME] [WHOLE] [LABELS ...] [TIMEOUT s])
# Labels: `asan`, `tsan` name the sanitizers a test makes sense for; `slow` keeps it out of sanitizer runs.
# REAL_TIME: a daemon and an emulated rig run in real time, both in other processes. With a compiler, a browser or a
# diagnosis beside them two processors would be too few, and the emulated rig would miss its own deadlines; hence the two
# processors that each asks of ctest. Beside each other they are harmless, since they wait most of the time: the label
# real_time is for ./test, which runs them last, three at once (two where a browser or a compiler of documents works beside
# the rig: PROCESSORS 3).
# WHOLE: the program is a single test of ctest. Its tests share what takes longest, a diagnosis that each process of its own
# would make again.
function(isorig_test name)
  cmake_parse_arguments(arg "REAL_TIME;WHOLE" "TIMEOUT" "SOURCES;LINKS;LABELS" ${ARGN})
  if(NOT arg_TIMEOUT)
    set(arg_TIMEOUT 300)  # a hang, not a slow machine: sanitizers take ten times as long
  endif()
  add_executable(${name} ${arg_SOURCES})
  target_link_libraries(${name} PRIVATE ${arg_LINKS} isorig_test_tree isorig_options GTest::gmock GTest::gtest_main)
  isorig_precompiled(${name} TEST)
  foreach(label IN ITEMS asan tsan)  # what ./test builds with that sanitizer
    if(label IN_LIST arg_LABELS)
      if(NOT TARGET tests_${label})
        add_custom_target(tests_${label})
      endif()
      add_dependencies(tests_${label} ${name})
    endif()
  endforeach()
  include(GoogleTest)
  if(arg_REAL_TIME)
    list(APPEND arg_LABELS real_time)
  endif()
  # gtest_discover_tests() flattens a list, and only its first label arrives. `ctest -L` matches within a label.
  string(REPLACE ";" "," labels "${arg_LABELS}")
  set(processors 1)
  if(arg_REAL_TIME)
    set(processors 2)
  endif()
  if(arg_WHOLE)
    add_test(NAME ${name} COMMAND ${name})
    set_tests_properties(${name} PROPERTIES TIMEOUT ${arg_TIMEOUT} LABELS "${labels}" PROCESSORS ${processors})
  else()
    set(properties TIMEOUT ${arg_TIMEOUT} PROCESSORS ${processors})
    if(labels)  # flattened, an empty one would make a label of the next word
      list(APPEND properties LABELS "${labels}")
    endif()
    gtest_discover_tests(${name} DISCOVERY_TIMEOUT 60 PROPERTIES ${properties})
  endif()
endfunction()

# isorig_vm_test(<name> COMMAND ... [MODULES ...] [QEMU arguments...] [TIMEOUT s] [ENVIRONMENT ...])
# Runs a command on Debian's own kernel in a virtual machine (docs/virtual-bench.md), one machine at a time.
function(isorig_vm_test name)
  cmake_parse_arguments(arg "" "TIMEOUT" "COMMAND;MODULES;QEMU;ENVIRONMENT" ${ARGN})
  if(NOT arg_TIMEOUT)
    set(arg_TIMEOUT 120)
  endif()
  list(JOIN arg_MODULES " " modules)
  list(JOIN arg_QEMU " " qemu)
  math(EXPR limit "${arg_TIMEOUT} + 30")  # the machine's own limit comes first, and says what it saw
  add_test(NAME vm.${name} COMMAND ${PROJECT_SOURCE_DIR}/virtual-bench/run
    --modules "${modules}" --qemu "${qemu}" --timeout ${arg_TIMEOUT} -- ${arg_COMMAND})
  isorig_vm_properties(vm.${name} ${limit} virtual_bench)
  set_tests_properties(vm.${name} PROPERTIES ENVIRONMENT "${arg_ENVIRONMENT}")
endfunction()

# isorig_vm_properties(<test> <timeout in s> <fixtures>)
# The machines together take longer than all other tests, so they begin first (COST). More PROCESSORS than one would leave
# them for last: ctest gives each processor that becomes free to a test that wants no more.
function(isorig_vm_properties test timeout fixtures)
  set_tests_properties(${test} PROPERTIES LABELS vm RESOURCE_LOCK virtual_machine COST 1000
    TIMEOUT ${timeout} FIXTURES_REQUIRED "${fixtures}")
endfunction()
