#include "identify/diagnose/design/candidates.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "base/formatted.hpp"
#include "protocol/compile.hpp"
#include "protocol/wave.hpp"

namespace isorig::identify {
namespace {

constexpr double kRestBefore_s = 10.0, kRestAfter_s = 3.0;
/// A wave may take 5 % and 5 s more than nominal (protocol/cursor.hpp), and every turn costs kTurn_s.
constexpr int kMostCycles = 10;
/// Motion slower than that is recorded as means: full rate would only make the file large.
constexpr double kSlow_mm_s = 0.3;

std::string hold(double duration_s) {
  return base::formatted("    { do = \"hold\", duration_s = %.6g },\n", duration_s);
}

std::string ramp(double to_mm, double velocity_mm_s) {
  return base::formatted("    { do = \"ramp\", to_mm = %.6g, velocity_mm_s = %.6g%s },\n", to_mm, velocity_mm_s,
                         velocity_mm_s < kSlow_mm_s ? ", record = \"averaged\"" : "");
}

std::string triangle(double amplitude_mm, double velocity_mm_s, int cycles) {
  return base::formatted(
      "    { do = \"wave\", shape = \"triangle\", amplitude_mm = %.6g, velocity_mm_s = %.6g, cycles = %d%s },\n",
      amplitude_mm, velocity_mm_s, cycles, velocity_mm_s < kSlow_mm_s ? ", record = \"averaged\"" : "");
}

/// A sine in as many chords as the link sustains, or the triangle of that frequency when it sustains too few.
std::string oscillation(double frequency_Hz, double amplitude_mm, int cycles, const CandidateLimits& limits) {
  const double interval_s = std::max(limits.rig.segment_interval_min_s, 1e-3);
  const auto chords = static_cast<int>(std::min(0.25 / (frequency_Hz * interval_s) + 1e-9, 6.0));
  if (chords >= 2) {
    const double deviation_mm = 1.02 * protocol::wave::deviation_mm(amplitude_mm, static_cast<std::uint32_t>(chords));
    return base::formatted(
        "    { do = \"wave\", shape = \"sine\", amplitude_mm = %.6g, frequency_hz = %.6g, cycles = %d, "
        "deviation_mm = %.3g },\n",
        amplitude_mm, frequency_Hz, cycles, deviation_mm);
  }
  return triangle(amplitude_mm, 4.0 * amplitude_mm * frequency_Hz, cycles);
}

std::string pressurize(double to_psi, const CandidateLimits& limits, double settled_for_s) {
  const double rate_psi_s = std::min(limits.rig.pressure_rate_max_psi_s, 2.0);
  return base::formatted(
      "    { do = \"pressurize\", pressure_psi = %.6g, rate_psi_s = %.6g, settled_for_s = %.6g, timeout_s = "
      "%.6g },\n",
      to_psi, rate_psi_s, settled_for_s, std::ceil(60.0 + 2.0 * to_psi / rate_psi_s));
}

int turns_of(const protocol::Plan& plan) {
  int turns = 0;
  for (const auto& step : plan.steps) {
    if (step.kind == protocol::StepKind::kRamp) ++turns;
    if (step.kind == protocol::StepKind::kWave) turns += static_cast<int>(protocol::wave::strokes(step));
  }
  return turns;
}

class Builder {
 public:
  explicit Builder(const CandidateLimits& limits) : limits_(limits) {}

  void add(std::string name, std::string body) {
    try {
      CandidateExperiment item = session_of(std::move(name), std::move(body), limits_);
      if (item.duration_s <= limits_.longest_s) items_.push_back(std::move(item));
    } catch (const base::ConfigError&) {
      // Beyond the limits: not for this rig.
    }
  }
  [[nodiscard]] std::vector<CandidateExperiment> take() { return std::move(items_); }

