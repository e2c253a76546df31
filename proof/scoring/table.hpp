#pragma once
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "proof/scoring/score.hpp"

namespace isorig::proof {

/// First column: what is counted; then one column per method.
[[nodiscard]] std::vector<std::vector<std::string>> comparison(std::span<const Score> scores);
[[nodiscard]] std::string comparison_text(std::span<const Score> scores);
/// For the terminal: the comparison, and the reliability of the first method.
[[nodiscard]] std::string table_text(std::span<const Score> scores);
[[nodiscard]] nlohmann::ordered_json score_json(std::span<const Score> scores);
/// One line per case: what was concealed, what was said.
[[nodiscard]] std::vector<std::vector<std::string>> case_rows(const std::vector<Label>& labels,
                                                              const std::vector<Outcome>& outcomes,
                                                              bool against_recorded_force);
/// report.html, self-contained, drawn with identify/report.
void write_score_report(const std::filesystem::path& folder, const std::string& title, std::span<const Score> scores,
                        const std::vector<std::vector<std::string>>& rows, const std::string& seal);

}  // namespace isorig::proof
