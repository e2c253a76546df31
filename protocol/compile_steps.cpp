#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "base/number_text.hpp"
#include "protocol/compiler.hpp"
#include "protocol/force_slope.hpp"
#include "protocol/wave.hpp"

/// A step of each kind, against what the rig can do.
namespace isorig::protocol {
namespace {

/// Limits are decimal numbers, positions are sums of them.
constexpr double kEpsilon = 1e-9;
/// A wave whose frequency is off by more than this share is named, unless the protocol says what it bears.
constexpr double kFrequencyShare = 0.05;

/// Of a set-point: beyond it a session is not one at its pressure. As [pressure_loop] settled_tolerance_psi.
constexpr double kWidestTolerance_psi = 2.0;
/// Between a set-point and the limit of the rig: overshoot, the reading's noise and what a stroke changes.
constexpr double kRoomBelowLimit_psi = 0.3;

}  // namespace

using syntax::Node;

void Compiler::pressurize(const Node& node, Step& out) {
  const double before_psi = out.pressure_psi;
  out.pressure_psi = value(node, "pressure_psi", {0.0, 1000.0}, before_psi);
  out.tolerance_psi = value(node, "tolerance_psi", {0.0, kWidestTolerance_psi, true}, 0.1);
  out.settled_for_s = value(node, "settled_for_s", {0.0, 3600.0}, 1.0);
  out.rate_psi_s = value(node, "rate_psi_s", base::kPositive, 1.0);
  out.timeout_s = value(node, "timeout_s", {0.0, 24 * 3600.0, true}, 60.0);
  if (out.pressure_psi > limits_.pressure_max_psi && all_well(node, {"pressure_psi"})) {
    note(node.table, "pressure_psi",
         said(node, "pressure_psi", out.pressure_psi) + "; the rig allows at most " +
             number_text(limits_.pressure_max_psi) + " (limits.pressure_max_psi)");
  } else if (out.pressure_psi > limits_.regulator_max_psi && all_well(node, {"pressure_psi"})) {
    note(node.table, "pressure_psi",
         said(node, "pressure_psi", out.pressure_psi) + "; the rig's regulator takes at most " +
             number_text(limits_.regulator_max_psi) + " (regulator.max_psi)");
  } else if (out.pressure_psi > limits_.pressure_max_psi - kRoomBelowLimit_psi) {
    auto warning = node.table.where("pressure_psi");
    if (warned_.insert({warning.line, warning.column}).second) {
      warning.message = said(node, "pressure_psi", out.pressure_psi) + "; the rig stops at " +
                        number_text(limits_.pressure_max_psi) +
                        " psi (limits.pressure_max_psi), and overshoot, noise and strokes may reach " +
                        number_text(kRoomBelowLimit_psi) + " psi above a set-point: ask for less";
      plan_.warnings.push_back(warning.text());
    }
  }
  if (out.rate_psi_s > limits_.pressure_rate_max_psi_s && all_well(node, {"rate_psi_s"})) {
    note(node.table, "rate_psi_s",
         said(node, "rate_psi_s", out.rate_psi_s) + "; the rig allows at most " +
             number_text(limits_.pressure_rate_max_psi_s) + " (limits.pressure_rate_max_psi_s)");
  }
  const double rate_psi_s = std::min(out.rate_psi_s, limits_.loop_rate_max_psi_s);
  out.nominal_s = std::abs(out.pressure_psi - before_psi) / rate_psi_s + out.settled_for_s;
  // Resumed, a session starts from a vented actuator.
  const double longest_s = std::max(out.nominal_s, out.pressure_psi / rate_psi_s + out.settled_for_s);
  if (all_well(node, {"pressure_psi", "rate_psi_s", "settled_for_s", "timeout_s"}) && out.timeout_s <= longest_s) {
    note(node.table, "timeout_s",
         said(node, "timeout_s", out.timeout_s) + ", but the set-point alone takes " + number_text(longest_s) +
             " s at " +
             (rate_psi_s < out.rate_psi_s
                  ? number_text(rate_psi_s) + " psi/s, the most that the rig's pressure loop follows "
                                              "(pressure_loop.rate_limit_psi_s)"
                  : std::string("rate_psi_s")) +
             ", settled_for_s included; allow clearly more");
  }
}

void Compiler::settle(const Node& node, Step& out) {
  out.force_slope_N_s = value(node, "force_slope_N_s", base::kPositive, 1.0);
  out.window_s = value(node, "window_s", {ForceSlope::kMinWindow_s, 3600.0}, 10.0);
  out.settled_for_s = value(node, "settled_for_s", {0.0, 3600.0}, 2.0);
  out.timeout_s = value(node, "timeout_s", {0.0, kWeek_s, true}, 60.0);
  out.on_timeout = node.on_timeout;
  const double shortest_s = out.window_s + out.settled_for_s;
  out.nominal_s = value(node, "expected_s", base::kPositive, shortest_s);
  if (all_well(node, {"window_s", "settled_for_s", "timeout_s"}) && out.timeout_s <= shortest_s) {
    note(node.table, "timeout_s",
         said(node, "timeout_s", out.timeout_s) +
             ", but the force cannot be judged in "
             "less than window_s + settled_for_s = " +
             number_text(shortest_s) + " s");
  } else if (all_well(node, {"expected_s", "window_s", "settled_for_s", "timeout_s"}) &&
             (out.nominal_s < shortest_s || out.nominal_s > out.timeout_s)) {
    note(node.table, "expected_s",
         said(node, "expected_s", out.nominal_s) +
             "; it lies between window_s + "
             "settled_for_s = " +
             number_text(shortest_s) + " s and timeout_s = " + number_text(out.timeout_s) + " s");
  }
}

void Compiler::ramp(const Node& node, Step& out) {
  out.target_mm = value(node, "to_mm", {}, position_mm_);
  out.velocity_mm_s = value(node, "velocity_mm_s", base::kPositive, 1.0);
  if (all_well(node, {"velocity_mm_s"})) check_speed(node, "velocity_mm_s", out.velocity_mm_s);
  if (outside_travel(out.target_mm, out.velocity_mm_s)) {
    note(node.table, "to_mm",
         said(node, "to_mm", out.target_mm) + "; " + travel_range(out.target_mm, out.velocity_mm_s));
    out.target_mm = position_mm_;  // what follows is checked from where the rig can be
  }
  const double distance_mm = std::abs(out.target_mm - position_mm_);
  out.nominal_s = distance_mm / out.velocity_mm_s;
  out.position_after_mm = out.target_mm;
  plan_.travel_mm += distance_mm;
}

void Compiler::wave(const Node& node, Step& out) {
  out.shape = node.shape;
  out.target_mm = position_mm_;
  out.amplitude_mm = value(node, "amplitude_mm", base::kPositive, 1.0);
  out.cycles = static_cast<std::uint32_t>(whole(node, "cycles", {1.0, 1e6}));
  const bool sine = node.shape == WaveShape::kSine;
  // Peak speed per Hz: 4 A f for a triangle, 2 pi A f for a sine.
  const double speed_per_hz = (sine ? 2.0 * std::numbers::pi : 4.0) * out.amplitude_mm;
  const bool by_velocity = node.table.has("velocity_mm_s");
  const char* rate_key = by_velocity ? "velocity_mm_s" : "frequency_hz";
  if (by_velocity) {
    out.velocity_mm_s = value(node, rate_key, base::kPositive, 1.0);
    out.frequency_hz = out.velocity_mm_s / speed_per_hz;
  } else {
    out.frequency_hz = value(node, rate_key, base::kPositive, 0.1);
    out.velocity_mm_s = out.frequency_hz * speed_per_hz;
  }
  out.nominal_s = out.cycles / out.frequency_hz;
  out.reached_hz = out.frequency_hz;
  plan_.travel_mm += 4.0 * out.amplitude_mm * out.cycles;
  if (!all_well(node, {"amplitude_mm", rate_key})) return;
  check_speed(node, rate_key, out.velocity_mm_s);
  double turning_mm_s = out.velocity_mm_s;
  if (sine) {
    cut_sine(node, out, rate_key);
    turning_mm_s = wave::quarter_speed_mm_s(out, out.segments_per_quarter - 1);
  } else {
    check_interval(node, rate_key, 0.25 / out.frequency_hz, "quarter of a cycle");
  }
  const double turning_s = limits_.turn_s(turning_mm_s);
  out.nominal_s += wave::strokes(out) * turning_s;
  out.reached_hz = out.cycles / out.nominal_s;
  if (!by_velocity) check_frequency(node, out, turning_s);
  for (const double end_mm : {position_mm_ - out.amplitude_mm, position_mm_ + out.amplitude_mm}) {
    if (outside_travel(end_mm, turning_mm_s)) {
      note(node.table, "amplitude_mm",
           said(node, "amplitude_mm", out.amplitude_mm) + " about " + number_text(position_mm_) + " mm goes to " +
               number_text(end_mm) + "; " + travel_range(end_mm, turning_mm_s));
    }
  }
}

void Compiler::cut_sine(const Node& node, Step& out, const char* rate_key) {
  const double allowed_mm =
      value(node, "deviation_mm", {1e-4 * out.amplitude_mm, out.amplitude_mm / 4.0}, 0.01 * out.amplitude_mm);
  out.segments_per_quarter = static_cast<std::uint32_t>(
      std::ceil(std::numbers::pi / (4.0 * std::acos(1.0 - allowed_mm / out.amplitude_mm)) - kEpsilon));
  out.deviation_mm = wave::deviation_mm(out.amplitude_mm, out.segments_per_quarter);
  check_interval(node, rate_key, 0.25 / (out.frequency_hz * out.segments_per_quarter),
                 "segment of a sine cut in " + std::to_string(4 * out.segments_per_quarter));
  const double slowest_mm_s = wave::quarter_speed_mm_s(out, out.segments_per_quarter - 1);
  if (slowest_mm_s < limits_.speed_min_mm_s) {
    note(node.table, rate_key,
         said(node, rate_key, value(node, rate_key, {}, 0.0)) + " needs a segment at " + number_text(slowest_mm_s) +
             " mm/s at the turning points; the rig's slowest is " + number_text(limits_.speed_min_mm_s) +
             " (limits.speed_min_mm_s): be faster or allow a larger deviation_mm");
  }
}

/// The frame comes to rest at each turning point, and that takes its time however short the stroke is.
void Compiler::check_frequency(const Node& node, const Step& wave, double turning_s) {
  const bool demanded = node.table.has("frequency_tolerance");
  const double share = value(node, "frequency_tolerance", {0.0, 1.0}, kFrequencyShare);
  if (1.0 - wave.reached_hz / wave.frequency_hz <= share || !all_well(node, {"cycles", "frequency_tolerance"})) return;
  const std::string what = said(node, "frequency_hz", wave.frequency_hz) + "; the rig will run it at about " +
                           base::number_text(wave.reached_hz, 3) + " Hz, since its frame stands for some " +
                           base::number_text(turning_s, 2) +
                           " s at each turning point (limits.turning_time_s): be slower";
  if (demanded) {
    note(node.table, "frequency_hz", what + ", or allow a larger frequency_tolerance");
    return;
  }
  auto warning = node.table.where("frequency_hz");
  if (!warned_.insert({warning.line, warning.column}).second) return;
  warning.message = what + ", or say by frequency_tolerance how far off it may be";
  plan_.warnings.push_back(warning.text());
}

void Compiler::mark(const Node& node, Step& out) {
  std::string error;
  const auto text = fill_in(node.label, bindings(), error);
  if (!text) {
    note(node.table, "label", "`label`: " + error);
  } else if (text->size() >= sizeof out.label) {
    note(node.table, "label",
         "`label` = \"" + *text + "\" is too long; at most " + std::to_string(sizeof out.label - 1) + " bytes");
  } else {
    std::memcpy(out.label, text->c_str(), text->size());
  }
}

void Compiler::check_speed(const Node& node, std::string_view key, double speed_mm_s) {
  if (speed_mm_s <= limits_.speed_max_mm_s * (1.0 + kEpsilon) &&
      speed_mm_s >= limits_.speed_min_mm_s * (1.0 - kEpsilon)) {
    return;
  }
  const double given = value(node, key, {}, speed_mm_s);
  note(node.table, key,
       said(node, key, given) + (given == speed_mm_s ? "" : ", a peak of " + number_text(speed_mm_s) + " mm/s") + "; " +
           speed_range());
}

void Compiler::check_interval(const Node& node, std::string_view key, double interval_s, const std::string& what) {
  if (interval_s >= limits_.segment_interval_min_s * (1.0 - kEpsilon)) return;
  note(node.table, key,
       said(node, key, value(node, key, {}, 0.0)) + " makes every " + what + " last " + number_text(interval_s) +
           " s; the rig's frame takes one per " + number_text(limits_.segment_interval_min_s) +
           " s (limits.segment_interval_min_s): be slower" +
           (node.shape == WaveShape::kSine ? " or allow a larger deviation_mm" : ""));
}

bool Compiler::outside_travel(double position_mm, double velocity_mm_s) const {
  const double room_mm = Limits::travel_room_mm(velocity_mm_s) - kEpsilon;
  return position_mm > limits_.travel_max_mm - room_mm || position_mm < limits_.travel_min_mm + room_mm;
}

std::string Compiler::travel_range(double position_mm, double velocity_mm_s) const {
  const std::string range = "the rig travels from " + number_text(limits_.travel_min_mm) + " to " +
                            number_text(limits_.travel_max_mm) + " mm (limits.travel_min_mm, limits.travel_max_mm)";
  if (outside_travel(position_mm, 0.0)) return range;
  return range + ", and a crosshead at " + number_text(velocity_mm_s) + " mm/s runs over its target: stay " +
         number_text(Limits::travel_room_mm(velocity_mm_s)) + " mm inside, or be slower";
}

std::string Compiler::speed_range() const {
  return "the rig allows " + number_text(limits_.speed_min_mm_s) + " to " + number_text(limits_.speed_max_mm_s) +
         " mm/s (limits.speed_min_mm_s, limits.speed_max_mm_s)";
}

}  // namespace isorig::protocol
