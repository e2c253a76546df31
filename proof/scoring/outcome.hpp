#pragma once
#include <cmath>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace isorig::proof {

struct Claim {
  std::string effect;
  double probability = 0.0;
};

struct Alternative {
  std::vector<std::string> effects;
  double probability = 0.0;
};

/// What a method said of one case. Root mean squares are against the noise-free force of the heldout
/// recording, or against its recorded force where there is no other.
struct Outcome {
  bool failed = false;
  std::string why;
  std::string verdict;  ///< consistent, missing_physics or unknown_physics
  std::vector<Claim> missing;
  std::vector<Alternative> alternatives;
  double nominal_rmse_N = NAN;
  double model_rmse_N = NAN;
  double wall_s = NAN;
  double cpu_s = NAN;
};

struct Label {
  std::string name;
  std::string category;
  std::string nominal;
  std::string trap = "none";
  std::vector<std::string> effects;  ///< "unknown": nothing in the catalogue names it
  std::vector<std::string> laws;     ///< of the second generator, one for each effect; else empty
  /// Further names for each effect that are the same thing as far as a recording can tell; empty: none at all.
  std::vector<std::vector<std::string>> accepted;
  std::vector<std::string> background;  ///< names of what is faintly there besides: no error, and nothing asked for
  double size = 1.0;
  double noise_N = 0.0;
  double residual_over_noise = NAN;
  std::string truth_sha256;
};

/// Whether a claimed name is right for the i-th concealed effect.
[[nodiscard]] bool names_effect(const Label& label, std::size_t i, const std::string& claimed);
/// ... for any of what is there.
[[nodiscard]] bool right_name(const Label& label, const std::string& claimed);

/// diagnosis.json of the recording format. Throws std::runtime_error that names the file.
[[nodiscard]] Outcome read_diagnosis(const std::filesystem::path& file);

/// The text of labels.json as generate_study wrote it.
[[nodiscard]] std::vector<Label> parse_labels(const std::string& text);

/// Which generator wrote them: "catalogue" or "foreign".
[[nodiscard]] std::string laws_of_labels(const std::string& text);

/// Of a labels file for cases from elsewhere. Accepted: an object from case names to labels or a list of
/// labels (also under "cases"); the concealed effects as names or objects. A form that is not understood is
/// an error that lists the keys found.
[[nodiscard]] std::vector<Label> parse_foreign_labels(const std::string& text);

/// Root mean square of the difference of two CSV files t_s,force_N, row by row.
[[nodiscard]] double prediction_rmse_N(const std::filesystem::path& prediction, const std::vector<double>& reference_N);

}  // namespace isorig::proof
