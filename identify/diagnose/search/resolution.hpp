#pragma once
#include <map>
#include <span>

#include "identify/diagnose/fit/series.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

/// What the instruments of all recordings together can show.
struct InstrumentResolution {
  double position_mm = 0.0;          ///< noise or step of the position reading, whichever is more
  double interval_s = 0.0;           ///< a tenth of the readings follow each other faster than this
  std::map<double, double> first_s;  ///< of each recording, by its recording_id: its first reading
};
[[nodiscard]] InstrumentResolution resolution_of(std::span<const Series> series);

/// A part of the model is smaller than the instruments could show (ParameterTraits::resolution): such a play or slip
/// stands in for noise of the position reading, such a lag for jitter of the time stamps, whatever the likelihood
/// says. Or it stands at the bound where it is another effect (ParameterTraits::lower_bound_is and upper_bound_is;
/// within 1 % of an upper one). Or it is an event that goes on for longer than the recording shows before it: what
/// begins with the recording is a state of the start, or a drift. Of an event whose recording is not among these
/// nothing is asked.
[[nodiscard]] bool below_resolution(const model::ModelSpec& spec, const InstrumentResolution& resolution);

/// The effect named by ParameterTraits::lower_bound_is or upper_bound_is if a parameter of this effect's law is at that
/// bound in the model; otherwise `effect` itself.
[[nodiscard]] const model::Physics& effect_at_bound(const model::ModelSpec& spec, const model::Physics& effect);

/// Within a small share of the range, as it is searched. The bound may be the law's own limit, documented as such; and
/// zero of a number that is searched on a linear scale means that the law is the simpler one: neither is wrong. No
/// model is handed out with such a number (publish.hpp).
[[nodiscard]] bool at_wrong_bound(const model::Parameter& parameter, double value);
/// One of its numbers is.
[[nodiscard]] bool at_wrong_bound(const model::Part& part);

}  // namespace isorig::identify
