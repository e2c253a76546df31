#include "base/utc_text.hpp"

#include <ctime>
#include <iomanip>
#include <sstream>

namespace isorig::base {

std::string utc_text(std::int64_t unix_s, const char* format) {
  const auto seconds = static_cast<std::time_t>(unix_s);
  std::tm tm{};
  gmtime_r(&seconds, &tm);
  std::ostringstream text;
  text << std::put_time(&tm, format);
  return text.str();
}

}  // namespace isorig::base
