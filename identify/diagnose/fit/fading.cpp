#include "identify/diagnose/fit/fading.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "base/formatted.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

using model::ModelSpec;

bool counts(const ModelSpec& spec, model::Counts what) {
  return std::ranges::any_of(spec.parts, [what](const model::Part& p) { return p.law->traits.counts == what; });
}

bool has_empirical(const ModelSpec& spec) {
  return std::ranges::any_of(spec.parts, [](const model::Part& p) { return model::is_empirical(*p.physics); });
}

}  // namespace

model::Seen ranges_of(std::span<const Series> series) {
  model::Seen seen;
  bool first = true, pressure = false;
  for (const Series& each : series) {
    const Excitation& excitation = each.excitation;
    double travelled_mm = 0.0;
    for (std::size_t bin = 0; bin < each.nodes.size(); ++bin) {
      for (std::size_t row = each.first_row[bin]; row < each.first_row[bin + 1]; ++row) {
        const model::Instant& now = excitation.instants[row];
        travelled_mm += std::fabs(now.step_mm);
        if (each.count[bin] == 0.0) continue;
        seen.travel_mm = std::max(seen.travel_mm, travelled_mm);
        seen.duration_s = std::max(seen.duration_s, now.t_s - excitation.instants.front().t_s);
        seen.lowest_mm = first ? now.position_mm : std::min(seen.lowest_mm, now.position_mm);
        seen.highest_mm = first ? now.position_mm : std::max(seen.highest_mm, now.position_mm);
        seen.fastest_mm_s = std::max(seen.fastest_mm_s, std::fabs(now.velocity_mm_s));
        first = false;
        if (excitation.pressure_psi.empty()) continue;
        const double psi = now.excess_pressure_psi + excitation.reference.nominal_pressure_psi;
        seen.lowest_psi = pressure ? std::min(seen.lowest_psi, psi) : psi;
        seen.highest_psi = pressure ? std::max(seen.highest_psi, psi) : psi;
        pressure = true;
      }
    }
  }
  return seen;
}

double Fading::Watched::distance(double value) {
  if (!used) return 0.0;
  least = std::min(least, value);
  most = std::max(most, value);
  const double beyond = std::max({low - tolerance - value, value - high - tolerance, 0.0});
  if (beyond == 0.0) return 0.0;
  ++rows;
  // A range of no width has that of its tolerance.
  return beyond / std::max({high - low, tolerance, 1e-300});
}

ReadingNoise noise_of(const Excitation& excitation) {
  return {excitation.motion.noise_mm, !excitation.pressure_psi.empty(), excitation.pressure_noise_psi};
}

Fading::Fading(const ModelSpec& spec, double nominal_pressure_psi, const ReadingNoise& noise)
    : watched_{}, share_(spec.seen->share), nominal_psi_(nominal_pressure_psi) {
  const double noises = deciding().outside_noises, sum = deciding().outside_sum_share;
  const model::Seen& seen = *spec.seen;
  const bool pressure = spec.reads_pressure() && noise.has_pressure;
  watched_ = {
      Watched{"the position", "mm", seen.lowest_mm, seen.highest_mm, noises * noise.position_mm, true},
      Watched{"the velocity", "mm/s", -seen.fastest_mm_s, seen.fastest_mm_s,
              deciding().outside_rate_share * seen.fastest_mm_s, true},
      Watched{"the pressure", "psi", seen.lowest_psi, seen.highest_psi, noises * noise.pressure_psi, pressure},
      Watched{"the travel", "mm", 0.0, seen.travel_mm, sum * seen.travel_mm, counts(spec, model::Counts::kTravel)},
      Watched{"the time since the start", "s", 0.0, seen.duration_s, sum * seen.duration_s,
              counts(spec, model::Counts::kTime)}};
  holds_ = has_empirical(spec) ? 0.0 : deciding().law_holds_ranges;
  gone_ = has_empirical(spec) ? deciding().table_gone_ranges : deciding().law_gone_ranges;
}

Fading::Belief Fading::next(const model::Instant& now) {
  if (rows_++ == 0) start_s_ = now.t_s;
  travelled_mm_ += std::fabs(now.step_mm);
  const double d = std::max({watched_[0].distance(now.position_mm), watched_[1].distance(now.velocity_mm_s),
                             watched_[2].distance(now.excess_pressure_psi + nominal_psi_),
                             watched_[3].distance(travelled_mm_), watched_[4].distance(now.t_s - start_s_)});
  // From `gone_` on only the nominal model predicts, and d is held there, so that its band stops growing. A range of no
  // width (constant pressure, no motion) would otherwise give a d in the hundreds.
  return {std::min(d, gone_), share_ * std::clamp((gone_ - d) / (gone_ - holds_), 0.0, 1.0)};
}

std::vector<std::string> Fading::notes() const {
  std::vector<std::string> out;
  for (const Watched& one : watched_) {
    if (one.rows == 0) continue;
    out.push_back(
        base::formatted("%s goes from %.4g to %.4g %s, and the model has seen %.4g to %.4g %s: %.3g %% of the rows are "
                        "outside; there what the model has beyond the nominal one fades, and the band widens",
                        one.name, one.least, one.most, one.unit, one.low, one.high, one.unit,
                        100.0 * static_cast<double>(one.rows) / static_cast<double>(rows_)));
  }
  return out;
}

std::vector<double> faded_force(const ModelSpec& spec, const Series& series) {
  model::RunningModel running(spec, series.excitation.reference);
  running.reset(series.nodes.front());
  std::vector<double> out;
  for (const model::Instant& now : series.nodes) out.push_back(running.step(now));
  if (!spec.seen) return out;
  model::RunningModel nominal(fades_to(spec), series.excitation.reference);
  nominal.reset(series.nodes.front());
  Fading fading(spec, series.excitation.reference.nominal_pressure_psi, noise_of(series.excitation));
  for (std::size_t k = 0; k < out.size(); ++k) {
    const double without_N = nominal.step(series.nodes[k]);
    out[k] = without_N + fading.next(series.nodes[k]).weight * (out[k] - without_N);
  }
  return out;
}

}  // namespace isorig::identify
