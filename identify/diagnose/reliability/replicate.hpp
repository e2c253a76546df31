#pragma once
#include <random>
#include <span>
#include <vector>

#include "identify/diagnose/study.hpp"

namespace isorig::identify {

/// Recordings as an explanation would give them: the motion and pressure of `originals` as they were read, and instead
/// of the force of every usable row
///
///     F_k(theta) + g W(t_k) r(t_k) + n_k,   rounded to the steps of the channel
///
///     theta  numbers of the explanation, drawn from N(fitted, C), C their covariance with the spread over the moves
///            (fit/intervals.hpp). A draw that leaves a range or breaks a sign is drawn again.
///     n      the instrument's noise: white, w / sqrt(readings of the row), and its Ornstein-Uhlenbeck part
///     r      what the chosen explanation leaves, between bins straight; g^2 = max(0, 1 - E[noise in r^2] / mean r^2)
///     W      an Ornstein-Uhlenbeck process of unit variance with the mean time of a move as its correlation time:
///            the dependent wild bootstrap (Shao 2010, JASA 105:218), which keeps size and place of the laws' own
///            error and gives it another course in every replicate
///
/// Rows that the guard refused keep the force that was read, so that a fault of the data stays one. `originals` are the
/// recordings that `study` was made of, before anything was cut from them.
class Replicator {
 public:
  Replicator(const Study& study, std::span<const messages::Recording> originals);

  /// From explanation `hypothesis` of the study's pool.
  [[nodiscard]] std::vector<messages::Recording> draw(std::size_t hypothesis, std::mt19937_64& random) const;

  /// Numbers of an explanation, drawn.
  [[nodiscard]] model::ModelSpec draw_numbers(std::size_t hypothesis, std::mt19937_64& random) const;

  /// g r per bin, of all series in a row: what the chosen explanation leaves beyond noise.
  [[nodiscard]] const Eigen::VectorXd& discrepancy_N() const noexcept { return discrepancy_N_; }

 private:
  const Study& study_;
  std::span<const messages::Recording> originals_;
  NoiseModel noise_;  ///< of a reading, at the scale that the selection found
  Eigen::VectorXd discrepancy_N_;
  double move_s_ = 1.0;
};

}  // namespace isorig::identify
