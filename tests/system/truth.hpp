#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "messages/run_log.hpp"

/// What was recorded against what the plant did.
namespace isorig::system_test {

struct PlantState {
  std::int64_t mono_ns = 0;
  double position_mm = 0.0, force_N = 0.0, pressure_psi = 0.0;
};

/// The plant's states, one per physics step but where its host stood still.
class Truth {
 public:
  void add(const PlantState& state) {
    if (states_.empty() || state.mono_ns > states_.back().mono_ns) states_.push_back(state);
  }
  /// isorig-simrig --truth
  static Truth read(const std::filesystem::path& csv) {
    Truth truth;
    std::ifstream in(csv);
    std::string line;
    std::getline(in, line);
    while (std::getline(in, line)) {
      PlantState s;
      long long ns = 0;
      if (std::sscanf(line.c_str(), "%lld,%lf,%lf,%lf", &ns, &s.position_mm, &s.force_N, &s.pressure_psi) != 4)
        continue;
      s.mono_ns = ns;
      truth.add(s);
    }
    return truth;
  }

  struct Point {
    double value = 0.0;
    double slope_per_s = 0.0;  ///< the steepest in the neighbourhood
  };
  /// Nothing where the steps round `mono_ns` are further apart than 3 ms.
  [[nodiscard]] std::optional<Point> at(std::int64_t mono_ns, double PlantState::*what) const {
    const auto after = std::lower_bound(states_.begin(), states_.end(), mono_ns,
                                        [](const PlantState& s, std::int64_t t) { return s.mono_ns < t; });
    if (after - states_.begin() < 2 || states_.end() - after < 2) return std::nullopt;
    Point point;
    for (auto i = after - 1; i <= after + 1; ++i) {
      const auto before = i - 1;
      const auto step_ns = static_cast<double>(i->mono_ns - before->mono_ns);
      if (step_ns > 3e6) return std::nullopt;
      const double slope = ((*i).*what - (*before).*what) / step_ns;
      point.slope_per_s = std::max(point.slope_per_s, std::abs(slope) * 1e9);
      if (i == after) point.value = (*before).*what + slope * static_cast<double>(mono_ns - before->mono_ns);
    }
    return point;
  }
  [[nodiscard]] std::size_t size() const { return states_.size(); }

 private:
  std::vector<PlantState> states_;
};

/// One channel of full-rate samples. A sample may differ by `noise` and by what the plant moved within its stamp's
/// bound.
struct Comparison {
  double noise = 0.0;
  std::size_t compared = 0, unseen = 0, outside = 0;
  double worst = 0.0;         ///< difference
  double worst_excess = 0.0;  ///< beyond what is allowed
  double sum_squares = 0.0;
  double stamp_squares = 0.0;  ///< of the difference over the slope, where the plant is fast
  std::size_t stamps = 0;

