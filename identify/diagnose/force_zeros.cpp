#include "identify/diagnose/force_zeros.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

#include "base/formatted.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "model/elements.hpp"

namespace isorig::identify {
namespace {

bool has_zero(const model::ModelSpec& spec, double recording_id) {
  return std::ranges::any_of(spec.parts, [&](const model::Part& part) {
    return part.physics == &model::element::force_zero() && part.parameters[0] == recording_id;
  });
}

/// As measured, where it was: what a recording calls its nominal pressure may be what the force is counted from.
double pressure_psi(const Series& series) {
  const std::vector<double>& read = series.excitation.pressure_psi;
  if (read.empty()) return series.excitation.reference.nominal_pressure_psi;
  return std::accumulate(read.begin(), read.end(), 0.0) / static_cast<double>(read.size());
}

bool at_one_pressure(const Series& a, const Series& b) {
  const double psi_a = pressure_psi(a), psi_b = pressure_psi(b);
  return std::fabs(psi_a - psi_b) <= deciding().one_pressure_share * std::max(std::fabs(psi_a), std::fabs(psi_b));
}

bool is_longer(const Series& a, const Series& b) {
  const model::Reference &of_a = a.excitation.reference, &of_b = b.excitation.reference;
  return of_a.duration_s != of_b.duration_s ? of_a.duration_s > of_b.duration_s : of_a.recording_id < of_b.recording_id;
}

}  // namespace

void give_each_its_zero(std::span<const Series> series, model::ModelSpec& nominal) {
  if (!nominal.has("constant")) return;
  const model::Physics& physics = model::element::force_zero();
  for (const Series& each : series) {
    const double id = each.excitation.reference.recording_id;
    const bool refers_to_another = std::ranges::any_of(
        series, [&](const Series& other) { return is_longer(other, each) && at_one_pressure(other, each); });
    if (!refers_to_another || has_zero(nominal, id)) continue;
    model::Part part = model::make_part(physics, physics.laws[0]);
    part.parameters[0] = id;
    nominal.parts.push_back(std::move(part));
  }
}

std::vector<DataFault> different_zeros(std::span<const Series> series, const model::ModelSpec& model,
                                       const std::vector<std::vector<NamedValue>>& numbers, double noise_N) {
  std::vector<DataFault> out;
  for (std::size_t p = 0; p < model.parts.size(); ++p) {
    if (model.parts[p].physics != &model::element::force_zero()) continue;
    const auto of = std::ranges::find(series, model.parts[p].parameters[0],
                                      [](const Series& s) { return s.excitation.reference.recording_id; });
    const NamedValue& zero = numbers[p][0];
    const double error_N = 0.5 * (zero.high - zero.low);
    if (of == series.end() || std::fabs(zero.value) <= std::max(noise_N, error_N)) continue;
    const auto& t_s = of->recording.frame.t_s;
    out.push_back(
        {"tare", t_s.front(), t_s.back(), t_s.size(),
         base::formatted("%s: the force's zero is %.3g N (+- %.1g N) %s that of the longest recording; taken off",
                         of->name.c_str(), std::fabs(zero.value), error_N, zero.value > 0.0 ? "above" : "below")});
  }
  return out;
}

}  // namespace isorig::identify
