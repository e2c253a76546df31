#include "proof/foreign_laws/laws.hpp"

namespace isorig::proof::foreign {

Signal spread_play(const Signal& position_mm, double play_mm) {
  constexpr std::size_t kPlays = 6;
  Signal grip(position_mm.size(), 0.0);
  for (std::size_t n = 0; n < kPlays; ++n) {
    const double half_mm = 0.5 * play_mm * (static_cast<double>(n) + 1.0) / kPlays;
    double at_mm = position_mm.front();
    for (std::size_t i = 0; i < position_mm.size(); ++i) {
      at_mm = std::clamp(at_mm, position_mm[i] - half_mm, position_mm[i] + half_mm);
      grip[i] += at_mm / kPlays;
    }
  }
  return grip;
}

Signal worn_play(const Signal& position_mm, double play_mm, double worn_mm) {
  Signal grip(position_mm.size());
  double at_mm = position_mm.front();
  for (std::size_t i = 0; i < position_mm.size(); ++i) {
    const double x = position_mm[i], u = x / worn_mm;
    const double half_mm = play_mm * (1.0 + 2.0 * std::exp(-u * u)) / 6.0;
    at_mm = std::clamp(at_mm, x - half_mm, x + half_mm);
    grip[i] = at_mm;
  }
  return grip;
}

Signal compliant_play(const Drive& drive, double play_mm, double time_s) {
  const double half_mm = 0.5 * play_mm;
  Signal grip(drive.size());
  integrate<1>(
      drive, {drive.position_mm.front()},
      [&](const std::array<double, 1>& y, std::size_t i, double part) {
        const double apart_mm = within(drive.position_mm, i, part) - y[0];
        return std::array{(apart_mm - std::clamp(apart_mm, -half_mm, half_mm)) / time_s};
      },
      [&](std::size_t i, const std::array<double, 1>& y) { grip[i] = y[0]; });
  return grip;
}

Signal stick_slips(const Signal& t_s, double slip_mm, std::span<const SlipEvent> events, double time_s) {
  Signal moved(t_s.size(), 0.0);
  for (std::size_t i = 0; i < t_s.size(); ++i)
    for (const SlipEvent& event : events)
      if (t_s[i] > event.at_s) moved[i] -= slip_mm * event.share * -std::expm1(-(t_s[i] - event.at_s) / time_s);
  return moved;
}

Signal afterslip(const Signal& t_s, double slip_mm, double at_s, double time_s) {
  // Half at once, the other half by a decade and a half of times after the event.
  constexpr double kPerLog = 0.5 / 3.4;
  constexpr double kAtOnce_s = 2e-3;
  Signal moved(t_s.size(), 0.0);
  for (std::size_t i = 0; i < t_s.size(); ++i) {
    const double since_s = t_s[i] - at_s;
    if (since_s <= 0.0) continue;
    moved[i] = -slip_mm * (0.5 * std::min(1.0, since_s / kAtOnce_s) + kPerLog * std::log1p(since_s / time_s));
  }
  return moved;
}

}  // namespace isorig::proof::foreign
