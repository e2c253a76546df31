#pragma once
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>

#include "identify/diagnose/deciding/deciding.hpp"

namespace isorig::identify {

/// For people: a line with name, value and unit, then what it decides and where it comes from.
[[nodiscard]] std::string deciding_table();
/// The same for programs: a list of objects.
[[nodiscard]] nlohmann::ordered_json deciding_json();
/// Name and value of what was decided otherwise, for diagnosis.json.
[[nodiscard]] nlohmann::ordered_json changed_json(std::span<const Decided> changed);

}  // namespace isorig::identify
