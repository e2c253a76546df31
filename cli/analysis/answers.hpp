#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "messages/recording.hpp"

/// `diagnose` and `predict` of recordings whose output is not the force.
namespace isorig::cli {

/// Writes diagnosis.json, nominal.toml, model.toml and, unless told not to, diagnosis-report.html; says what was found.
/// Returns the exit code.
[[nodiscard]] int diagnose_answer(const std::vector<messages::Recording>& recordings,
                                  const std::vector<std::string>& names, const std::string& nominal,
                                  const std::filesystem::path& out, bool report);

/// CSV: t_s, the output, and its band where the model knows its error; one row per row of the output's own file. Of the
/// output itself only its beginning is looked at. Throws base::ConfigError, std::invalid_argument.
[[nodiscard]] std::string predicted_answer(const messages::Recording& recording, const std::string& name,
                                           const std::filesystem::path& model);

}  // namespace isorig::cli
