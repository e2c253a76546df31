#pragma once
#include <cstdint>

namespace isorig::daemon {

[[nodiscard]] constexpr double seconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-9;
}

}  // namespace isorig::daemon
