#include "identify/diagnose/explain/passivity.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/moves.hpp"

namespace isorig::identify {
namespace {

/// The parts whose work is the specimen's and the rig's.
model::ModelSpec mechanical(const model::ModelSpec& spec) {
  model::ModelSpec out = spec;
  std::erase_if(out.parts, [](const model::Part& part) {
    const model::Stage stage = model::stage_of(part);
    const bool acts =
        stage == model::Stage::kSpecimen || stage == model::Stage::kSpecimenShape || stage == model::Stage::kRig;
    return !acts || part.law->traits.counts != model::Counts::kNothing;
  });
  return out;
}

struct Work {
  double last_N_mm = 0.0;    ///< taken in over the last turn
  double passed_N_mm = 0.0;  ///< to and fro, in one turn
  double path_mm = 0.0;      ///< in one turn
};

Work work_of(const model::ModelSpec& spec, const model::Reference& reference, double centre_mm, double amplitude_mm,
             double fastest_mm_s) {
  constexpr int kSteps = 400, kTurns = 6;
  const double omega_1_s = fastest_mm_s / amplitude_mm, dt_s = 2.0 * std::numbers::pi / omega_1_s / kSteps;
  model::RunningModel running(spec, reference);
  Work out;
  model::Instant before;
  double force_before_N = 0.0;
  for (int k = 0; k <= kTurns * kSteps; ++k) {
    const double phase = 2.0 * std::numbers::pi * (k % kSteps) / kSteps;
    model::Instant now;
    now.t_s = k * dt_s;
    now.dt_s = k > 0 ? dt_s : 0.0;
    now.position_mm = centre_mm - amplitude_mm * std::cos(phase);
    now.elongation_mm = now.position_mm + reference.elongation_at_zero_mm;
    now.step_mm = k > 0 ? now.position_mm - before.position_mm : 0.0;
    now.velocity_mm_s = fastest_mm_s * std::sin(phase);
    now.acceleration_mm_s2 = fastest_mm_s * omega_1_s * std::cos(phase);
    if (k == 0) running.reset(now);
    const double force_N = running.step(now);
    const double piece_N_mm = 0.5 * (force_N + force_before_N) * now.step_mm;
    if (k > (kTurns - 1) * kSteps) {
      out.last_N_mm += piece_N_mm;
      out.passed_N_mm += std::fabs(piece_N_mm);
      out.path_mm += std::fabs(now.step_mm);
    }
    before = now;
    force_before_N = force_N;
  }
  return out;
}

}  // namespace

std::optional<ActiveLoop> active_loop(const model::ModelSpec& spec, std::span<const Series> series, double noise_N) {
  constexpr double kRounding = 1e-3;
  double low_mm = 1e300, high_mm = -1e300, fastest_mm_s = 0.0, most_still_mm = 0.0;
  for (const Series& each : series) {
    most_still_mm = std::max(most_still_mm, still_mm(each));
    for (const auto& node : each.nodes) {
      low_mm = std::min(low_mm, node.position_mm);
      high_mm = std::max(high_mm, node.position_mm);
      if (node.dt_s > 0.0) fastest_mm_s = std::max(fastest_mm_s, std::fabs(node.step_mm) / node.dt_s);
    }
  }
  const double range_mm = high_mm - low_mm;
  if (!(range_mm > most_still_mm) || fastest_mm_s <= 0.0) return std::nullopt;
  model::Reference reference = series[0].excitation.reference;
  reference.recording_id = model::kPlannedRecordingId;
  const model::ModelSpec parts = mechanical(spec);
  for (int halvings = 0; halvings <= 2; ++halvings) {
    const double amplitude_mm = 0.5 * range_mm / (1 << halvings);
    const int places = (2 << halvings) - 1;  // overlapping by half
    for (int place = 0; place < places; ++place) {
      const double centre_mm = low_mm + amplitude_mm * (1 + place);
      for (const double slower : {1.0, 0.1, 0.01}) {
        const Work work = work_of(parts, reference, centre_mm, amplitude_mm, slower * fastest_mm_s);
        const double allowed_N_mm =
            deciding().active_loop_noises * noise_N * work.path_mm + kRounding * work.passed_N_mm;
        if (work.last_N_mm < -allowed_N_mm)
          return ActiveLoop{centre_mm, amplitude_mm, slower * fastest_mm_s, work.last_N_mm};
      }
    }
  }
  return std::nullopt;
}

}  // namespace isorig::identify
