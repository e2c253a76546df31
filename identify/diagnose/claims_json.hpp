#pragma once
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "identify/diagnose/claims.hpp"

namespace isorig::identify {

inline constexpr std::string_view kNameCheckFormat = "isorig-name-check/1";

/// What diagnosis.json has of it, as `name_check`.
[[nodiscard]] nlohmann::ordered_json reliability_json(const Reliability& reliability);

/// name-check.json: rehearsals that need not be simulated again. `of` says what they belong to: recordings, model,
/// numbers that decide, program.
[[nodiscard]] nlohmann::ordered_json name_check_json(const std::vector<Rehearsal>& rehearsals, const std::string& of);

/// The rehearsals of a text that name_check_json() made for the same `of`; nothing of any other text.
[[nodiscard]] std::optional<std::vector<Rehearsal>> rehearsals_of(const std::string& text, const std::string& of);

}  // namespace isorig::identify
