#pragma once
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "messages/recording.hpp"
#include "proof/real/cases.hpp"
#include "proof/scoring/outcome.hpp"

namespace isorig::proof {

/// What two models say of one recording that neither was fitted to, in the unit of what it asks for.
struct HeldoutPrediction {
  std::string name;  ///< the file's
  std::string unit;
  double spread = NAN;       ///< standard deviation of the readings: what a constant would err by
  double nominal_rms = NAN;  ///< error of nominal.toml, fitted to the same recordings
  double model_rms = NAN;    ///< ... of model.toml
  double in_band = NAN;      ///< share of the readings within model.toml's 95 % band; NaN where it states none

  /// By more than a twentieth of the noise, as in the study of concealed effects. What is not finite is worse.
  [[nodiscard]] bool worse(double noise) const noexcept { return !(model_rms <= nominal_rms + 0.05 * noise); }
};

struct FoundNumber {
  KnownNumber known;
  double value = NAN;  ///< NaN: the model has no such part
  double low95 = NAN, high95 = NAN;
  std::size_t of = 0;  ///< parts that have such a number; of several `value` is the one furthest from what is known
};

/// A number of the model in a diagnosis.json, or of an effect that it names and did not model. Which of several alike
/// parts is meant nothing says, and the nearest would flatter: the furthest counts.
[[nodiscard]] FoundNumber found_number(const KnownNumber& known, const nlohmann::json& diagnosis);

struct RealOutcome {
  std::string name;
  Outcome said;  ///< of `isorig diagnose`; its errors are not filled in
  double noise = NAN;
  std::vector<HeldoutPrediction> heldout;  ///< fewer than the case has where it failed
  std::vector<FoundNumber> numbers;
};

struct RealOptions {
  std::filesystem::path isorig = "isorig";
  unsigned jobs = 1;
  unsigned threads = 2;  ///< of each diagnosis
};

/// A recording as whoever predicts it may see it: the output's readings after the first ten, from which a prediction of
/// a position or a pressure begins, are all the tenth. Forces are zero, whatever it asks for.
[[nodiscard]] messages::Recording without_answers(messages::Recording recording);

/// Converts the case into OUT/name, diagnoses it and predicts what was held out. What an earlier call left there is
/// replaced. A diagnosis that fails is an outcome that says so; files that cannot be read or written throw.
[[nodiscard]] RealOutcome run_real_case(const RealCase& real, const std::filesystem::path& source,
                                        const std::filesystem::path& out, const RealOptions& options);
/// All of them, in the order of `cases`.
[[nodiscard]] std::vector<RealOutcome> run_real_cases(std::span<const RealCase> cases,
                                                      const std::filesystem::path& source,
                                                      const std::filesystem::path& out, const RealOptions& options);

/// For a document: what was left out and found, then the predictions, then the numbers beside the published ones.
[[nodiscard]] std::string real_markdown(std::span<const RealCase> cases, std::span<const RealOutcome> outcomes);
[[nodiscard]] nlohmann::ordered_json real_json(std::span<const RealCase> cases, std::span<const RealOutcome> outcomes);

}  // namespace isorig::proof
