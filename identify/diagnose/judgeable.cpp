#include "identify/diagnose/judgeable.hpp"

#include <cmath>

#include "base/formatted.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/noise_search.hpp"

namespace isorig::identify {
namespace {

/// Standard deviation of the force over all usable rows, about one mean.
double force_sd_N(const Study& study) {
  // Welford 1962: of a force of 100 N that stands still, a difference of two sums would leave their rounding.
  double mean = 0.0, squares = 0.0, n = 0.0;
  for (std::size_t i = 0; i < study.series.size(); ++i) {
    const auto& force_N = study.series[i].recording.frame.force_N;
    for (std::size_t k = 0; k < force_N.size(); ++k) {
      if (!study.usable[i].empty() && !study.usable[i][k]) continue;
      const double off = force_N[k] - mean;
      mean += off / ++n;
      squares += off * (force_N[k] - mean);
    }
  }
  return n > 0.0 ? std::sqrt(squares / n) : 0.0;
}

}  // namespace

std::optional<Unjudged> unjudged(const Study& study, double nominal_rmse_N) {
  const Diagnosis& d = study.diagnosis;
  const double sd_N = force_sd_N(study);
  if (sd_N <= deciding().excitation_noises * d.noise_N) {
    return Unjudged{
        base::formatted(
            "the force varies by %.3g N rms, and its noise is %.3g N: any model would fit (too little excitation)",
            sd_N, d.noise_N),
        "the same motion wide or fast enough to change the force by at least ten times its noise"};
  }
  const double share = nominal_rmse_N * nominal_rmse_N / (sd_N * sd_N);
  if (share > deciding().most_variance_left_share) {
    return Unjudged{
        base::formatted(
            "the nominal model leaves %.0f %% of the force's variance unexplained, and nothing that was tried "
            "takes it away",
            100.0 * share),
        "one that shows what the force does follow: ramps of several velocities with rests of 20 s "
        "between them, the same one at least twice, and whatever else drives the specimen as a column of "
        "its own"};
  }
  if (const auto left_out_N = d.nominal_errors.heldout_rmse_N;
      left_out_N && *left_out_N > deciding().left_out_ratio * std::max(d.noise_N, nominal_rmse_N)) {
    return Unjudged{
        base::formatted("the nominal model fits to %.3g N rms, and predicts the parts that were left out of "
                        "the fit with %.3g N: so little motion does not determine it",
                        nominal_rmse_N, *left_out_N),
        "further strokes of the same kind, so that whatever part is left out has its like in the others"};
  }
  if (!study.noise.measured() && d.noise_scale > deciding().guessed_noise_scale) {
    return Unjudged{
        base::formatted(
            "the noise of the force could not be measured, and what the model leaves has %.3g times the power "
            "that neighbouring readings suggest",
            d.noise_scale),
        "20 s at rest before and after the motion, or the same stroke at least four times"};
  }
  return std::nullopt;
}

NoiseModel likeliest_noise(const Study& study) {
  const Fit& fit = study.selection.chosen().fit;
  const Problem problem(study.series, fit.noise);
  const auto score = [&](const NoiseModel& noise) { return problem.log_likelihood(fit.spec, noise); };
  NoiseModel best = fit.noise;
  double best_score = score(best);
  climb(best, best_score, {.width = {0.1, 0.7, 1.0, 0.7}, .passes = 10, .shortest_s = 5e-3, .longest_s = 3e3}, score);
  return best;
}

std::optional<Unjudged> noise_beyond_the_rests(const Study& study, const NoiseModel& left) {
  if (study.noise.source != NoiseSource::kRests) return std::nullopt;
  const RestsOnNoise rests = rests_on(left, study.series, study.usable);
  if (!rests.allow) return std::nullopt;
  const std::string noise = left.coloured_N > 0.0
                                ? base::formatted("a noise of %.3g N that is correlated over ", left.coloured_N) +
                                      correlation_words(left.correlation_s, study.noise.reading_s)
                                : base::formatted("a white noise of %.3g N", left.white_N);
  return Unjudged{
      base::formatted(
          "what the model leaves looks like %s, and the %zu readings of the rests neither show such a noise "
          "nor rule it out",
          noise.c_str(), rests.readings),
      "the same motion with more rests and longer ones, read as often as the strokes"};
}

}  // namespace isorig::identify
