#pragma once
#include "identify/diagnose/study.hpp"

namespace isorig::identify {

/// Equivalences, limits of what was shown, fits that stopped short, and what the model is without; a warning when
/// the recordings are of several specimens.
void add_notes(const Study& study, const Fit& nominal_fit, Diagnosis& out);

}  // namespace isorig::identify
