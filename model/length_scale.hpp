#pragma once
#include "model/composed.hpp"

namespace isorig::model {

/// Ranges and starts of the catalogue are those of a specimen that is moved by some 8 mm. Of another the lengths among
/// them are this many times as long: a power of ten, so that all specimens of one order share their ranges, and
/// model.toml says which (`length_scale`). 1 for a stroke of 0.
[[nodiscard]] double length_scale_of_stroke(double stroke_mm);

/// The law with the ranges and starts of its lengths (mm), velocities (mm/s) and strain exponents (1/mm) times
/// `length_scale`, or its inverse. Made once for each scale, and kept: parts point to it. Safe from any thread.
[[nodiscard]] const Law& law_at(const Law& law, double length_scale);

/// The same for every part of a model. Its numbers stay as they are.
void set_length_scale(ModelSpec& spec, double length_scale);

/// The same where every number of the model lies within its range then. Else the scale that the model had stays: a
/// model that is given may hold numbers of another specimen, and has to be readable when it is written again.
void set_length_scale_if_in_range(ModelSpec& spec, double length_scale);

}  // namespace isorig::model
