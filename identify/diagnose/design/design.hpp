#pragma once
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/search/select.hpp"
#include "protocol/limits.hpp"

namespace isorig::identify {

/// What an experiment may ask for and what it must show.
struct DesignOptions {
  /// Of the rig. Without them the recordings speak: no farther, faster or harder than they went.
  std::optional<protocol::Limits> rig;
  double longest_s = 1800.0;  ///< of one experiment
  /// The whitened squared distance that separates two explanations. It corresponds to a likelihood ratio of e^50: a
  /// margin for laws that are only approximately right, for noise that is not quite as assumed, and for model error,
  /// which reduces the distance (docs/investigate.md).
  double enough = deciding().separating_squares;
  /// An explanation takes part in a tie when its probability is at least this.
  double least_weight = deciding().tied_probability;
  /// Nothing is tied when all rivals together have less than this.
  double least_rivals = deciding().rivals_probability;
};

/// By how much the whitened sum of squares of one explanation grows when another is true, after it was refitted freely
/// to the recordings so far and the new one together.
struct Distance {
  std::size_t truth = 0;  ///< index into Design::tied
  std::size_t rival = 0;
  double expected = 0.0;
};

struct Experiment {
  std::string name;
  std::string text;      ///< what is done, in words
  std::string protocol;  ///< TOML, isorig-protocol/1, within the limits
  double duration_s = 0.0;
  double distance = 0.0;  ///< smallest of `distances`
  bool enough = false;    ///< it reaches what separates
  std::vector<Distance> distances;
};

/// Another candidate experiment, for comparison.
struct Runner {
  std::string text;
  double duration_s = 0.0;
  double distance = 0.0;  ///< to first order
};

struct Inseparable {
  std::size_t first = 0;  ///< indices into Design::tied
  std::size_t second = 0;
  double distance = 0.0;  ///< the best that any candidate reaches
  std::string text;
};

struct Design {
  struct Rival {
    std::string key;
    double probability = 0.0;
  };
  std::vector<Rival> tied;  ///< empty: one explanation stands out. Most probable first
  std::optional<Experiment> experiment;
  std::vector<Inseparable> inseparable;
  std::vector<Runner> others;  ///< the best of the rest, and the paper's ramps once more
  std::size_t considered = 0;
  double enough = 0.0;

  /// In words: "a force reading that comes late from a force reading that lags".
  [[nodiscard]] std::string separates() const;
};

/// When explanations remain tied: of the candidate experiments within the limits the shortest that separates every
/// two of them (Hunter and Reiner's criterion, worst pair first), else the one that separates them best. Pairs
/// that no candidate separates are named and not designed for.
///
/// Candidates are scored to first order about each explanation's fit, with what the recordings so far say about
/// its numbers as prior; whichever is chosen was then refitted without approximation.
[[nodiscard]] Design design_experiment(const Search& search, const Selection& selection, const DesignOptions& options,
                                       unsigned threads);

/// Says in words why the pairs of `design.inseparable` cannot be told apart; joins both directions of a pair.
void describe_inseparable(Design& design);

/// For diagnosis.json: null when there is no experiment.
[[nodiscard]] nlohmann::ordered_json experiment_json(const Design& design);
[[nodiscard]] nlohmann::ordered_json inseparable_json(const Design& design);

}  // namespace isorig::identify
