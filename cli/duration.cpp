#include "cli/duration.hpp"

#include <cmath>
#include <cstdio>

namespace isorig::cli {

std::string duration_text(double seconds) {
  char text[48];
  if (seconds < 60.0) {
    std::snprintf(text, sizeof text, "%.1f s", seconds);
    return text;
  }
  const auto whole_s = static_cast<long long>(std::llround(seconds));
  if (whole_s < 3600) {
    std::snprintf(text, sizeof text, "%lld min %02lld s", whole_s / 60, whole_s % 60);
  } else {
    const long long minutes = (whole_s + 30) / 60;
    std::snprintf(text, sizeof text, "%lld h %02lld min", minutes / 60, minutes % 60);
  }
  return text;
}

}  // namespace isorig::cli
