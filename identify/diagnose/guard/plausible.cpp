#include "identify/diagnose/guard/plausible.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <set>
#include <stdexcept>
#include <utility>

#include "base/number_text.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "messages/recording_id.hpp"

namespace isorig::identify {
namespace {

std::string in_three_digits(double value) {
  return base::number_text(value, 3);
}

struct Trend {
  double slope = 0.0;
  double correlation = 0.0;
};

Trend trend_of(const std::vector<double>& x, const std::vector<double>& y) {
  const auto n = static_cast<double>(x.size());
  double mean_x = 0.0, mean_y = 0.0, xx = 0.0, xy = 0.0, yy = 0.0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    mean_x += x[k] / n;
    mean_y += y[k] / n;
  }
  for (std::size_t k = 0; k < x.size(); ++k) {
    xx += (x[k] - mean_x) * (x[k] - mean_x);
    xy += (x[k] - mean_x) * (y[k] - mean_y);
    yy += (y[k] - mean_y) * (y[k] - mean_y);
  }
  if (xx <= 0.0 || yy <= 0.0) return {};
  return {xy / xx, xy / std::sqrt(xx * yy)};
}

/// Moves that begin and end between one reading and the next, half a second or more later.
std::size_t strokes_between_readings(const messages::FrameSamples& frame, double noise_mm) {
  const auto& t = frame.t_s;
  const auto& x = frame.position_mm;
  if (t.size() < 4) return 0;  // one before a move, one after, and one beside each
  std::vector<double> steps_s;
  for (std::size_t k = 1; k < t.size(); ++k) steps_s.push_back(t[k] - t[k - 1]);
  std::ranges::sort(steps_s);
  const double longest_usual_s = steps_s[steps_s.size() * 99 / 100];  // far beyond that it is a gap
  std::size_t count = 0;
  for (std::size_t k = 1; k + 2 < x.size(); ++k) {
    const double step_s = t[k + 1] - t[k];
    if (step_s < deciding().missed_stroke_s || step_s > deciding().gap_ratio * longest_usual_s) continue;
    const double beside_mm = std::max(std::fabs(x[k] - x[k - 1]), std::fabs(x[k + 2] - x[k + 1]));
    if (std::fabs(x[k + 1] - x[k]) >
        deciding().missed_stroke_ratio * (beside_mm + deciding().missed_stroke_noises * noise_mm))
      ++count;
  }
  return count;
}

}  // namespace

void refuse_two_clocks(const messages::Recording& recording, const std::string& name) {
  const auto& frame_s = recording.frame.t_s;
  if (!recording.pressure || recording.pressure->size() == 0 || frame_s.empty()) return;
  const auto& gauge_s = recording.pressure->t_s;
  if (gauge_s.back() >= frame_s.front() && gauge_s.front() <= frame_s.back()) return;
  throw std::invalid_argument(name + ": pressure.csv (" + in_three_digits(gauge_s.front()) + " to " +
                              in_three_digits(gauge_s.back()) + " s) and frame.csv (" +
                              in_three_digits(frame_s.front()) + " to " + in_three_digits(frame_s.back()) +
                              " s) have no time in common; are both on one clock? isorig align finds the offset");
}

void refuse_implausible(const messages::Recording& recording, const std::string& name, const model::ModelSpec& nominal,
                        const ChannelQuality& position_quality) {
  const auto& frame = recording.frame;
  const auto [low, high] = std::ranges::minmax(frame.position_mm);
  const auto& length_mm = recording.metadata.pressurized_rest_length_mm;
  if (length_mm && high - low > *length_mm)
    throw std::invalid_argument(
        name + ": the position moves by " + in_three_digits(high - low) +
        " mm, more than the specimen is long (pressurized_rest_length_mm = " + in_three_digits(*length_mm) +
        " in recording.toml); is one of the two in another unit?");
  constexpr std::size_t kEnough = 20;  // of fewer rows others say that they are too few
  if (const auto [least_N, most_N] = std::ranges::minmax(frame.force_N); least_N == most_N && frame.size() >= kEnough)
    throw std::invalid_argument(name + ": the force is " + in_three_digits(least_N) +
                                " N in every row: a load cell that is dead or not connected, or a column that nobody "
                                "filled; nothing can be learnt from it");
  if (nominal.has("spring") && high - low > deciding().moves_noises * position_quality.noise) {
    const Trend trend = trend_of(frame.position_mm, frame.force_N);
    if (trend.correlation < deciding().turned_sign_correlation)
      throw std::invalid_argument(name + ": the force falls by " + in_three_digits(-trend.slope) +
                                  " N per mm of extension, which no spring of the model can; extension and tension "
                                  "are positive: is the sign of force_N or of position_mm turned round?");
  }
  if (const std::size_t strokes = strokes_between_readings(frame, position_quality.noise);
      strokes >= deciding().missed_strokes)
    throw std::invalid_argument(name + ": " + std::to_string(strokes) +
                                " strokes begin and end between two readings; its samples are too far apart to follow "
                                "the motion: record ramps with ten readings or more");
}

