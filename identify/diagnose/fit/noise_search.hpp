#pragma once
#include <algorithm>
#include <array>
#include <cmath>

#include "identify/diagnose/fit/whiten.hpp"

namespace isorig::identify {

/// Coordinate ascent on the logarithms of `Width::size()` numbers, from `best` with its `best_score`: each in turn is
/// moved up, else down, and the steps shrink by a quarter every pass (Hooke & Jeeves 1961 without pattern moves). The
/// likelihood of a noise has long ridges and no cheap gradient; three numbers need no more. `move(numbers, i, factor)`
/// multiplies the i-th number, and says whether there is one to move.
template <typename Numbers, typename Width, typename Move, typename Score>
void climb(Numbers& best, double& best_score, Width width, int passes, Move&& move, Score&& score) {
  for (int pass = 0; pass < passes; ++pass) {
    for (std::size_t i = 0; i < width.size(); ++i) {
      for (const double direction : {1.0, -1.0}) {
        Numbers trial = best;
        if (!move(trial, i, std::exp(direction * width[i]))) continue;
        if (const double s = score(trial); s > best_score) {
          best_score = s;
          best = trial;
          break;
        }
      }
    }
    for (double& each : width) each *= 0.75;
  }
}

/// How far a search for a noise goes.
struct NoiseSearch {
  /// First steps of log white, log coloured and log correlation, and along the ridge: of log coloured, with twice as
  /// much of log correlation.
  std::array<double, 4> width;
  int passes = 10;
  double shortest_s = 0.0;  ///< the correlation stays within these
  double longest_s = 0.0;
};

/// The same for the three numbers of a noise. Without a coloured part only the white one is moved. Over less time than
/// it is correlated, c, a coloured noise of s N rms is known by s^2 / c alone: a ridge on which neither number can be
/// moved without the other.
template <typename Score>
void climb(NoiseModel& best, double& best_score, NoiseSearch search, Score&& score) {
  const auto move = [&search](NoiseModel& trial, std::size_t i, double factor) {
    if (i > 0 && trial.coloured_N == 0.0) return false;
    if (i == 0) trial.white_N *= factor;
    if (i == 1 || i == 3) trial.coloured_N *= factor;
    if (i == 2) trial.correlation_s *= factor;
    if (i == 3) trial.correlation_s *= factor * factor;
    trial.correlation_s = std::clamp(trial.correlation_s, search.shortest_s, search.longest_s);
    return true;
  };
  climb(best, best_score, search.width, search.passes, move, score);
}

}  // namespace isorig::identify
