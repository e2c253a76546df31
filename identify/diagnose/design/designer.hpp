#pragma once
#include <cmath>
#include <optional>
#include <vector>

#include "identify/diagnose/design/candidates.hpp"
#include "identify/diagnose/design/design.hpp"
#include "identify/diagnose/design/rehearse.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"

namespace isorig::identify {

/// Whether one explanation contains all effects of another.
[[nodiscard]] bool holds_all(const Hypothesis& whole, const Hypothesis& part);

/// An explanation, its free numbers, and how precisely the recordings determine them.
struct Rival {
  const Hypothesis* hypothesis = nullptr;
  model::ModelSpec spec;
  std::vector<FreeNumber> numbers;
  Eigen::MatrixXd information;
  double chi2 = 0.0;  ///< over the recordings so far
};

/// The distance that an experiment gives to every pair of explanations.
struct Score {
  std::vector<double> distance;
  [[nodiscard]] double least(const std::vector<bool>& counts) const {
    double out = HUGE_VAL;
    for (std::size_t i = 0; i < distance.size(); ++i)
      if (counts[i]) out = std::min(out, distance[i]);
    return out;
  }
};

struct Pair {
  std::size_t truth, rival;
};

/// What an experiment has to beat to be of use: another one's least distance, and of which pair that is.
struct ToBeat {
  double least = -1.0;  ///< below 0: nothing
  std::size_t pair = 0;
};

/// What the tied explanations expect of an experiment, to first order and by refits.
class Designer {
 public:
  Designer(const Search& search, const Selection& selection, const std::vector<std::size_t>& tied,
           const DesignOptions& options, unsigned threads);

  /// What the recordings did, once more: the paper's ramps at their stroke and speed.
  [[nodiscard]] std::optional<CandidateExperiment> paper_ramps_again() const;

  [[nodiscard]] const CandidateLimits& limits() const { return limits_; }
  [[nodiscard]] const std::vector<Pair>& pairs() const { return pairs_; }

  /// To first order. Empty when a tied explanation expects forces beyond the limits.
  [[nodiscard]] std::optional<Score> score(const CandidateExperiment& item) const;

  /// Without approximation: each rival refitted to the recordings and what the truth says of the new one. Given up
  /// where a pair is no farther apart than what is to be beaten: the distances that are not known then stand as 0.
  [[nodiscard]] Score prove(const CandidateExperiment& item, const std::vector<bool>& counts,
                            const ToBeat& to_beat = {}) const;

 private:
  void read_limits();
  [[nodiscard]] bool bearable(const Series& run, const Eigen::VectorXd& force_N) const;

  const DesignOptions& options_;
  unsigned threads_;
  std::span<const Series> recorded_;
  NoiseModel noise_;
  std::vector<Rival> rivals_;
  std::vector<Pair> pairs_;
  model::Reference reference_;
  CandidateLimits limits_;
  Sampling sampling_;
  double recorded_stroke_mm_ = 0.0;
  double recorded_speed_mm_s_ = 0.0;
};

}  // namespace isorig::identify
