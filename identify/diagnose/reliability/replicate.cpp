#include "identify/diagnose/reliability/replicate.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/fit/many_starts.hpp"
#include "identify/diagnose/fit/moves.hpp"
#include "identify/diagnose/forecast.hpp"
#include "identify/diagnose/search/published.hpp"

namespace isorig::identify {
namespace {

/// A stationary Ornstein-Uhlenbeck process of unit variance, asked at times that do not fall.
class Wander {
 public:
  Wander(double correlation_s, std::mt19937_64& random) : correlation_s_(correlation_s), random_(random) {}

  double at(double t_s) {
    if (!begun_) {
      value_ = normal_(random_);
      begun_ = true;
    } else {
      const double kept = std::exp(-(t_s - t_s_) / correlation_s_);
      value_ = kept * value_ + std::sqrt(1.0 - kept * kept) * normal_(random_);
    }
    t_s_ = t_s;
    return value_;
  }

 private:
  double correlation_s_;
  std::mt19937_64& random_;
  std::normal_distribution<double> normal_;
  double value_ = 0.0, t_s_ = 0.0;
  bool begun_ = false;
};

/// Straight between the bins of one series, level beyond them.
class BetweenBins {
 public:
  BetweenBins(const Series& series, const double* value) : series_(series), value_(value) {}

  double at(double t_s) {
    const auto& nodes = series_.nodes;
    while (next_ < nodes.size() && nodes[next_].t_s <= t_s) ++next_;
    if (next_ == 0) return value_[0];
    if (next_ == nodes.size()) return value_[next_ - 1];
    const double share = (t_s - nodes[next_ - 1].t_s) / (nodes[next_].t_s - nodes[next_ - 1].t_s);
    return value_[next_ - 1] + share * (value_[next_] - value_[next_ - 1]);
  }

