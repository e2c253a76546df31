#pragma once
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "identify/pooling/mixed_model.hpp"

namespace isorig::identify::pooling {

/// What the diagnosis of one recording says of one effect.
enum class Says {
  kNothing,   ///< it was not tried, the recording could not show it, or nothing could be judged
  kNotNamed,  ///< it was tried, could have shown, and gained nothing
  kProbable,  ///< `probability` is above the prior of the diagnosis
  kRefused,   ///< named, but its law predicts left-out readings worse
};

struct EffectEvidence {
  std::size_t actuator = 0;
  Says says = Says::kNothing;
  double probability = 0.0;  ///< as diagnosis.json states it, calibrated
};

struct EffectPriors {
  double log_odds = -3.0;  ///< of the effect, that each diagnosis has used: divided out of its probability
  bool event = false;      ///< it happens in some recordings of an actuator, not in all
};

/// Which actuators have an effect.
struct Presence {
  struct Actuator {
    double probability = 0.0;
    double log_likelihood_ratio = 0.0;                ///< of all its recordings, bounded
    std::size_t judged = 0, unjudged = 0, named = 0;  ///< recordings; named: with a probability above one half
  };
  std::vector<Actuator> actuators;
  double anywhere = 0.0;                      ///< probability that some actuator has it
  Estimate share;                             ///< of all actuators of this kind that have it
  [[nodiscard]] std::size_t present() const;  ///< actuators with a probability above one half
  [[nodiscard]] std::size_t judged() const;   ///< actuators with a recording that says something
};

/// The surest that a diagnosis is of any name (search/calibration.hpp): the rest of the cases were wrong at full
/// weight. A campaign's recordings can be misread alike, so that no number of them is surer.
inline constexpr double kSurest = 0.985;
/// Correlation of what recordings of one actuator are misread by: its cause, the actuator's own mechanics, is the same
/// in all, the noise is not. n of them count as n / (1 + (n - 1) / 2), less than two (design effect, Kish 1965). A
/// convention: no study has yet diagnosed one actuator many times.
inline constexpr double kAlike = 0.5;
/// Share of effects that are there, could have shown, and are not named: 6 of 72 single ones and about every fourth of
/// a pair, foreign seeds of docs/proof.md.
inline constexpr double kMissed = 0.15;

/// The evidence of one effect over recordings. With theta the share of actuators that have it, z_i whether actuator i
/// does, and q_i the share of its recordings that show it,
///
///     theta ~ Beta(2 m, 2 (1 - m)), m the prior probability of the diagnoses;   z_i ~ Bernoulli(theta)
///     q_i ~ Beta(2, 1), of events Beta(1, 1)
///     L_i = integral over q of  product over recordings r of (q LR_r + 1 - q)
///
/// LR_r is the odds of the stated probability over the prior odds, kMissed where it is not named. L_i is bounded on
/// both sides, by 1 - kSurest and odds(kSurest) / prior odds to the power that the recordings count (kAlike).
/// Probabilities below one half are no claims and were not calibrated, and a misfit that all recordings share looks
/// like weak evidence in each: those of the whole campaign together count as n / (1 + (n - 1) / 2), too. The
/// probabilities come out times kSurest.
[[nodiscard]] Presence pool_presence(std::span<const EffectEvidence> evidence, std::size_t actuators,
                                     const EffectPriors& priors);

}  // namespace isorig::identify::pooling
