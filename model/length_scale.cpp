#include "model/length_scale.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <utility>

#include "model/catalogue.hpp"

namespace isorig::model {
namespace {

/// What the number is multiplied by when lengths are; by the unit in its name.
double factor_of(const Parameter& parameter, double length_scale) {
  if (parameter.traits.starts_are_shares_of_travel) return 1.0;
  if (parameter.name.ends_with("_1_mm")) return 1.0 / length_scale;
  if (parameter.name.ends_with("_mm") || parameter.name.ends_with("_mm_s")) return length_scale;
  return 1.0;
}

}  // namespace

double length_scale_of_stroke(double stroke_mm) {
  constexpr double kPapers_mm = 8.0;
  if (!(stroke_mm > 0.0) || !std::isfinite(stroke_mm)) return 1.0;
  return std::pow(10.0, std::round(std::log10(stroke_mm / kPapers_mm)));
}

const Law& law_at(const Law& law, double length_scale) {
  const bool has_length = std::ranges::any_of(
      law.parameters, [&](const Parameter& parameter) { return factor_of(parameter, length_scale) != 1.0; });
  if (!has_length) return law;
  static std::mutex mutex;
  static std::map<std::pair<const Law*, double>, Law> made;  // its entries do not move
  const std::scoped_lock lock(mutex);
  const auto [at, is_new] = made.try_emplace({&law, length_scale}, law);
  if (is_new) {
    for (Parameter& parameter : at->second.parameters) {
      const double factor = factor_of(parameter, length_scale);
      parameter.lower *= factor;
      parameter.upper *= factor;
      for (double& start : parameter.starts) start *= factor;
    }
  }
  return at->second;
}

void set_length_scale(ModelSpec& spec, double length_scale) {
  const auto scale = [length_scale](Part& part) {
    if (const Law* law = find_law(*part.physics, part.law->name)) part.law = &law_at(*law, length_scale);
  };
  spec.length_scale = length_scale;
  std::ranges::for_each(spec.parts, scale);
  if (spec.seen) std::ranges::for_each(spec.seen->nominal, scale);
}

void set_length_scale_if_in_range(ModelSpec& spec, double length_scale) {
  const double before = spec.length_scale;
  set_length_scale(spec, length_scale);
  const bool in_range = std::ranges::all_of(spec.parts, [](const Part& part) {
    for (std::size_t i = 0; i < part.parameters.size(); ++i) {
      const Parameter& parameter = part.law->parameters[i];
      if (part.parameters[i] < parameter.lower || part.parameters[i] > parameter.upper) return false;
    }
    return true;
  });
  if (!in_range) set_length_scale(spec, before);
}

}  // namespace isorig::model
