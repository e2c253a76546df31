#pragma once

namespace isorig::identify {

/// Quantile of Student's t distribution: P(T <= t) = probability, 0 < probability < 1, freedom > 0 (need not
/// be whole). Relative error below 1e-9. From the incomplete beta function (DiDonato and Morris 1992; the
/// continued fraction of Abramowitz and Stegun 26.5.8), inverted by bisection.
[[nodiscard]] double student_t_quantile(double probability, double freedom);

/// Regularised incomplete beta function I_x(a, b); a, b > 0, 0 <= x <= 1.
[[nodiscard]] double incomplete_beta(double a, double b, double x);

}  // namespace isorig::identify
