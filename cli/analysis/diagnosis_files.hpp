#pragma once
#include <filesystem>
#include <vector>

#include "identify/diagnose/diagnosis.hpp"
#include "identify/report/page.hpp"
#include "model/number_sheet.hpp"

namespace isorig::cli {

/// slse1, slse2 or a model file. Throws base::ConfigError.
[[nodiscard]] model::ModelSpec read_nominal(const std::string& model);

/// diagnosis.json, nominal.toml, model.toml, next_experiment.toml if there is one (else none is left there),
/// and diagnosis-report.html unless `made` is null. The diagnosis stands without its report: what goes wrong with it is
/// said on stderr, and false is returned. Throws std::runtime_error when another file cannot be written.
bool write_diagnosis(const identify::Study& study, const std::filesystem::path& folder,
                     const identify::report::Made* made);

/// What people call an explanation, and behind it what files and options have: "dry friction [coulomb_friction]". Words
/// alone where they are the name.
[[nodiscard]] std::string words_and_name(const std::string& key);

/// "0.51 [0.49, 0.53] N: friction force at steady sliding [force_N]"; without a sheet "force_N: 0.51 [0.49, 0.53]".
[[nodiscard]] std::string number_line(double value, double low, double high, const model::NumberSheet* sheet,
                                      const std::string& name);

/// Verdict, effects with their numbers, ties, data faults and errors, for a terminal.
void print_diagnosis(const identify::Diagnosis& diagnosis, const std::filesystem::path& folder);

}  // namespace isorig::cli
