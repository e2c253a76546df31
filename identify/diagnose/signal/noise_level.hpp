#pragma once
#include <span>

namespace isorig::identify {

/// rms of the white noise of a reading from its second differences, median-based (motion does not matter as
/// long as it is smooth for most of the record).
[[nodiscard]] double white_noise(std::span<const double> t_s, std::span<const double> reading);

/// Smallest nonzero difference between two values of the reading when all differences are multiples of it;
/// 0 otherwise.
[[nodiscard]] double quantisation(std::span<const double> reading);

}  // namespace isorig::identify
