#pragma once
#include <span>
#include <vector>

#include "identify/diagnose/fit/intervals.hpp"
#include "identify/diagnose/fit/series.hpp"
#include "identify/diagnose/guard/guard.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

/// Gives a nominal model that has a tare a `force_zero` for each recording but the longest: a load cell is zeroed anew
/// in every session, and a difference of two tares is no physics of the specimen. Recordings at different pressures
/// share their zero, as an actuator's force grows with its pressure and a free zero would take that up. Of equally long
/// ones the least recording_id stays without a zero, so that the order of the recordings does not matter.
void give_each_its_zero(std::span<const Series> series, model::ModelSpec& nominal);

/// A data fault of kind `tare` for each zero of `model` that differs by more than a reading's noise and by more than
/// its own 95 % interval. `numbers` are those of intervals() for the model.
[[nodiscard]] std::vector<DataFault> different_zeros(std::span<const Series> series, const model::ModelSpec& model,
                                                     const std::vector<std::vector<NamedValue>>& numbers,
                                                     double noise_N);

}  // namespace isorig::identify
