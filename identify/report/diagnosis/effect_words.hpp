#pragma once
#include <string>
#include <string_view>

namespace isorig::identify {

/// What people call an effect of the catalogue: "dry friction" for coulomb_friction. Others come with spaces in place
/// of their underscores.
[[nodiscard]] std::string effect_words(std::string_view name);

/// The same for a set as explanations name it (Hypothesis::key()): "dry friction and slack"; "nothing missing" for the
/// nominal model itself.
[[nodiscard]] std::string explanation_words(std::string_view key);

}  // namespace isorig::identify