  void add(const Truth& truth, double PlantState::*what, std::int64_t mono_ns, double bound_ns, double value,
           double fast_per_s) {
    const auto point = truth.at(mono_ns, what);
    if (!point) {
      ++unseen;
      return;
    }
    const double error = value - point->value;
    const double allowed = noise + bound_ns * 1e-9 * point->slope_per_s;
    ++compared;
    sum_squares += error * error;
    worst = std::max(worst, std::abs(error));
    worst_excess = std::max(worst_excess, std::abs(error) - allowed);
    if (std::abs(error) > allowed) ++outside;
    if (point->slope_per_s > fast_per_s) {
      stamp_squares += error * error / (point->slope_per_s * point->slope_per_s);
      ++stamps;
    }
  }
  [[nodiscard]] double rms() const {
    return compared == 0 ? 0.0 : std::sqrt(sum_squares / static_cast<double>(compared));
  }
  [[nodiscard]] double stamp_rms_us() const {
    return stamps == 0 ? 0.0 : 1e6 * std::sqrt(stamp_squares / static_cast<double>(stamps));
  }
  void print(const char* name, const char* unit) const {
    std::printf(
        "  %-8s %zu samples (%zu where the truth has a gap): rms %.5f %s, worst %.5f; outside noise + bound x slope: "
        "%zu\n",
        name, compared, unseen, rms(), unit, worst, outside);
  }
};

/// Reads a run's full-rate samples and its averages, compares them with the truth, and checks that every sample of each
/// device is there exactly once.
class RunComparison : public messages::RunVisitor {
 public:
  /// Noise as in config/rigs/sim.toml, six sigma; 1 count of the sensor is 0.0023 psi.
  explicit RunComparison(const Truth& truth) : truth_(truth) {
    position.noise = 6 * 0.0002 + 0.0001;
    force.noise = 6 * 0.01 + 0.001;
    pressure_psi.noise = 6 * 0.0023 + 0.0023;
    mean_position.noise = 0.001;
  }
  void frame(const isorig_msgs::frame_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      const std::int64_t at = m.mono_ns + m.mono_offset_ns[i];
      const double bound = static_cast<double>(m.bound_ns[i]);
      worst_bound_us = std::max(worst_bound_us, bound * 1e-3);
      position.add(truth_, &PlantState::position_mm, at, bound, m.position_mm[i], 9.0);
      force.add(truth_, &PlantState::force_N, at, bound, m.force_N[i], 1e9);
      frame_sequence.add(m.sequence + m.sequence_offset[i], m.sequence + m.sequence_offset[i]);
      last_mono_ns = std::max(last_mono_ns, at);
    }
  }
  void pressure(const isorig_msgs::pressure_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      const std::int64_t at = m.mono_ns + m.mono_offset_ns[i];
      pressure_sequence.add(m.sequence + m.sequence_offset[i], m.sequence + m.sequence_offset[i]);
      if (m.status[i] != 0) continue;
      pressure_psi.add(truth_, &PlantState::pressure_psi, at, static_cast<double>(m.bound_ns[i]), m.pressure_psi[i],
                       1e9);
    }
  }
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      frame_sequence.add(m.first_sequence[i], m.last_sequence[i]);
      last_mono_ns = std::max(last_mono_ns, m.last_mono_ns[i]);
      // The mean of what lies evenly between the first and the last sample.
      constexpr int kParts = 20;
      double sum = 0.0, slope = 0.0;
      bool seen = true;
      for (int k = 0; k <= kParts && seen; ++k) {
        const auto at = m.first_mono_ns[i] + (m.last_mono_ns[i] - m.first_mono_ns[i]) * k / kParts;
        const auto point = truth_.at(at, &PlantState::position_mm);
        seen = point.has_value();
        if (!seen) break;
        sum += point->value * (k == 0 || k == kParts ? 0.5 : 1.0);
        slope = std::max(slope, point->slope_per_s);
      }
      if (!seen) {
        ++mean_position.unseen;
        continue;
      }
      const double error = std::abs(m.mean_position_mm[i] - sum / kParts);
      ++mean_position.compared;
      mean_position.sum_squares += error * error;
      mean_position.worst = std::max(mean_position.worst, error);
      // Half a sample at each end is what the two means may be apart.
      if (error > mean_position.noise + 0.0006 * slope) ++mean_position.outside;
    }
  }
  void pressure_average(const isorig_msgs::pressure_average_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      pressure_sequence.add(m.first_sequence[i], m.last_sequence[i]);
    }
  }

  /// A device's counter: every number has to be there once, in full or within an average.
  struct Sequence {
    void add(std::int64_t first, std::int64_t last) { intervals.push_back({first, last}); }
    void count() {
      std::sort(intervals.begin(), intervals.end());
      std::int64_t next = -1;
      for (const auto& [first, last] : intervals) {
        samples += static_cast<std::uint64_t>(last - first + 1);
        if (next >= 0 && first > next) missing += static_cast<std::uint64_t>(first - next);
        if (next >= 0 && first < next) repeated += static_cast<std::uint64_t>(next - first);
        next = last + 1;
      }
    }
    std::vector<std::pair<std::int64_t, std::int64_t>> intervals;
    std::uint64_t samples = 0, missing = 0, repeated = 0;
  };

  /// After the whole run was read.
  void finish() {
    frame_sequence.count();
    pressure_sequence.count();
  }
  void print() const {
    position.print("position", "mm");
    force.print("force", "N");
    pressure_psi.print("pressure", "psi");
    mean_position.print("means", "mm");
    std::printf(
        "  stamps   worst bound %.0f us; seen from a ramp at 10 mm/s (position noise included) %.1f us rms over %zu "
        "samples\n",
        worst_bound_us, position.stamp_rms_us(), position.stamps);
    std::printf("  counters frame %llu samples, %llu missing, %llu repeated; pressure %llu, %llu, %llu\n",
                static_cast<unsigned long long>(frame_sequence.samples),
                static_cast<unsigned long long>(frame_sequence.missing),
                static_cast<unsigned long long>(frame_sequence.repeated),
                static_cast<unsigned long long>(pressure_sequence.samples),
                static_cast<unsigned long long>(pressure_sequence.missing),
                static_cast<unsigned long long>(pressure_sequence.repeated));
  }

  Comparison position, force, pressure_psi, mean_position;
  Sequence frame_sequence, pressure_sequence;
  double worst_bound_us = 0.0;
  std::int64_t last_mono_ns = 0;

 private:
  const Truth& truth_;
};

}  // namespace isorig::system_test
