#include "identify/diagnose/noise.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace isorig::identify {
namespace {

struct Rest {
  std::vector<double> t_s;
  std::vector<double> force_N;
  std::vector<double> readings;
};

std::vector<Rest> find_rests(const Series& series, const std::vector<bool>& usable) {
  // Longer rests are cut: a line and two decays cannot follow an hour of relaxation.
  constexpr double kSettled_s = 10.0, kShortest_s = 8.0, kLongest_s = 40.0;
  std::vector<Rest> rests;
  Rest rest;
  const auto close = [&] {
    if (rest.t_s.size() >= 20 && rest.t_s.back() - rest.t_s.front() >= kShortest_s) {
      rests.push_back(std::move(rest));
    }
    rest = {};
  };
  double fastest = 0.0;
  for (const auto& node : series.nodes) fastest = std::max(fastest, std::fabs(node.velocity_mm_s));
  for (std::size_t k = 0; k < series.nodes.size(); ++k) {
    const bool still = std::fabs(series.nodes[k].velocity_mm_s) < 2e-4 * fastest;
    if (!still || series.since_corner_s[k] < kSettled_s) {
      close();
      continue;
    }
    for (std::size_t row = series.first_row[k]; row < series.first_row[k + 1]; ++row) {
      if (!usable.empty() && !usable[row]) continue;
      if (!rest.t_s.empty() && series.recording.frame.t_s[row] - rest.t_s.front() > kLongest_s) close();
      rest.t_s.push_back(series.recording.frame.t_s[row]);
      rest.force_N.push_back(series.recording.frame.force_N[row]);
      rest.readings.push_back(row < series.readings.size() ? series.readings[row] : 1.0);
    }
  }
  close();
  return rests;
}

/// Restricted likelihood: level, slope and two decays of every rest are integrated out, so that they take no
/// noise along, and relaxation does not pass for coloured noise.
double score(std::span<const Rest> rests, const NoiseModel& noise) {
  using Vector = Eigen::Matrix<double, 5, 1>;
  double sum = 0.0;
  const double stationary = noise.coloured_N * noise.coloured_N, white2 = noise.white_N * noise.white_N;
  for (const Rest& rest : rests) {
    Vector mean = Vector::Zero();
    Eigen::Matrix<double, 5, 5> gram = Eigen::Matrix<double, 5, 5>::Zero();
    double variance = stationary;
    const double middle = 0.5 * (rest.t_s.front() + rest.t_s.back());
    for (std::size_t k = 0; k < rest.t_s.size(); ++k) {
      if (k > 0 && stationary > 0.0) {
        const double decay = std::exp(-(rest.t_s[k] - rest.t_s[k - 1]) / noise.correlation_s);
        mean *= decay;
        variance = variance * decay * decay + stationary * (1.0 - decay * decay);
      }
      const double white2_here = white2 / rest.readings[k];
      const double total = variance + white2_here;
      const double since_s = rest.t_s[k] - rest.t_s[0];
      Vector e;
      e << 1.0, (rest.t_s[k] - middle) / 10.0, std::exp(-since_s / 4.0), std::exp(-since_s / 12.0),
          rest.force_N[k] - rest.force_N[0];
      e -= mean;
      gram += e * e.transpose() / total;
      sum -= 0.5 * std::log(total);
      mean += variance / total * e;
      variance *= white2_here / total;
    }
    const Eigen::Matrix4d a = gram.topLeftCorner<4, 4>();
    const Eigen::Vector4d b = gram.topRightCorner<4, 1>();
    sum -= 0.5 * (gram(4, 4) - b.dot(a.ldlt().solve(b)) + std::log(a.determinant()));
  }
  return sum;
}

}  // namespace

InstrumentNoise instrument_noise(std::span<const Series> series, std::span<const std::vector<bool>> usable) {
  InstrumentNoise out;
  std::vector<Rest> rests;
  std::size_t rows = 0;
  double white = 0.0;
  for (std::size_t i = 0; i < series.size(); ++i) {
    for (Rest& rest : find_rests(series[i], i < usable.size() ? usable[i] : std::vector<bool>{})) {
      rows += rest.t_s.size();
      rests.push_back(std::move(rest));
    }
    const auto& frame = series[i].recording.frame;
    white = std::max({white, series[i].reading_noise_N, white_noise(frame.t_s, frame.force_N),
                      quantisation(frame.force_N) / std::sqrt(12.0)});
  }
  out.noise = {std::max(white, 1e-9), 0.0, 1.0};
  if (rows < 200) return out;
  out.from_rests = true;
  NoiseModel best = out.noise;
  for (double width = 1.0; width > 0.002; width *= 0.6) {
    for (const double direction : {1.0, -1.0}) {
      const NoiseModel trial{best.white_N * std::exp(direction * width), 0.0, 1.0};
      if (score(rests, trial) > score(rests, best)) best = trial;
    }
  }
  const double all = best.white_N;
  double best_score = score(rests, best);
  const double white_only = best_score;
  for (const double correlation : {0.05, 0.3, 1.0, 3.0, 8.0}) {
    for (const double share : {0.15, 0.4, 0.8}) {
      NoiseModel trial{all * std::sqrt(1.0 - share * share), share * all, correlation};
      if (const double s = score(rests, trial); s > best_score) {
        best_score = s;
        best = trial;
      }
    }
  }
  std::array<double, 3> width{0.1, 0.5, 0.6};
  for (int pass = 0; pass < 12; ++pass) {
    for (int i = 0; i < 3; ++i) {
      if (i > 0 && best.coloured_N == 0.0) continue;
      for (const double direction : {1.0, -1.0}) {
        NoiseModel trial = best;
        double& value = i == 0 ? trial.white_N : i == 1 ? trial.coloured_N : trial.correlation_s;
        value *= std::exp(direction * width[i]);
        // Longer than that, a rest cannot tell it from its own relaxation.
        trial.correlation_s = std::clamp(trial.correlation_s, 0.01, 8.0);
        if (const double s = score(rests, trial); s > best_score) {
          best_score = s;
          best = trial;
          break;
        }
      }
    }
    for (double& w : width) w *= 0.75;
  }
  // Two more numbers must earn their keep.
  if (best_score - white_only < std::log(static_cast<double>(rows))) best = {all, 0.0, 1.0};
  out.noise = best;
  return out;
}

}  // namespace isorig::identify
