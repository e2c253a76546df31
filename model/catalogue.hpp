#pragma once
#include <span>
#include <string_view>

#include "model/process.hpp"

namespace isorig::model {

/// What a nominal model is composed of: springs, dashpots, Maxwell arms, masses ...
[[nodiscard]] std::span<const Physics* const> elements();

/// What a nominal model may lack. One file each in model/effects/.
[[nodiscard]] std::span<const Physics* const> effects();

/// In either list; null when there is none of that name.
[[nodiscard]] const Physics* find_physics(std::string_view name);
[[nodiscard]] const Law* find_law(const Physics& physics, std::string_view law);
[[nodiscard]] bool is_effect(const Physics& physics);
/// Has no name: tables, memories and products that were fitted to a recording.
[[nodiscard]] bool is_empirical(const Physics& physics);

}  // namespace isorig::model
