#pragma once
#include <algorithm>
#include <array>
#include <cmath>

#include "identify/diagnose/fit/whiten.hpp"

namespace isorig::identify {

/// How far a search for a noise goes.
struct NoiseSearch {
  std::array<double, 3> width;  ///< first steps of log white, log coloured, log correlation
  int passes = 10;
  double shortest_s = 0.0;  ///< the correlation stays within these
  double longest_s = 0.0;
};

/// Coordinate ascent on the logarithms of the three numbers of a noise, from `best` with its `best_score`: each in
/// turn is moved up, else down, and the steps shrink by a quarter every pass (Hooke & Jeeves 1961 without pattern
/// moves). The likelihood of a noise has long ridges and no cheap gradient; three numbers need no more. Without a
/// coloured part only the white one is moved.
template <typename Score>
void climb(NoiseModel& best, double& best_score, NoiseSearch search, Score&& score) {
  for (int pass = 0; pass < search.passes; ++pass) {
    for (std::size_t i = 0; i < search.width.size(); ++i) {
      if (i > 0 && best.coloured_N == 0.0) continue;
      for (const double direction : {1.0, -1.0}) {
        NoiseModel trial = best;
        double& value = i == 0 ? trial.white_N : i == 1 ? trial.coloured_N : trial.correlation_s;
        value *= std::exp(direction * search.width[i]);
        trial.correlation_s = std::clamp(trial.correlation_s, search.shortest_s, search.longest_s);
        if (const double s = score(trial); s > best_score) {
          best_score = s;
          best = trial;
          break;
        }
      }
    }
    for (double& width : search.width) width *= 0.75;
  }
}

}  // namespace isorig::identify
