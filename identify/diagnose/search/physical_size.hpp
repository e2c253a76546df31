#pragma once
#include <span>

#include "identify/diagnose/fit/series.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

/// A law is larger than the recordings allow, and describes other physics by an enormous number:
/// - One that follows the pressure: were the pressure to rise by as much as the nominal pressure is above the
/// atmosphere,
///   the law would add more than `pressure_force_ratio` times the largest force that was read, at one of the ends of
///   the travel or as the difference between them. A pressure that hardly moves leaves it free to.
/// - A drift of the force channel that changes over a recording by more than `drift_force_ratio` times that force: a
///   relaxation of the specimen, as large and the other way, then hides it.
///
/// Of recordings at several pressures the largest nominal pressure counts, and the largest force of all. False where
/// either is not known or zero.
[[nodiscard]] bool beyond_physical_size(const model::ModelSpec& spec, std::span<const Series> series);

}  // namespace isorig::identify
