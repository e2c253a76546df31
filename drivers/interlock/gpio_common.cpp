#include "drivers/interlock/gpio_common.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>

namespace isorig::interlock::gpio {

using drivers::DeviceError;
using drivers::Fault;

std::vector<std::string> chip_paths() {
  std::vector<std::pair<int, std::string>> found;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/dev", error)) {
    const std::string name = entry.path().filename();
    constexpr std::string_view kPrefix = "gpiochip";
    int number = 0;
    if (!name.starts_with(kPrefix)) continue;
    const auto* end = name.data() + name.size();
    if (std::from_chars(name.data() + kPrefix.size(), end, number).ptr == end) found.emplace_back(number, entry.path());
  }
  std::sort(found.begin(), found.end());
  std::vector<std::string> paths;
  for (auto& [number, path] : found) paths.push_back(std::move(path));
  return paths;
}

void fail(const GpioRequest& request, const std::string& what, int error_number) {
  const std::string text = "GPIO chip \"" + request.chip + "\": " + what + ": ";
  if (error_number == ENODEV || error_number == ENXIO) {
    throw DeviceError(Fault::kDisconnected, text + "the chip is gone; check its cable");
  }
  throw DeviceError(Fault::kDisconnected, text + std::strerror(error_number));
}

void require_one_chip(const GpioRequest& request, const std::vector<std::string>& found,
                      const std::vector<std::string>& labels) {
  if (found.size() == 1) return;
  std::string known;
  for (const auto& label : labels) known += (known.empty() ? "" : ", ") + label;
  if (found.empty()) {
    throw DeviceError(Fault::kDisconnected, "no GPIO chip is labelled \"" + request.chip + "\"; there " +
                                                (known.empty() ? "is none that may be opened" : "are: " + known));
  }
  throw DeviceError(Fault::kIdentity, std::to_string(found.size()) + " GPIO chips are labelled \"" + request.chip +
                                          "\"; the daemon must not guess which is wired to the chain");
}

std::optional<unsigned> offset_of(const GpioLine& line) {
  unsigned offset = 0;
  const auto* end = line.line.data() + line.line.size();
  if (line.line.empty() || std::from_chars(line.line.data(), end, offset).ptr != end) return std::nullopt;
  return offset;
}

void fail_missing(const GpioRequest& request, const GpioLine& line) {
  throw DeviceError(Fault::kIdentity,
                    "GPIO chip \"" + request.chip + "\" has no line \"" + line.line + "\"; gpioinfo lists them");
}

void fail_busy(const GpioRequest& request, const GpioLine& line, const char* consumer) {
  throw DeviceError(Fault::kRefused, "GPIO line \"" + line.line + "\" of \"" + request.chip + "\" is held by \"" +
                                         (consumer == nullptr || *consumer == '\0' ? "unknown" : consumer) +
                                         "\"; end that program, or name another line");
}

}  // namespace isorig::interlock::gpio