 private:
  const Series& series_;
  const double* value_;
  std::size_t next_ = 0;
};

bool allowed(const model::ModelSpec& spec, const FreeNumber& number) {
  const double value = value_of(spec, number);
  if (!std::isfinite(value)) return false;
  if (!number.coefficient) {
    const model::Parameter& parameter = parameter_of(spec, number);
    return value >= parameter.lower && value <= parameter.upper;
  }
  switch (spec.parts[number.part].law->coefficients[number.index].sign) {
    case model::Sign::kNonNegative:
      return value >= 0.0;
    case model::Sign::kNonPositive:
      return value <= 0.0;
    case model::Sign::kFree:
      break;
  }
  return true;
}

/// What is left beyond noise, shrunk to the size that it has without the noise in it.
Eigen::VectorXd beyond_noise(const Study& study, const NoiseModel& noise) {
  const Problem problem(study.series, noise);
  Eigen::VectorXd left = problem.target() - problem.predict(study.selection.chosen().fit.spec);
  double squares = 0.0, of_noise = 0.0;
  Eigen::Index row = 0;
  for (const Series& series : study.series) {
    for (const double count : series.count) {
      if (count > 0.0) {
        squares += left[row] * left[row];
        of_noise += noise.white_N * noise.white_N / count + noise.coloured_N * noise.coloured_N;
      } else {
        left[row] = 0.0;
      }
      ++row;
    }
  }
  const double share = squares > 0.0 ? std::max(0.0, 1.0 - of_noise / squares) : 0.0;
  return std::sqrt(share) * left;
}

double mean_move_s(const Study& study) {
  double duration_s = 0.0;
  for (const Series& series : study.series) duration_s += series.nodes.back().t_s - series.nodes.front().t_s;
  return duration_s / static_cast<double>(std::max<std::size_t>(number_moves(study.series).count, 1));
}

}  // namespace

Replicator::Replicator(const Study& study, std::span<const messages::Recording> originals)
    : study_(study), originals_(originals), noise_(study.noise.noise) {
  const double scale = std::sqrt(study.selection.noise_scale);
  noise_.white_N *= scale;
  noise_.coloured_N *= scale;
  discrepancy_N_ = beyond_noise(study, noise_);
  move_s_ = mean_move_s(study);
}

model::ModelSpec Replicator::draw_numbers(std::size_t hypothesis, std::mt19937_64& random) const {
  const Fit& fit = study_.selection.pool[hypothesis].fit;
  const std::vector<FreeNumber> numbers = fitted_numbers(fit.spec);
  // The chosen explanation's numbers may be those of least squares instead (prefer_simpler_laws).
  const bool least_squares =
      hypothesis == study_.selection.best && hypothesis != 0 && least_squares_decide(study_.selection);
  Eigen::MatrixXd spread = covariance(Problem(study_.series, fit.noise), fit.spec, Spread::kMoves,
                                      least_squares ? plain(study_.noise.weighing) : fit.noise);
  // A number that no force depends on has a variance without bound: it stays where it is.
  for (Eigen::Index i = 0; i < spread.rows(); ++i) {
    if (std::isfinite(spread(i, i))) continue;
    spread.row(i).setZero();
    spread.col(i).setZero();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> axes(spread);
  const Eigen::VectorXd lengths = axes.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  std::normal_distribution<double> normal;
  constexpr int kDraws = 100;
  for (int draw = 0; draw < kDraws; ++draw) {
    model::ModelSpec spec = fit.spec;
    Eigen::VectorXd deviates(lengths.size());
    for (double& each : deviates) each = normal(random);
    const Eigen::VectorXd by = axes.eigenvectors() * lengths.cwiseProduct(deviates);
    bool inside = true;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      value_of(spec, numbers[i]) += by[static_cast<Eigen::Index>(i)];
      inside = inside && allowed(spec, numbers[i]);
    }
    if (inside) return spec;
  }
  return fit.spec;
}

std::vector<messages::Recording> Replicator::draw(std::size_t hypothesis, std::mt19937_64& random) const {
  const model::ModelSpec spec = draw_numbers(hypothesis, random);
  std::vector<messages::Recording> out(originals_.begin(), originals_.end());
  std::normal_distribution<double> normal;
  Eigen::Index first_bin = 0;
  for (std::size_t s = 0; s < out.size(); ++s) {
    const Series& series = study_.series[s];
    const std::vector<double> force_N = forecast(spec, series.excitation).force_N;
    const auto& t_s = series.recording.frame.t_s;
    messages::FrameSamples& frame = out[s].frame;
    Wander coloured(std::max(noise_.correlation_s, 1e-9), random);
    Wander wild(move_s_, random);
    BetweenBins left(series, discrepancy_N_.data() + first_bin);
    const double step_N = series.force_quality.step;
    const auto noise_clock_s = [&](std::size_t row) {
      return series.noise_reading_s > 0.0 ? static_cast<double>(row) * series.noise_reading_s : t_s[row];
    };
    std::size_t original = 0;
    for (std::size_t k = 0; k < t_s.size(); ++k) {
      while (original < frame.size() && frame.t_s[original] < t_s[k]) ++original;
      const double white =
          noise_.white_N / std::sqrt(std::max(series.readings.empty() ? 1.0 : series.readings[k], 1e-9));
      const double drawn_N = force_N[k] + wild.at(t_s[k]) * left.at(t_s[k]) +
                             (noise_.coloured_N > 0.0 ? noise_.coloured_N * coloured.at(noise_clock_s(k)) : 0.0) +
                             white * normal(random);
      const bool usable = study_.usable[s].empty() || study_.usable[s][k];
      if (!usable || original == frame.size() || frame.t_s[original] != t_s[k]) continue;
      frame.force_N[original] = step_N > 0.0 ? std::round(drawn_N / step_N) * step_N : drawn_N;
    }
    first_bin += static_cast<Eigen::Index>(series.nodes.size());
  }
  return out;
}

}  // namespace isorig::identify
