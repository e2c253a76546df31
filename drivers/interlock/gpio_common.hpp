#pragma once
#include <gpiod.h>

#include <string>
#include <vector>

#include "drivers/interlock/gpio_port.hpp"

/// What both generations of libgpiod have in common.
namespace isorig::interlock::gpio {

/// /dev/gpiochip*, in the order of their numbers.
[[nodiscard]] std::vector<std::string> chip_paths();

/// Throws what `error_number` (errno) of a call on this chip amounts to. A chip that was unplugged answers ENODEV.
[[noreturn]] void fail(const GpioRequest& request, const std::string& what, int error_number);

/// Throws when `found` is not exactly one: nothing, or several chips of that label.
void require_one_chip(const GpioRequest& request, const std::vector<std::string>& found,
                      const std::vector<std::string>& labels);

/// The line's offset when it is given as a number.
[[nodiscard]] std::optional<unsigned> offset_of(const GpioLine& line);

[[noreturn]] void fail_missing(const GpioRequest& request, const GpioLine& line);
[[noreturn]] void fail_busy(const GpioRequest& request, const GpioLine& line, const char* consumer);

}  // namespace isorig::interlock::gpio