void refuse_repeated(std::span<const messages::Recording> recordings, std::span<const std::string> names) {
  // A copy may have lost its pressure. Two pressures that differ are two recordings, whatever a frame that stood still
  // read meanwhile.
  const auto same = [](const messages::Recording& a, const messages::Recording& b) {
    const bool has_frame = !a.frame.t_s.empty() || !b.frame.t_s.empty();
    const bool has_pressure = a.pressure && b.pressure;
    const bool same_frame =
        a.frame.t_s == b.frame.t_s && a.frame.position_mm == b.frame.position_mm && a.frame.force_N == b.frame.force_N;
    const bool same_pressure =
        has_pressure && a.pressure->t_s == b.pressure->t_s && a.pressure->pressure_psi == b.pressure->pressure_psi;
    return same_frame && (has_pressure ? same_pressure : has_frame);
  };
  // Of the readings of the shorter gauge most are in the other's, or one of the two has none.
  const auto may_share_pressure = [](const messages::Recording& a, const messages::Recording& b) {
    if (!a.pressure || !b.pressure) return true;
    std::vector<double> of_a = a.pressure->pressure_psi, of_b = b.pressure->pressure_psi, both;
    std::ranges::sort(of_a);
    std::ranges::sort(of_b);
    std::ranges::set_intersection(of_a, of_b, std::back_inserter(both));
    return 2 * both.size() > std::min(of_a.size(), of_b.size());
  };
  std::vector<std::vector<std::uint64_t>> marks;
  for (const messages::Recording& each : recordings)
    marks.push_back(each.metadata.output == messages::Output::kForce ? messages::reading_marks(each)
                                                                     : std::vector<std::uint64_t>());
  for (std::size_t i = 0; i < recordings.size(); ++i)
    for (std::size_t k = i + 1; k < recordings.size(); ++k)
      if (same(recordings[i], recordings[k]) ||
          (messages::share_readings(marks[i], marks[k]) && may_share_pressure(recordings[i], recordings[k])))
        throw std::invalid_argument(names[k] + ": the same samples as " + names[i] +
                                    "; counted twice they would make the results look more certain than they are, so "
                                    "name one of them");
}

void refuse_several_pressures(std::span<const messages::Recording> recordings, std::span<const std::string> names,
                              const model::ModelSpec& nominal) {
  if (nominal.driven_by_pressure()) return;
  std::map<double, std::string> at_psi;
  for (std::size_t i = 0; i < recordings.size(); ++i)
    at_psi[recordings[i].metadata.nominal_pressure_psi.value_or(0.0)] += ' ' + names[i];
  if (at_psi.size() < 2) return;
  const double lowest = at_psi.begin()->first, highest = at_psi.rbegin()->first;
  const double one_psi = deciding().one_pressure_share * std::max(std::fabs(lowest), std::fabs(highest));
  if (highest - lowest <= one_psi) return;
  std::string text = "recordings at several nominal pressures, " + in_three_digits(lowest) + " to " +
                     in_three_digits(highest) +
                     " psi, are not one question: stiffness, relaxation and tare of an actuator follow its pressure, "
                     "and one material for all of them would be short of effects that are not there. Diagnose each "
                     "pressure by itself:";
  std::vector<std::pair<double, std::string>> groups;
  for (const auto& [psi, list] : at_psi) {
    if (!groups.empty() && psi - groups.back().first <= one_psi)
      groups.back().second += list;
    else
      groups.emplace_back(psi, list);
  }
  for (const auto& [psi, list] : groups)
    text += "\n  " + (psi == 0.0 ? std::string("no pressure stated") : in_three_digits(psi) + " psi") + ':' + list;
  throw std::invalid_argument(text);
}

std::string several_specimens(std::span<const std::string> specimens) {
  const std::set<std::string> names(specimens.begin(), specimens.end());
  if (names.size() < 2) return {};
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "\"" : ", \"") + name + '"';
  return "The recordings are of " + std::to_string(names.size()) + " specimens (" + list +
         ") and are fitted with one material: where the specimens differ, the difference may be named as an effect. "
         "Diagnose each specimen by itself, unless they are one under several names.";
}

std::optional<DataFault> odd_pressure(const messages::Recording& recording) {
  const auto& nominal = recording.metadata.nominal_pressure_psi;
  if (!recording.pressure || recording.pressure->size() == 0 || !nominal || *nominal <= 0.0) return std::nullopt;
  const auto& gauge = *recording.pressure;
  const auto [low, high] = std::ranges::minmax(gauge.pressure_psi);
  const double far = deciding().odd_pressure_ratio;
  if (low < far * *nominal && high > *nominal / far) return std::nullopt;
  return DataFault{"pressure", gauge.t_s.front(), gauge.t_s.back(), gauge.size(),
                   "pressure stands at " + in_three_digits(low) + " to " + in_three_digits(high) + " psi where " +
                       in_three_digits(*nominal) + " psi is nominal; is pressure.csv in another unit?"};
}

}  // namespace isorig::identify
