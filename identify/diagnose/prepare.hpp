#pragma once
#include <string>
#include <vector>

#include "identify/diagnose/study.hpp"

namespace isorig::identify {

/// The drive of a prediction, counted as the fit of `model` counts: travel, time and arms from where its session begins
/// (Excitation::begin_row), its pressure from the model's zero.
void count_as_fitted(Excitation& excitation, const messages::Recording& recording, const RecordingQuality& quality,
                     const model::ModelSpec& model);

/// Stage 1, guard, and 2 to 4: what drives the model, and the noise of what it answers. Recordings that begin with
/// their filling, or go on after a gap, add states of their arms to the nominal model. Throws std::invalid_argument for
/// a recording that no model can be judged by.
void prepare(Study& study, std::vector<messages::Recording> recordings, std::vector<std::string> names,
             model::ModelSpec& nominal);

}  // namespace isorig::identify
