#pragma once
#include <span>

#include "identify/diagnose/fit/series.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

/// One of the effects that a search has added is larger than the recordings allow, and describes other physics by an
/// enormous number. Numbers of the given model are the user's, and are not judged.
///
/// What follows the pressure: were it to rise by the nominal pressure, the law would add more than
/// `pressure_force_ratio` times the largest force that was read, at an end of the travel or as the difference between
/// the ends. A pressure that hardly moves leaves the law free to.
///
/// What drifts in the force channel changes over a recording by more than `drift_force_ratio` times that force. A
/// relaxation of the specimen, as large and the other way, hides it.
///
/// Of several recordings the largest nominal pressure counts, and the largest force of all. False where either is not
/// known or zero.
[[nodiscard]] bool beyond_physical_size(const model::ModelSpec& spec, std::span<const model::Physics* const> effects,
                                        std::span<const Series> series);

/// The same of a table of the pressure: over the pressures that were seen it changes by more than a pressure could. A
/// pressure that swings by some mpsi as the specimen's volume does is a second reading of the position, without its
/// noise, and a table of it describes what follows the position.
[[nodiscard]] bool beyond_physical_size(const model::Table& of_pressure, std::span<const Series> series);

}  // namespace isorig::identify
