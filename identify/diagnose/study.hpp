#pragma once
#include <optional>
#include <string>
#include <vector>

#include "identify/diagnose/claims.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/design/design.hpp"
#include "identify/diagnose/explain/discernible.hpp"
#include "identify/diagnose/explain/discovered.hpp"
#include "identify/diagnose/explain/heldout.hpp"
#include "identify/diagnose/explain/locate.hpp"
#include "identify/diagnose/explain/shape.hpp"
#include "identify/diagnose/fit/intervals.hpp"
#include "identify/diagnose/guard/guard.hpp"
#include "identify/diagnose/noise/noise.hpp"
#include "identify/diagnose/noise/walking_zero.hpp"
#include "identify/diagnose/search/select.hpp"
#include "identify/diagnose/verdict.hpp"

namespace isorig::identify {

struct MissingEffect {
  const model::Physics* effect = nullptr;
  std::string law;      ///< of its parts; "event + creep" where they have several
  double weight = 0.0;  ///< of the explanations that have it, and no more than search/substitutes.hpp allows
  /// The effect that explains nearly as much in its place and limits the weight; null: none does.
  const model::Physics* substitute = nullptr;
  double probability = 0.0;  ///< as stated (search/calibration.hpp)
  double size_N = 0.0;       ///< of the force that it stands for (practical_significance.hpp)
  std::vector<NamedValue> parameters;
  std::string formula;  ///< of the law, with its numbers
  Shape shape;
};

struct Alternative {
  std::vector<std::string> effects;
  double probability = 0.0;
};

/// One of the sets of effects that were weighed against each other.
struct Explanation {
  std::string key;
  double weight = 0.0;
  double log_evidence = 0.0;
  double excess = 0.0;  ///< sum of squares beyond the noise, in units of the noise; 0 where less than the noise is left
  double left = 0.0;    ///< rms of the whitened residual over that of the noise
  bool at_bound = false;  ///< a parameter stands at the end of its range
};

/// What of the diagnosis model.toml does not hold, since it would predict worse with it.
struct NotModelled {
  std::vector<std::string> names;     ///< effects, and the variable of a description
  std::string why;                    ///< "" when the model is whole
  std::optional<LeftOut> decided_by;  ///< the left-out row that decided, if it was one

  [[nodiscard]] std::string text() const;  ///< for people
};

/// Why "consistent" would say more than the recordings do.
struct Unjudged {
  std::string why;
  std::string record;  ///< the recording that would allow a judgement
};

struct Errors {
  double train_rmse_N = 0.0;
  std::optional<double> heldout_rmse_N;  ///< blocks left out in turn; empty where nothing can be left out
};

struct Diagnosis {
  Verdict verdict = Verdict::kConsistent;
  std::vector<MissingEffect> missing;
  std::vector<Alternative> alternatives;
  std::vector<Explanation> tried;  ///< every set that was weighed, most probable first
  double noise_scale = 1.0;        ///< variance where nothing is left to explain, over the instrument's
  std::size_t rows = 0;            ///< independent readings (bins) that the fits rest on
  std::vector<Place> where;
  std::vector<DataFault> faults;
  std::vector<Decided> decided;       ///< by other numbers than the stated ones
  std::vector<std::string> warnings;  ///< what changes the meaning of all of it; stands first, everywhere
  std::vector<std::string> notes;     ///< equivalences, limits of what was shown, what stays unexplained
  double noise_N = 0.0;
  NoiseModel instrument;
  double noise_reading_s = 0.0;  ///< InstrumentNoise::reading_s
  NoiseSource noise_source = NoiseSource::kDifferences;
  std::optional<WalkingZero> walk;  ///< of the force's zero, beside which all else was weighed
  Errors nominal_errors;
  Errors model_errors;
  HeldoutStudy heldout;
  std::vector<Discernible> discernible;  ///< what of each effect these recordings could show
  model::ModelSpec nominal;
  model::ModelSpec model;
  /// Their numbers with 95 % intervals, of every part in the order of the model.
  std::vector<std::vector<NamedValue>> nominal_numbers, model_numbers;
  NotModelled not_modelled;
  double model_share = 1.0;                ///< of what `model` has beyond `nominal`, what it predicts (publish.hpp)
  std::string why_share;                   ///< what speaks against all of it; "" at 1
  std::optional<Unjudged> unjudged;        ///< of the verdict cannot_judge
  Design design;                           ///< what would settle it, when explanations are tied
  std::string described_by;                ///< variable of the table that stands for unknown physics
  std::vector<DiscoveredLaw> discovered;   ///< products of the model, which stand for it instead of a table
  double unexplained = 0.0;                ///< share of the nominal model's excess that is left
  std::optional<Reliability> reliability;  ///< where it was asked for
};

/// A diagnosis with what it rests on, for the report.
struct Study {
  std::vector<Series> series;
  std::vector<std::vector<bool>> usable;
  std::vector<DataFault> faults;
  InstrumentNoise noise;
  Selection selection;
  Diagnosis diagnosis;
};

}  // namespace isorig::identify
