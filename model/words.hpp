#pragma once
#include <string>
#include <string_view>

namespace isorig::model {

/// What people call a physics of the catalogue (PhysicsTraits::words): "dry friction" for coulomb_friction. Without
/// such words, and for any other name, the name with spaces in place of its underscores.
[[nodiscard]] std::string effect_words(std::string_view name);

/// The same for a set as explanations name it (Hypothesis::key()): "dry friction and slack"; "nothing missing" for the
/// nominal model itself.
[[nodiscard]] std::string explanation_words(std::string_view key);

}  // namespace isorig::model
