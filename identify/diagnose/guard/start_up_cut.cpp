#include "identify/diagnose/guard/start_up_cut.hpp"

#include <algorithm>
#include <cmath>

#include "base/formatted.hpp"
#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {
namespace {

void keep(std::vector<double>& values, std::size_t from, std::size_t end) {
  values.erase(values.begin() + static_cast<std::ptrdiff_t>(end), values.end());
  values.erase(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(from));
}

std::pair<std::size_t, std::size_t> rows_within(const std::vector<double>& t_s, double from_s, double to_s) {
  const auto first = std::ranges::lower_bound(t_s, from_s), last = std::ranges::upper_bound(t_s, to_s);
  return {static_cast<std::size_t>(first - t_s.begin()), static_cast<std::size_t>(last - t_s.begin())};
}

}  // namespace

std::optional<DataFault> cut_start_up(messages::Recording& recording) {
  const double nominal_psi = recording.metadata.nominal_pressure_psi.value_or(0.0);
  if (!recording.pressure || recording.pressure->size() < 2 || nominal_psi <= 0.0) return std::nullopt;
  auto& [t_s, pressure_psi] = *recording.pressure;
  const double near_psi = std::max(deciding().filled_near_share * nominal_psi, deciding().filled_near_psi);
  const auto near = [&](double psi) { return std::fabs(psi - nominal_psi) <= near_psi; };
  double from_s = t_s.front(), to_s = t_s.back();
  if (pressure_psi.front() < deciding().filled_share * nominal_psi) {
    double since_s = t_s.front();
    bool found = false;
    for (std::size_t k = 0; k < t_s.size() && !found; ++k) {
      if (!near(pressure_psi[k]))
        since_s = t_s[k];
      else if (t_s[k] - since_s >= deciding().filled_stays_s) {
        from_s = t_s[k];
        found = true;
      }
    }
    if (!found) return std::nullopt;  // never there: not a filling, and not ours to judge
  }
  if (pressure_psi.back() < deciding().filled_share * nominal_psi) {
    // By the time the pressure has left its band, it has been falling for a while.
    const auto last = std::ranges::find_if(pressure_psi.rbegin(), pressure_psi.rend(), near);
    if (last != pressure_psi.rend())
      to_s = t_s[static_cast<std::size_t>(pressure_psi.rend() - last) - 1] - deciding().filled_stays_s;
  }
  if (from_s == t_s.front() && to_s == t_s.back()) return std::nullopt;
  auto& frame = recording.frame;
  const bool to_the_end = to_s == t_s.back();
  const auto [first, end] = rows_within(frame.t_s, from_s, to_the_end ? HUGE_VAL : to_s);
  DataFault cut{"filling", frame.t_s.front(), from_s, frame.size() - (end - first), {}};
  if (cut.rows == 0 || end <= first) return std::nullopt;
  cut.text = base::formatted("%zu rows outside of %.6g to %.6g s, where the pressure is built up or let go, left out",
                             cut.rows, from_s, to_the_end ? frame.t_s.back() : to_s);
  for (auto* column : {&frame.t_s, &frame.position_mm, &frame.force_N}) keep(*column, first, end);
  const auto [first_p, end_p] = rows_within(t_s, from_s, to_s);
  keep(t_s, first_p, end_p);
  keep(pressure_psi, first_p, end_p);
  return cut;
}

}  // namespace isorig::identify
