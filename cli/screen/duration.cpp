#include "cli/screen/duration.hpp"

#include <cmath>

#include "base/formatted.hpp"

namespace isorig::cli {

std::string duration_text(double seconds) {
  if (seconds < 60.0) return base::formatted("%.1f s", seconds);
  const auto whole_s = static_cast<long long>(std::llround(seconds));
  if (whole_s < 3600) return base::formatted("%lld min %02lld s", whole_s / 60, whole_s % 60);
  const long long minutes = (whole_s + 30) / 60;
  return base::formatted("%lld h %02lld min", minutes / 60, minutes % 60);
}

}  // namespace isorig::cli
