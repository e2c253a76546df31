#include "identify/diagnose/fit/free_parameters.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::identify {

using model::ModelSpec;
using model::Parameter;
using model::Part;

std::vector<FreeNumber> free_parameters(const ModelSpec& spec) {
  std::vector<FreeNumber> out;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    const Part& part = spec.parts[p];
    if (part.fixed) continue;
    for (std::size_t i = 0; i < part.law->parameters.size(); ++i) {
      const Parameter& parameter = part.law->parameters[i];
      if (!parameter.fixed && !parameter.traits.event_time) out.push_back({p, i, false});
    }
  }
  return out;
}

std::vector<FreeNumber> free_coefficients(const ModelSpec& spec) {
  std::vector<FreeNumber> out;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    if (spec.parts[p].fixed) continue;
    for (std::size_t i = 0; i < spec.parts[p].coefficients.size(); ++i) out.push_back({p, i, true});
  }
  return out;
}

std::size_t counted_numbers(const ModelSpec& spec) {
  std::size_t count = 0;
  for (const Part& part : spec.parts) {
    if (part.fixed) continue;
    const auto used = static_cast<std::size_t>(
        std::ranges::count_if(part.coefficients, [](double coefficient) { return coefficient != 0.0; }));
    if (used == 0 && !part.coefficients.empty()) continue;
    count += used;
    for (const Parameter& parameter : part.law->parameters)
      if (!parameter.fixed) count += parameter.traits.event_time ? 2 : 1;
  }
  return count;
}

double& value_of(ModelSpec& spec, const FreeNumber& number) {
  Part& part = spec.parts[number.part];
  return (number.coefficient ? part.coefficients : part.parameters)[number.index];
}

double value_of(const ModelSpec& spec, const FreeNumber& number) {
  const Part& part = spec.parts[number.part];
  return (number.coefficient ? part.coefficients : part.parameters)[number.index];
}

const Parameter& parameter_of(const ModelSpec& spec, const FreeNumber& number) {
  return spec.parts[number.part].law->parameters[number.index];
}

double difference_step(const ModelSpec& spec, const FreeNumber& number) {
  constexpr double kNearZero = 1e-2;
  const double value = value_of(spec, number);
  if (number.coefficient) return kDifferenceStep * std::max(std::fabs(value), kNearZero);
  const Parameter& parameter = parameter_of(spec, number);
  const double size =
      parameter.logarithmic ? std::fabs(value) : std::max(std::fabs(value), kNearZero * search_scale(parameter));
  const double step = kDifferenceStep * size;
  return value + step > parameter.upper ? -step : step;
}

Eigen::MatrixXd differences(const ModelSpec& spec, const std::vector<FreeNumber>& numbers, const Eigen::VectorXd& at,
                            const std::function<Eigen::VectorXd(const ModelSpec&)>& value) {
  Eigen::MatrixXd out(at.size(), static_cast<Eigen::Index>(numbers.size()));
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    ModelSpec moved = spec;
    value_of(moved, numbers[i]) += difference_step(spec, numbers[i]);
    out.col(static_cast<Eigen::Index>(i)) = value(moved) - at;
  }
  return out;
}

double to_search(const Parameter& parameter, double value) {
  constexpr double kLeast = 1e-300;
  return parameter.logarithmic ? std::log(std::max(value, kLeast)) : value;
}

double from_search(const Parameter& parameter, double coordinate) {
  const double value = parameter.logarithmic ? std::exp(coordinate) : coordinate;
  return std::clamp(value, parameter.lower, parameter.upper);
}

double search_scale(const Parameter& parameter) {
  return parameter.logarithmic ? 1.0 : std::min(parameter.upper - parameter.lower, 1.0);
}

bool at_bound(const Parameter& parameter, double value) {
  constexpr double kRounding = 1e-9;
  return value <= parameter.lower + kRounding * std::fabs(parameter.lower) + 1e-12 ||
         value >= parameter.upper - kRounding * std::fabs(parameter.upper);
}

}  // namespace isorig::identify
