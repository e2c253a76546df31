#pragma once
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "identify/response/response_fit.hpp"

namespace isorig::identify::response {

struct MissingPart {
  std::string effect;  ///< name of the catalogue (docs/effects.md)
  double probability = 0.0;
  std::string formula;
  std::vector<FittedNumber> numbers;
};

struct LeftOutPart {
  double from_s = 0.0, to_s = 0.0;
  std::string recording;
  double nominal_rms = 0.0, model_rms = 0.0;
  std::size_t data = 0;                                  ///< index into ResponseDiagnosis::data
  std::size_t first_row = 0;                             ///< of it
  std::vector<double> nominal_residual, model_residual;  ///< measured minus predicted, from that row on
};

struct ResponseDiagnosis {
  messages::Output output = messages::Output::kPosition;
  std::string verdict;      ///< the words of "isorig-diagnosis/1"
  std::string why, record;  ///< of cannot_judge
  std::vector<MissingPart> missing;
  struct Tried {
    std::vector<std::string> effects;  ///< empty: the nominal model
    double weight = 0.0;
  };
  std::vector<Tried> tried;  ///< sets of effects, most probable first
  ResponseFit nominal, model;
  double noise = 0.0;  ///< of a reading, white
  double unexplained = 0.0;
  std::vector<LeftOutPart> left_out;
  std::optional<double> nominal_heldout, model_heldout;
  std::vector<std::string> warnings, notes;
  std::string not_modelled;  ///< why model.toml is the nominal one although parts are missing
  std::vector<Data> data;
};

/// Nominal model: one retardation time ("slse1") or two ("slse2"). What may be missing: further times
/// (second_relaxation), a hysteresis that does not depend on the rate (coulomb_friction), a drift (zero_drift), an
/// outflow that is not linear (nonlinear_viscosity). Explanations are weighed by BIC over the rows that are
/// independent. Four of five stretches of every recording are left out in turn; a model that predicts them worse than
/// the nominal one is not handed out. An explanation needs three rows for each of its numbers, and below 100 rows
/// nothing is named. Throws std::invalid_argument for recordings that are not one question, std::domain_error for
/// numbers that are not finite.
[[nodiscard]] ResponseDiagnosis diagnose_response(const std::vector<messages::Recording>& recordings,
                                                  const std::vector<std::string>& names, std::string_view nominal,
                                                  const std::function<void(double, const char*)>& on_progress = {});

[[nodiscard]] nlohmann::ordered_json response_json(const ResponseDiagnosis& diagnosis);

}  // namespace isorig::identify::response
