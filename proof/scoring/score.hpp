#pragma once
#include <string>
#include <vector>

#include "proof/scoring/outcome.hpp"

namespace isorig::proof {

struct Share {
  std::size_t hits = 0;
  std::size_t of = 0;
  void count(bool hit) {
    hits += hit ? 1 : 0;
    ++of;
  }
};

/// 95 % interval of a share (Wilson 1927): unlike the normal one it stays within 0 and 1 and holds its level for few
/// trials.
struct Interval {
  double low = 0.0;
  double high = 1.0;
};
[[nodiscard]] Interval wilson(const Share& share);

struct ReliabilityBin {
  double low = 0.0;
  double high = 1.0;
  std::size_t claims = 0;
  double mean_claimed = 0.0;
  double right = 0.0;  ///< share
};

/// How a method did over a set of cases; docs/proof.md defines every number.
struct Score {
  std::string method;
  std::size_t cases = 0;
  Share failed;
  Share false_alarms;  ///< nulls not called consistent
  Share clean_false_alarms;
  Share unjudged;    ///< of all cases: verdict `cannot_judge`
  Share first_full;  ///< singles named first, by size
  Share first_half;
  Share first_quarter;
  Share first_all;
  Share missed;  ///< singles called consistent
  Share background_first;
  Share pairs_complete;
  Share pairs_exact;
  Share confusable_complete;
  Share confusable_exact;
  Share triples_complete;
  Share triples_exact;
  Share unknown_called;      ///< out-of-catalogue cases whose verdict is unknown_physics
  Share unknown_or_half;     ///< ... or which claim only names that are part of what is there
  Share unknown_wrong_sure;  ///< ... with a catalogue name claimed above 0.9
  Share wrong_sure;          ///< over all cases: a name claimed above 0.9 that was not concealed
  Share sure_right;          ///< of all claims above 0.9
  Share worse;               ///< heldout recordings that the model predicts worse than the nominal one, or not at all
  std::vector<double> gaps;  ///< closed, per case with something concealed; down to minus infinity
  double median_gap = NAN;
  double median_gap_named = NAN;  ///< without out-of-catalogue cases
  std::vector<ReliabilityBin> reliability;
  double brier = NAN;
  double calibration_error = NAN;
  double median_wall_s = NAN;
  double median_cpu_s = NAN;
  double most_wall_s = NAN;
  double most_cpu_s = NAN;
};

/// 1 - rmse(model) / rmse(nominal). `noise_N` is taken out of both when the reference was recorded force.
[[nodiscard]] double gap_closed(const Outcome& outcome, double noise_N);

[[nodiscard]] Score score(std::string method, const std::vector<Label>& labels, const std::vector<Outcome>& outcomes,
                          bool against_recorded_force = false);

}  // namespace isorig::proof
