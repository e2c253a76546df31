#include "identify/diagnosis_report/simulated_force.hpp"

#include <algorithm>
#include <cmath>

#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

std::vector<double> difference(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> out(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) out[i] = a[i] - b[i];
  return out;
}

std::vector<double> force_of(const model::ModelSpec& spec, const Series& series) {
  model::RunningModel running(spec, series.excitation.reference);
  const auto& instants = series.excitation.instants;
  std::vector<double> out;
  out.reserve(instants.size());
  running.reset(instants.front());
  for (const auto& instant : instants) out.push_back(running.step(instant));
  return out;
}

/// The number of that name, of parameters and coefficients; null when the part has none.
double* number_of(model::Part& part, const std::string& name) {
  for (std::size_t i = 0; i < part.law->parameters.size(); ++i)
    if (part.law->parameters[i].name == name) return &part.parameters[i];
  for (std::size_t i = 0; i < part.law->coefficients.size(); ++i)
    if (part.law->coefficients[i].name == name) return &part.coefficients[i];
  return nullptr;
}

/// The part of that number, counted from `first` on over parts of the same physics; null when there are fewer.
model::Part* part_of(model::ModelSpec& spec, std::size_t first, int number) {
  const model::Physics* physics = spec.parts[first].physics;
  for (std::size_t i = first; i < spec.parts.size(); ++i)
    if (spec.parts[i].physics == physics && --number == 0) return &spec.parts[i];
  return nullptr;
}

bool may_be(const model::Part& part, const std::string& name, double value) {
  if (!std::isfinite(value)) return false;
  for (const auto& p : part.law->parameters)
    if (p.name == name) return !p.traits.event_time && !p.fixed && value >= p.lower && value <= p.upper;
  return true;
}

}  // namespace

std::vector<double> SimulatedForce::nominal_residual_N() const {
  return difference(force_N, nominal_N);
}
std::vector<double> SimulatedForce::model_residual_N() const {
  return difference(force_N, model_N);
}

SimulatedForce SimulatedForce::between(double from_s, double to_s) const {
  SimulatedForce out;
  for (std::size_t i = 0; i < t_s.size(); ++i) {
    if (t_s[i] < from_s || t_s[i] > to_s) continue;
    out.t_s.push_back(t_s[i]);
    out.position_mm.push_back(position_mm[i]);
    out.velocity_mm_s.push_back(velocity_mm_s[i]);
    out.force_N.push_back(force_N[i]);
    out.nominal_N.push_back(nominal_N[i]);
    out.model_N.push_back(model_N[i]);
  }
  return out;
}

SimulatedForce simulate(const Series& series, const std::vector<bool>& usable, const Diagnosis& d) {
  const auto nominal = force_of(d.nominal, series), model = force_of(d.model, series);
  SimulatedForce out;
  for (std::size_t k = 0; k < nominal.size(); ++k) {
    if (!usable.empty() && !usable[k]) continue;
    const auto& instant = series.excitation.instants[k];
    out.t_s.push_back(instant.t_s);
    out.position_mm.push_back(instant.position_mm);
    out.velocity_mm_s.push_back(instant.velocity_mm_s);
    out.force_N.push_back(series.recording.frame.force_N[k]);
    out.nominal_N.push_back(nominal[k]);
    out.model_N.push_back(d.model.seen ? predicted_N(*d.model.seen, nominal[k], model[k]) : model[k]);
  }
  return out;
}

Stretch stretch_to_show(const Study& study, const std::vector<SimulatedForce>& all) {
  for (const Place& place : study.diagnosis.where) {
    if (place.recording.empty()) continue;
    const auto at = std::ranges::find(study.series, place.recording, &Series::name);
    if (at == study.series.end()) continue;
    return {static_cast<std::size_t>(at - study.series.begin()), place.t_start_s, place.t_end_s};
  }
  Stretch out;
  double fastest = -1.0;
  for (std::size_t s = 0; s < all.size(); ++s)
    for (std::size_t i = 0; i < all[s].t_s.size(); ++i) {
      if (std::abs(all[s].velocity_mm_s[i]) <= fastest) continue;
      fastest = std::abs(all[s].velocity_mm_s[i]);
      out = {s, all[s].t_s[i] - 4.0, all[s].t_s[i] + 12.0};
    }
  return out;
}

Contribution contribution(const Series& series, const Diagnosis& d, std::size_t part,
                          const std::vector<NamedValue>& numbers) {
  const auto without = [&](const model::ModelSpec& whole) {
    if (whole.parts[part].law->traits.replaces_arm) return force_of(d.nominal, series);
    model::ModelSpec rest = whole;
    const model::Physics* physics = whole.parts[part].physics;
    if (model::is_effect(*physics))  // all of its parts
      std::erase_if(rest.parts, [&](const model::Part& each) { return each.physics == physics; });
    else
      rest.parts.erase(rest.parts.begin() + static_cast<std::ptrdiff_t>(part));
    return force_of(rest, series);
  };
  const auto base = without(d.model);
  Contribution out;
  out.force_N = difference(force_of(d.model, series), base);
  std::vector<double> squares(base.size(), 0.0);
  for (const NamedValue& number : numbers) {
    std::vector<double> most(base.size(), 0.0);
    for (const double end : {number.low, number.high}) {
      model::ModelSpec other = d.model;
      model::Part* of = part_of(other, part, number.part);
      double* value = of == nullptr ? nullptr : number_of(*of, number.name);
      if (value == nullptr || !may_be(*of, number.name, end)) continue;
      *value = end;
      const auto moved = difference(force_of(other, series), base);
      for (std::size_t k = 0; k < most.size(); ++k) most[k] = std::max(most[k], std::abs(moved[k] - out.force_N[k]));
    }
    for (std::size_t k = 0; k < most.size(); ++k) squares[k] += most[k] * most[k];
  }
  for (std::size_t k = 0; k < base.size(); ++k) {
    out.t_s.push_back(series.excitation.instants[k].t_s);
    out.position_mm.push_back(series.excitation.instants[k].position_mm);
    out.half_band_N.push_back(std::sqrt(squares[k]));
  }
  return out;
}

report::Series path(const std::vector<double>& t_s, const std::vector<double>& x, const std::vector<double>& y,
                    const std::string& label, int color, std::size_t stretches) {
  report::Series out;
  out.label = label;
  out.color = color;
  out.width = 1.2;
  if (t_s.empty()) return out;
  const double from = t_s.front(), width = (t_s.back() - from) / static_cast<double>(stretches);
  double sum_x = 0.0, sum_y = 0.0, count = 0.0;
  std::size_t at = 0;
  const auto close = [&] {
    if (count == 0.0) return;
    out.x.push_back(sum_x / count);
    out.y.push_back(sum_y / count);
    sum_x = sum_y = count = 0.0;
  };
  for (std::size_t i = 0; i < t_s.size(); ++i) {
    const std::size_t now = width > 0.0 ? static_cast<std::size_t>((t_s[i] - from) / width) : 0;
    if (now != at) close();
    at = now;
    sum_x += x[i];
    sum_y += y[i];
    count += 1.0;
  }
  close();
  return out;
}

}  // namespace isorig::identify