 private:
  const CandidateLimits& limits_;
  std::vector<CandidateExperiment> items_;
};

}  // namespace

std::string protocol_text(const CandidateExperiment& item, const CandidateLimits& limits, std::string_view name,
                          std::string_view description) {
  std::string out = "format = \"isorig-protocol/1\"\nname = \"" + std::string(name) + "\"\n";
  out += "description = \"" + std::string(description) + "\"\n";
  // The way to the first position is 1 mm/s unless a protocol says otherwise: a slower rig would refuse all of them.
  constexpr double kApproach_mm_s = 1.0;
  const double approach_mm_s = std::max(std::min(kApproach_mm_s, limits.rig.speed_max_mm_s), limits.rig.speed_min_mm_s);
  if (approach_mm_s != kApproach_mm_s) out += base::formatted("approach_velocity_mm_s = %.6g\n", approach_mm_s);
  out +=
      "recording.policy = \"round_ramps\"\nrecording.average_interval_s = 0.05\n\nsteps = [\n"
      "  { do = \"repeat\", unit = \"session\", for = { repetition = [1] }, steps = [\n";
  out += pressurize(limits.nominal_psi, limits, 5.0) + hold(kRestBefore_s) + item.body + hold(kRestAfter_s);
  return out + "  ] },\n]\n";
}

CandidateExperiment session_of(std::string name, std::string body, const CandidateLimits& limits) {
  CandidateExperiment item;
  item.name = std::move(name);
  item.body = std::move(body);
  item.protocol = protocol_text(item, limits, "experiment", item.name);
  item.plan = protocol::compile(base::TomlDocument::parse_text(item.protocol, "experiment"), limits.rig);
  item.duration_s = item.plan.nominal_s + kTurn_s * turns_of(item.plan);
  return item;
}

CandidateExperiment joined(const CandidateExperiment& first, const CandidateExperiment& second,
                           const CandidateLimits& limits) {
  return session_of(first.name + "; " + second.name, first.body + hold(2.0) + second.body, limits);
}

std::string paper_ramps(double stroke_mm, double velocity_mm_s, double return_mm_s) {
  std::string body;
  for (const double sign : {1.0, -1.0})
    body += ramp(sign * stroke_mm, velocity_mm_s) + hold(30.0) + ramp(0.0, return_mm_s) + hold(30.0);
  return body;
}

namespace {

void add_motions(const CandidateLimits& limits, Builder& out) {
  const double fastest = limits.rig.speed_max_mm_s, slowest = std::max(limits.rig.speed_min_mm_s, 0.005);
  const double stroke = limits.stroke_mm;
  // The whole stroke, and round lengths below it that are not nearly the same.
  const auto lengths = [&](std::initializer_list<double> round) {
    std::vector<double> out_mm;
    for (const double length : round)
      if (length < 0.95 * stroke) out_mm.push_back(length);
    out_mm.push_back(stroke);
    return out_mm;
  };
  std::string sweep;
  for (const double frequency : {0.5, 1.0, 2.0, 4.0}) {
    // The speed of whichever shape it becomes.
    const double amplitude = std::min({1.0, stroke, 0.98 * fastest / (2.0 * std::numbers::pi * frequency)});
    for (const int cycles : {2, 5, kMostCycles})
      out.add(base::formatted("%.3g Hz, %.3g mm, %d times", frequency, amplitude, cycles),
              oscillation(frequency, amplitude, cycles, limits));
    sweep += oscillation(frequency, amplitude, 5, limits) + hold(1.0);
  }
  out.add("0.5, 1, 2 and 4 Hz, 5 times each", sweep);

  std::string ladder;
  for (const double amplitude : lengths({0.02, 0.05, 0.2, 1.0, 2.0})) {
    for (const double velocity : {slowest, 0.02, 0.1, 0.5, 2.0, 5.0, fastest}) {
      if (velocity > fastest || velocity < slowest) continue;
      // From end to end in less than a tenth of a second: that is one of the oscillations above.
      if (2.0 * amplitude / velocity < 0.1) continue;
      for (const int cycles : {2, kMostCycles})
        out.add(base::formatted("triangles of %.3g mm at %.3g mm/s, %d times", amplitude, velocity, cycles),
                triangle(amplitude, velocity, cycles));
    }
    ladder += triangle(amplitude, std::min(0.5, fastest), 2) + hold(1.0);
  }
  out.add("triangles from 0.02 mm to the whole stroke at 0.5 mm/s", ladder);

  for (const double length : lengths({1.0, 2.0})) {
    for (const double velocity : {0.1, 1.0, 0.3 * fastest, fastest}) {
      if (velocity > fastest || velocity < slowest) continue;
      for (const double rest_s : {3.0, 30.0})
        out.add(base::formatted("strokes of %.3g mm at %.3g mm/s both ways, %.3g s rest", length, velocity, rest_s),
                ramp(length, velocity) + hold(rest_s) + ramp(0.0, velocity) + hold(rest_s) + ramp(-length, velocity) +
                    hold(rest_s) + ramp(0.0, velocity));
    }
  }
  for (const double hold_s : {120.0, 600.0, 1500.0}) {
    // One that does not move at all could not be told from one whose position channel is dead.
    const double least_mm = std::min(0.2, stroke);
    out.add(base::formatted("a triangle of %.3g mm, then standing still for %.4g s", least_mm, hold_s),
            triangle(least_mm, std::min(1.0, fastest), 1) + hold(hold_s));
    out.add(base::formatted("a stroke of %.3g mm and %.4g s rest", stroke, hold_s),
            ramp(stroke, fastest) + hold(hold_s) + ramp(0.0, fastest));
    // After many strokes and a long rest, effects of the travel have gone on and effects of time have not, or the other
    // way round.
    out.add(base::formatted("triangles of %.3g mm at %.3g mm/s, 5 times, before and after %.4g s rest", stroke,
                            std::min(2.0, fastest), hold_s),
            triangle(stroke, std::min(2.0, fastest), 5) + hold(hold_s) + triangle(stroke, std::min(2.0, fastest), 5));
  }
}

void add_pressure_steps(const CandidateLimits& limits, Builder& out) {
  const double slow_mm_s = std::min(2.0, limits.rig.speed_max_mm_s), stroke = limits.stroke_mm;
  for (const double step_psi : {0.5, 1.0, 2.0}) {
    const double low = limits.nominal_psi - step_psi, high = limits.nominal_psi + step_psi;
    if (low < 0.75 * limits.nominal_psi) continue;  // below, it would be taken for the filling
    for (const double at_mm : stroke > 0.0 ? std::vector{0.0, stroke} : std::vector{0.0}) {
      std::string body;
      if (at_mm > 0.0) body += ramp(at_mm, slow_mm_s) + hold(5.0);
      for (const double psi : {low, limits.nominal_psi, high, limits.nominal_psi})
        if (psi <= limits.rig.pressure_max_psi) body += pressurize(psi, limits, 2.0) + hold(5.0);
      if (at_mm > 0.0) body += ramp(0.0, slow_mm_s);
      out.add(base::formatted("pressure steps of %.3g psi at %+.3g mm", step_psi, at_mm), body);
    }
  }
}

}  // namespace

std::vector<CandidateExperiment> candidate_experiments(const CandidateLimits& limits) {
  Builder out(limits);
  // Where the crosshead never moved nothing says how far it may.
  if (limits.stroke_mm > 0.0) add_motions(limits, out);
  if (limits.pressure_matters) add_pressure_steps(limits, out);
  auto items = out.take();
  std::ranges::stable_sort(items, {}, &CandidateExperiment::duration_s);
  return items;
}

}  // namespace isorig::identify
