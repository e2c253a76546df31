#pragma once
#include <optional>

#include "identify/diagnose/search/hypothesis.hpp"

namespace isorig::identify {

/// The residual of `base` as a table of the single variable that predicts it best on stretches of the recording that
/// the table was not fitted to (blocks left out in turn); its smoothness is chosen by the same measure. A table of
/// position is also tried as an error of the position itself, which a viscous specimen tells from a force. Refitted
/// jointly with the model. Empty when no variable predicts anything.
[[nodiscard]] std::optional<Hypothesis> describe_unknown(const Search& search, const Hypothesis& base);

[[nodiscard]] bool has_table(const model::ModelSpec& spec);

/// The model's table learnt anew, of the same variable, beside the model's own numbers; the old table is not looked at.
[[nodiscard]] model::ModelSpec learn_table_again(const Problem& problem, model::ModelSpec spec);

/// A table of what passed in one recording (model/one_recording.hpp): any other one is predicted without it.
[[nodiscard]] bool tabulates_one_recording(const model::ModelSpec& spec);

/// `base` as it is, with the table of the variable of `like` (a part that holds one) of what it leaves.
[[nodiscard]] model::ModelSpec with_table_like(const Problem& problem, model::ModelSpec base, const model::Part& like);

}  // namespace isorig::identify
