#include "identify/diagnose/search/resolution.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {

InstrumentResolution resolution_of(std::span<const Series> series) {
  InstrumentResolution out{0.0, std::numeric_limits<double>::infinity(), {}};
  for (const Series& each : series) {
    const Motion& motion = each.excitation.motion;
    out.position_mm = std::max({out.position_mm, motion.noise_mm, motion.quantisation_mm});
    std::vector<double> steps_s;
    for (const auto& now : each.excitation.instants)
      if (now.dt_s > 0.0) steps_s.push_back(now.dt_s);
    if (!steps_s.empty()) out.interval_s = std::min(out.interval_s, base::quantile(std::move(steps_s), 0.1));
  }
  if (!std::isfinite(out.interval_s)) out.interval_s = 0.0;
  for (const Series& each : series)
    if (!each.nodes.empty()) out.first_s[each.excitation.reference.recording_id] = each.nodes.front().t_s;
  return out;
}

namespace {

/// The effect that a law is at the bound where this number stands; "" anywhere else.
std::string_view name_at_bound(const model::Parameter& parameter, double value) {
  const model::ParameterTraits& traits = parameter.traits;
  if (!traits.lower_bound_is.empty() && value <= deciding().at_lower_bound_ratio * parameter.lower)
    return traits.lower_bound_is;
  if (!traits.upper_bound_is.empty() && value >= deciding().at_upper_bound_ratio * parameter.upper)
    return traits.upper_bound_is;
  return {};
}

/// A time that an event's law has besides the event's own.
bool is_duration_of_event(const model::Law& law, const model::Parameter& parameter) {
  return model::is_event(law) && !parameter.traits.event_time && parameter.sheet.unit == "s";
}

/// Time from the first reading of an event's recording to the event.
double shown_before(const model::Part& event, const InstrumentResolution& resolution) {
  for (std::size_t i = 0; i < event.parameters.size(); ++i) {
    if (event.law->parameters[i].traits.filled_by != model::FilledBy::kRecordingId) continue;
    if (const auto first = resolution.first_s.find(event.parameters[i]); first != resolution.first_s.end())
      return event.parameters[model::event_parameter(*event.law)] - first->second;
  }
  return std::numeric_limits<double>::infinity();
}

}  // namespace

const model::Physics& effect_at_bound(const model::ModelSpec& spec, const model::Physics& effect) {
  for (const model::Part& part : spec.parts) {
    if (part.physics != &effect) continue;
    for (std::size_t i = 0; i < part.parameters.size(); ++i)
      if (const auto name = name_at_bound(part.law->parameters[i], part.parameters[i]); !name.empty())
        return *model::find_physics(name);
  }
  return effect;
}

bool below_resolution(const model::ModelSpec& spec, const InstrumentResolution& resolution) {
  for (const model::Part& part : spec.parts) {
    for (std::size_t i = 0; i < part.parameters.size(); ++i) {
      const model::Parameter& parameter = part.law->parameters[i];
      const model::ParameterTraits& traits = parameter.traits;
      const double value = part.parameters[i];
      double least = 0.0;
      switch (traits.resolution) {
        case model::Resolution::kNone:
          break;
        case model::Resolution::kPositionNoise:
          least = traits.resolution_factor * resolution.position_mm;
          break;
        case model::Resolution::kSampleInterval:
          least = traits.resolution_factor * resolution.interval_s;
          break;
      }
      if (traits.resolution != model::Resolution::kNone && value < least) return true;
      if (!name_at_bound(parameter, value).empty()) return true;
      if (is_duration_of_event(*part.law, parameter) && value > shown_before(part, resolution)) return true;
    }
  }
  return false;
}

bool at_wrong_bound(const model::Parameter& parameter, double value) {
  if (parameter.traits.event_time || parameter.traits.initial_state ||
      parameter.traits.filled_by != model::FilledBy::kNothing)
    return false;
  const double low = to_search(parameter, parameter.lower), high = to_search(parameter, parameter.upper);
  const double share = (to_search(parameter, value) - low) / (high - low);
  const bool zero = !parameter.logarithmic && parameter.lower == 0.0;
  if (share < deciding().at_bound_share) return parameter.traits.lower_limit_law.empty() && !zero;
  return share > 1.0 - deciding().at_bound_share && parameter.traits.upper_limit_law.empty();
}

bool at_wrong_bound(const model::Part& part) {
  for (std::size_t i = 0; i < part.parameters.size(); ++i)
    if (at_wrong_bound(part.law->parameters[i], part.parameters[i])) return true;
  return false;
}

}  // namespace isorig::identify
