#pragma once
#include <string>
#include <string_view>

#include "model/process.hpp"

namespace isorig::model {

/// What people call a physics of the catalogue (PhysicsTraits::words): "dry friction" for coulomb_friction. Without
/// such words, and for any other name, the name with spaces in place of its underscores.
[[nodiscard]] std::string effect_words(std::string_view name);

/// The same for a set as explanations name it (Hypothesis::key()): "dry friction and slack"; "nothing missing" for the
/// nominal model itself.
[[nodiscard]] std::string explanation_words(std::string_view key);

/// "presliding" of presliding_mm with the unit "mm", "sliding 2" of sliding_N_2 with "N": the name of a number without
/// its unit, which stands beside the value, and with spaces. `unit` as a sheet has it ("N/mm2").
[[nodiscard]] std::string number_words(std::string_view key, std::string_view unit);

/// The unit of a law's number as its sheet has it ("1" of a ratio); "" when the law has none of that name. The number
/// of a part that has several ("slip_mm_2") counts as the name without it.
[[nodiscard]] std::string_view unit_of(const Law& law, std::string_view number);

/// The unit of a number for people: "N/mm²" of "N/mm2"; "" of a ratio.
[[nodiscard]] std::string unit_words(std::string_view unit);

/// A sentence in which names of the catalogue stand as the files have them, with what people call them instead:
/// "force_N of coulomb_friction" becomes "force of dry friction". Names without an underscore stay: they are words.
[[nodiscard]] std::string in_words(std::string_view text);

}  // namespace isorig::model
