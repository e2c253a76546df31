#pragma once
#include <span>

#include "identify/diagnose/fit/series.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

/// A law that follows the pressure is larger than the recordings allow: were the pressure to rise by as much as the
/// nominal pressure is above the atmosphere, the law would add a force of more than `pressure_force_ratio` times the
/// largest force that was read, at one of the ends of the travel or as the difference between them. A pressure that
/// hardly moves leaves such a law free to describe other physics by an enormous number.
///
/// Of recordings at several pressures the largest nominal pressure counts, and the largest force of all. False where
/// either is not known or zero.
[[nodiscard]] bool beyond_physical_size(const model::ModelSpec& spec, std::span<const Series> series);

}  // namespace isorig::identify
