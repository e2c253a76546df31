#pragma once
#include <array>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "proof/scoring/runner.hpp"

/// What a diagnosis makes of a study when the numbers that decide it are others.
namespace isorig::proof {

/// A line of `isorig diagnose --deciding --json`.
struct StatedNumber {
  std::string name, unit;
  double value = 0.0, least = 0.0, most = 0.0;
  bool whole = false;
};

/// The number times `factor`, rounded where it is whole, and within what it may be; empty where that is its own value.
[[nodiscard]] std::optional<double> moved(const StatedNumber& number, double factor);

struct SensitivityOptions {
  std::filesystem::path study;
  std::filesystem::path labels;   ///< empty: STUDY/sealed/labels.json
  std::vector<std::string> only;  ///< names of numbers; empty: all
  RunOptions run;
};

/// Claims above 0.9 and predictions, of all cases under one set of numbers.
struct Tally {
  std::size_t right = 0, wrong = 0;
  double median_gap = 0.0;
};

/// All cases with one number at another value.
struct Shift {
  double value = 0.0;
  std::size_t verdicts_changed = 0;
  std::size_t names_changed = 0;  ///< cases whose names, in whatever order, are others
  Tally tally;
};

struct NumberSensitivity {
  StatedNumber number;
  std::array<std::optional<Shift>, 2> shifts;  ///< at half, at double; empty where it may not be moved that way
};

struct Sensitivity {
  std::string labels_sha256;
  std::size_t cases = 0;
  Tally stated;
  std::vector<NumberSensitivity> numbers;
};

/// What changes from one set of outcomes to another.
[[nodiscard]] Shift shift_of(double value, const std::vector<Label>& labels, const std::vector<Outcome>& stated,
                             const std::vector<Outcome>& now);

/// Runs every case at the stated values, and at half and at double of each number. A piece is one case with one number
/// at one value, kept as STUDY/sensitivity/NAME=VALUE/CASE.json; those that are there are not run again. Where another
/// program made them, or of other labels (the folder was generated into once more), nothing is run or written:
/// std::runtime_error. Tabulated are all numbers whose pieces are there, of earlier calls, too.
[[nodiscard]] Sensitivity measure_sensitivity(const SensitivityOptions& options);

/// Markdown, for the terminal as well.
[[nodiscard]] std::string sensitivity_text(const Sensitivity& of);
[[nodiscard]] nlohmann::ordered_json sensitivity_json(const Sensitivity& of);

}  // namespace isorig::proof
