#pragma once
#include <string>
#include <vector>

#include "cli/campaign/ask.hpp"

/// Controls of sheaths in `isorig campaign --ask fv --model slse2 --control FV.json`: each piece is one recording and,
/// where that is of a sheath, the path of the analysis that its control's fit is in.
namespace isorig::cli::pieces {

/// Specimens that the file of Ask::control has a fit of; none where nothing is asked of one. Throws std::runtime_error.
[[nodiscard]] std::vector<std::string> controls_of(const Ask& ask);

/// Words of the model for a recording of this specimen. A specimen that the file has a fit of, or that is named as the
/// paper names controls (Control1), is fitted by itself. For any other they name its control: Control1 of Ecoflex1,
/// else the only specimen in the file where that one has a name of another kind. Throws std::runtime_error, which says
/// that there is none.
[[nodiscard]] std::vector<std::string> model_words(const Ask& ask, const std::vector<std::string>& controls,
                                                   const std::string& specimen);

}  // namespace isorig::cli::pieces
