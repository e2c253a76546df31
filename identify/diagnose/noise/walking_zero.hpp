#pragma once
#include <Eigen/Dense>
#include <optional>
#include <span>

#include "identify/diagnose/fit/whiten.hpp"

namespace isorig::identify {

/// A zero of the force that walks at random: its change over a time t is normal with the variance q t, whatever the
/// specimen does (Einstein 1905; "random walk" of sensors, IEEE Std 952-1997, C.1.4).
struct WalkingZero {
  double rate_N2_s = 0.0;       ///< q
  double log_odds_nats = 0.0;   ///< that the zero walks at rest, before any prior cost
  double rest_rate_N2_s = 0.0;  ///< q at rest and in motion, each by itself: they agree within chance
  double motion_rate_N2_s = 0.0;

  /// rms of the change over a time.
  [[nodiscard]] double rms_N(double over_s) const noexcept;
};

/// Whether the residual of an explanation (measured minus predicted force, one value a bin) is a zero that walks. A law
/// that is missing or wrong errs where the specimen moves, and what relaxes moves less and less while it rests; a zero
/// does not know whether the specimen moves. With r_b the mean of the residual over block b of the length h,
/// `walk_block_rests` of a rest, n_b its readings, and z_b the zero at its end
///
///     r_b = z_(b-1) + v_b + e_b,  z_b = z_(b-1) + u_b,  e_b ~ N(0, w^2 / n_b + c^2),
///     var u_b = q h,  var v_b = q h / 3,  cov(u_b, v_b) = q h / 2,  z_0 free
///
/// where v_b is the mean over the block of a walk that begins at zero (the integrals of min(s, t)), c what coloured
/// noise leaves in the mean of a block however many its readings, and q = q_r in blocks at rest, else q_m. The
/// likelihood comes from a Kalman filter with a diffuse start. The residual is a walk where
///
/// - it is likelier with q_r > 0 than with q_r = 0, by more than half the logarithm of the blocks;
/// - one rate for both, q_r = q_m, loses no more than `allowed_noise_log`;
/// - blocks four times as long give the same rate within a factor of `walk_growth_ratio`: noise that forgets has less
///   over longer times;
/// - so do the blocks without what six cosines over the recording follow: nothing is left of a drift by a law.
///
/// Nothing where it is not, or with fewer than eight blocks at rest or twelve of the longer ones.
[[nodiscard]] std::optional<WalkingZero> walking_zero(const Series& series, const Eigen::VectorXd& residual_N,
                                                      double white_N);

/// The noise is that of a zero that walks: it forgets later than the longest recording ends.
[[nodiscard]] bool is_walk(const NoiseModel& noise, std::span<const Series> series) noexcept;

}  // namespace isorig::identify
