#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "cli/campaign/plan.hpp"

/// What the tables of a campaign have of one recording.
namespace isorig::cli::pieces {

/// Exit code of a command that cannot read its recording.
inline constexpr int kBadRecording = 3;

/// {"specimen", "pressure_psi", "repetition"} as far as recording.toml says them; null what it does not say.
[[nodiscard]] nlohmann::ordered_json subject_of(const Ask& ask, const std::string& recording);

/// What came out, from the files that the command left in `made`: subject, verdict, missing physics, page; of
/// `isorig fv` also "fit": the curve with its fit as fv.json has them. Throws where they are no whole answer.
[[nodiscard]] nlohmann::ordered_json row_of_answer(const Ask& ask, const std::filesystem::path& made,
                                                   const std::string& recording, int exit_code);

/// What is known of a recording now. `ask`: the stamp that the pieces of this campaign have. A piece that another
/// model, question or program made is none of its: a call that was interrupted leaves such, and the next one makes them
/// anew.
[[nodiscard]] nlohmann::ordered_json row_now(const Plan& plan, const nlohmann::ordered_json& ask,
                                             const std::string& recording);

/// The same as a line of campaign.csv (RFC 4180), without its end.
[[nodiscard]] std::string csv_header(const Ask& ask);
[[nodiscard]] std::string csv_line(const Ask& ask, const nlohmann::ordered_json& row);

/// "coulomb_friction 0.98; slack 0.91"
[[nodiscard]] std::string names_of_missing(const nlohmann::ordered_json& missing);

/// A value of a row for people: "" of null.
[[nodiscard]] std::string text_of(const nlohmann::ordered_json& value);

}  // namespace isorig::cli::pieces
