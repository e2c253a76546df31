#include "identify/diagnose/guard/pressure_coverage.hpp"

#include <algorithm>

#include "base/number_text.hpp"
#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {

std::vector<UnreadPressure> unread_pressure(const messages::Recording& recording) {
  constexpr double kLeast_s = 1.0;
  const auto& frame_s = recording.frame.t_s;
  if (!recording.pressure || recording.pressure->size() == 0 || frame_s.empty()) return {};
  const auto& gauge_s = recording.pressure->t_s;
  std::vector<double> steps_s;
  for (std::size_t k = 1; k < gauge_s.size(); ++k) steps_s.push_back(gauge_s[k] - gauge_s[k - 1]);
  std::ranges::sort(steps_s);
  const double usual_s = steps_s.empty() ? 0.0 : steps_s[steps_s.size() * 99 / 100];
  const double longest_s = std::max(kLeast_s, deciding().gap_ratio * usual_s);
  std::vector<UnreadPressure> out;
  // Next to a reading the pressure is known, for as long as is bridged.
  const auto add = [&](double from_s, double to_s, bool read_before, bool read_behind) {
    from_s = std::max(from_s, frame_s.front());
    to_s = std::min(to_s, frame_s.back());
    if (to_s - from_s <= longest_s) return;
    from_s += read_before ? kLeast_s : 0.0;
    to_s -= read_behind ? kLeast_s : 0.0;
    if (from_s < to_s) out.push_back({from_s, to_s});
  };
  add(frame_s.front(), gauge_s.front(), false, true);
  for (std::size_t k = 1; k < gauge_s.size(); ++k) add(gauge_s[k - 1], gauge_s[k], true, true);
  add(gauge_s.back(), frame_s.back(), true, false);
  return out;
}

std::string in_words(const std::vector<UnreadPressure>& unread) {
  constexpr std::size_t kMost = 3;
  std::string text;
  for (std::size_t i = 0; i < std::min(unread.size(), kMost); ++i)
    text += (i == 0                   ? ""
             : i + 1 == unread.size() ? " and "
                                      : ", ") +
            base::number_text(unread[i].from_s, 4) + " to " + base::number_text(unread[i].to_s, 4) + " s";
  if (unread.size() > kMost) text += " and " + std::to_string(unread.size() - kMost) + " more";
  return text;
}

}  // namespace isorig::identify
