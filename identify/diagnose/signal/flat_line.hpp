#pragma once
#include <span>
#include <vector>

namespace isorig::identify {

/// Rows first .. end - 1.
struct FlatRun {
  std::size_t first = 0;
  std::size_t end = 0;
};

/// Runs of one and the same value where the noise would have moved the reading: a dozen at least, and so long
/// that such a run comes by chance once in a thousand recordings. A reading in the middle of its step repeats
/// itself with the probability erf(step / (2 sqrt(2) noise)), which for a fine step is nil and for one of
/// three noises is 0.87.
[[nodiscard]] std::vector<FlatRun> flat_runs(std::span<const double> t_s, std::span<const double> reading);

/// A position without them: straight from the last reading that was alive to the next.
[[nodiscard]] std::vector<double> without_flat_runs(std::span<const double> t_s, std::vector<double> reading_mm);

}  // namespace isorig::identify
