#pragma once
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "identify/diagnose/fit/running_forecast.hpp"
#include "identify/twin/cusum.hpp"
#include "identify/twin/live_motion.hpp"

namespace isorig::identify::twin {

/// What the arms of a model hold when the twin begins. Filling loads the muscle's springs before any reading is
/// predicted, and a relaxed model would be wrong for some time constants. An arm that holds F0 too much adds
/// F0 exp(-(t - t0) / tau), tau its time constant (as arm_start has it), so that F0 is linear in the residual: Bayesian
/// least squares over the readings until the first move, prior F0 = 0 +- kPrior_N, noise that of the model. Its error
/// is part of the band. Kept is the root R of the information, R'R, brought up to date by rotations (Bierman 1977,
/// Factorization Methods for Discrete Sequential Estimation): decays of neighbouring time constants are nearly alike,
/// and the information itself would lose half of the digits.
class StartState {
 public:
  static constexpr double kPrior_N = 10.0;
  explicit StartState(const model::ModelSpec& spec);

  void learn(double since_s, double residual_N);
  struct Share {
    double force_N = 0.0;
    double error_N = 0.0;  ///< standard error
  };
  [[nodiscard]] Share at(double since_s) const;

 private:
  [[nodiscard]] Eigen::VectorXd decays(double since_s) const;
  std::vector<double> times_s_;
  double noise_N_;
  Eigen::MatrixXd root_;  // upper triangle; its last column is what was measured
};

/// One reading beside what the model says.
struct Row {
  std::int64_t mono_ns = 0;
  double force_N = 0.0;   ///< predicted
  double half_N = 0.0;    ///< of the 95 % band; 0 without a band
  double residual = 0.0;  ///< measured minus predicted, in standard errors (half_N / 1.96); 0 without a band
  bool outside = false;   ///< the model leaves what it has seen
};

/// Where model and muscle part.
struct Parting {
  std::int64_t mono_ns = 0;        ///< when the shift began, as far as the sum tells
  std::int64_t found_mono_ns = 0;  ///< when it was found
  std::uint32_t step = 0;          ///< of the plan, at `mono_ns`
  double residual_N = 0.0;         ///< mean of the measured minus the predicted force between the two
};

/// A model beside the running rig, for one session: stepped as `isorig predict` steps it on a recording of that
/// session, judged by a CUSUM from the first move on, since before it the start state is learnt. Of one thread.
class Twin {
 public:
  /// Throws std::invalid_argument when the model's [seen] does not belong to it.
  Twin(const model::ModelSpec& spec, const model::Reference& reference);

  /// `judged`: the rig does what the model is for (a step after filling, not paused, not stopped). Readings before the
  /// first step that moves teach the start state.
  [[nodiscard]] std::vector<Row> frame(const Reading& reading, bool moved);
  void pressure(std::int64_t mono_ns, double psi) { motion_.pressure(mono_ns, psi); }

  [[nodiscard]] bool has_band() const { return has_band_; }
  [[nodiscard]] const std::optional<Parting>& parting() const { return parting_; }
  /// Readings judged, and of these the share inside of the band.
  [[nodiscard]] std::uint64_t judged() const { return judged_; }
  [[nodiscard]] std::uint64_t covered() const { return covered_; }
  [[nodiscard]] const Cusum& cusum() const { return cusum_; }
  [[nodiscard]] bool learning() const { return learning_; }
  [[nodiscard]] std::vector<std::string> notes() const;
  /// Not empty: a force, its band or a reading was no number, or the band had no width, and the twin has ended; why.
  [[nodiscard]] const std::string& fault() const { return fault_; }
  [[nodiscard]] std::size_t bytes() const { return motion_.bytes() + recent_.size() * sizeof(Block); }

 private:
  struct Block {
    std::int64_t mono_ns = 0;
    std::uint32_t step = 0;
    double sum = 0.0, sum_N = 0.0;
    std::size_t count = 0;
    double innovation = 0.0;
  };
  /// Of the blocks since the sum was zero, the one from which on their innovations are best told from zero: the largest
  /// (sum e)^2 / n, the likelihood of a shift of unknown size (Hinkley 1970). The sum itself may have been above zero
  /// for some 1 / k^2 blocks by chance before.
  [[nodiscard]] std::deque<Block>::const_iterator began(std::size_t since) const;
  /// Nothing: it has ended.
  [[nodiscard]] std::optional<Row> step(const LiveMotion::Row& given);
  void judge(const Reading& reading, double residual, double residual_N);
  void close_block(std::int64_t now_ns);

  model::ModelSpec spec_;
  model::Reference reference_;
  LiveMotion motion_;
  std::unique_ptr<RunningForecast> running_;
  StartState start_;
  bool has_band_;
  double start_s_ = 0.0;
  std::int64_t moved_ns_ = INT64_MAX;
  bool begun_ = false;
  std::string fault_;

  Correlation correlation_;
  Cusum cusum_;
  bool learning_ = true;
  Block block_;
  std::deque<Block> recent_;  // of these a parting that is found has begun with one; bounded
  std::optional<Parting> parting_;
  std::uint64_t judged_ = 0, covered_ = 0;
};

}  // namespace isorig::identify::twin
