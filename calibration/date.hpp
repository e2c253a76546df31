#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

/// Calendar dates as records have them: "2026-11-21", UTC. They sort as text.
namespace isorig::calibration {

/// Days since 1970-01-01; nothing for what is no date of the calendar.
[[nodiscard]] std::optional<std::int64_t> days_of(std::string_view date);
[[nodiscard]] std::string date_of(std::int64_t days);
[[nodiscard]] inline std::string later(std::string_view date, int days) {
  return date_of(days_of(date).value_or(0) + days);
}
/// Of the wall clock.
[[nodiscard]] std::string today();
/// "2026-11-21T07:15:00Z"
[[nodiscard]] std::string now_utc();

}  // namespace isorig::calibration
