# Cross-compiled by commands of their own: one CMake project has one C++ compiler, and two custom commands per image are
# less than a project of its own. ISORIG_FIRMWARE=OFF does without the compiler.
find_program(ISORIG_ARM_CXX arm-none-eabi-g++)
find_program(ISORIG_ARM_OBJCOPY arm-none-eabi-objcopy)
find_program(ISORIG_ARM_SIZE arm-none-eabi-size)
if(NOT ISORIG_ARM_CXX OR NOT ISORIG_ARM_OBJCOPY OR NOT ISORIG_ARM_SIZE)
  message(FATAL_ERROR "arm-none-eabi-g++ not found: apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi "
                      "(scripts/setup does), or configure with -DISORIG_FIRMWARE=OFF")
endif()

set(arm_flags
  -mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard
  -std=c++20 -O2 -g -ffreestanding -fno-exceptions -fno-rtti -fno-threadsafe-statics -fno-unwind-tables
  -fno-asynchronous-unwind-tables -ffunction-sections -fdata-sections -fstack-usage
  -ffile-prefix-map=${PROJECT_SOURCE_DIR}=. -ffile-prefix-map=${PROJECT_BINARY_DIR}=build
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wdouble-promotion -Wnon-virtual-dtor
  -Woverloaded-virtual -Wformat=2 -Wstack-usage=1536
  -DISORIG_VERSION="${PROJECT_VERSION}")
if(ISORIG_WERROR)
  list(APPEND arm_flags -Werror)
endif()

isorig_include_root(firmware firmware_root)
isorig_include_root(messages messages_root)

# isorig_firmware_image(<name> LINKER_SCRIPT file SOURCES ...): <build>/firmware/<name>.elf and .hex
function(isorig_firmware_image name)
  cmake_parse_arguments(arg "" "LINKER_SCRIPT" "SOURCES" ${ARGN})
  set(objects)
  foreach(source IN LISTS arg_SOURCES)
    string(REPLACE "/" "_" object ${source})
    set(object ${CMAKE_CURRENT_BINARY_DIR}/${name}.dir/${object}.o)
    add_custom_command(OUTPUT ${object}
      COMMAND ${CMAKE_CXX_COMPILER_LAUNCHER} ${ISORIG_ARM_CXX} ${arm_flags} -I${firmware_root} -I${messages_root}
              -MD -MF ${object}.d -c ${PROJECT_SOURCE_DIR}/${source} -o ${object}
      DEPENDS ${PROJECT_SOURCE_DIR}/${source}
      DEPFILE ${object}.d
      COMMENT "Cross-compiling ${source} for ${name}" VERBATIM)
    list(APPEND objects ${object})
  endforeach()
  file(MAKE_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR}/${name}.dir)
  set(elf ${CMAKE_CURRENT_BINARY_DIR}/${name}.elf)
  set(hex ${CMAKE_CURRENT_BINARY_DIR}/${name}.hex)
  # newlib gives memcpy and its kin, libgcc the division of 64-bit integers; nothing else is taken from either.
  add_custom_command(OUTPUT ${elf} ${hex}
    COMMAND ${ISORIG_ARM_CXX} ${arm_flags} -nostdlib -nostartfiles -Wl,--gc-sections -Wl,--fatal-warnings
            -Wl,-L,${CMAKE_CURRENT_SOURCE_DIR}/cortex_m -Wl,-T,${CMAKE_CURRENT_SOURCE_DIR}/${arg_LINKER_SCRIPT}
            -Wl,-Map,${CMAKE_CURRENT_BINARY_DIR}/${name}.map ${objects} -lc_nano -lgcc -o ${elf}
    COMMAND ${ISORIG_ARM_OBJCOPY} -O ihex ${elf} ${hex}
    COMMAND ${ISORIG_ARM_SIZE} ${elf}
    DEPENDS ${objects} ${CMAKE_CURRENT_SOURCE_DIR}/${arg_LINKER_SCRIPT}
            ${CMAKE_CURRENT_SOURCE_DIR}/cortex_m/sections.ld
    COMMENT "Linking ${name}" VERBATIM)
  add_custom_target(${name} ALL DEPENDS ${elf} ${hex})
endfunction()

set(logic
  messages/teensy/device.cpp
  messages/teensy/wire.cpp
  firmware/application.cpp
  firmware/elvh_reader.cpp
  firmware/cortex_m/runtime.cpp)

isorig_firmware_image(isorig-qemu
  LINKER_SCRIPT mps2/mps2.ld
  SOURCES ${logic} firmware/mps2/machine.cpp firmware/mps2/main.cpp firmware/mps2/startup.cpp)

isorig_firmware_image(isorig-teensy36
  LINKER_SCRIPT teensy36/teensy36.ld
  SOURCES
    ${logic}
    firmware/usb_device.cpp
    firmware/teensy36/board.cpp
    firmware/teensy36/clocks.cpp
    firmware/teensy36/main.cpp
    firmware/teensy36/startup.cpp
    firmware/teensy36/usb_sie_k66.cpp)
