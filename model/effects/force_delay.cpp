#include <algorithm>
#include <memory>

#include "model/column_filter.hpp"
#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// F_read(t) = F(t - d), straight between instants. What is kept are the instants of the last 65 536 numbers:
/// with a time and 32 coefficients each, a delay of 1 s up to 1.9 kHz, with the usual five up to 10 kHz; a
/// longer one is cut to that.
class Delay : public Process {
 public:
  explicit Delay(double delay_s) : delay_s_(delay_s), ring_(new double[kNumbers]) {}
  void reset(const Instant&) noexcept override { newest_ = read_ = 0; }
  void shape(const Instant& now, std::span<double> columns, std::span<const double>) noexcept override {
    const std::size_t width = std::min(columns.size(), kMostColumns);
    depth_ = kNumbers / (width + 1);
    double* const entry = at(newest_, width);
    entry[0] = now.t_s;
    std::copy_n(columns.begin(), width, entry + 1);
    ++newest_;
    const double wanted_s = now.t_s - delay_s_;
    const std::size_t oldest = newest_ > depth_ ? newest_ - depth_ : 0;
    if (read_ < oldest) read_ = oldest;
    while (read_ + 1 < newest_ && at(read_ + 1, width)[0] <= wanted_s) ++read_;
    const double* const before = at(read_, width);
    if (read_ + 1 >= newest_ || wanted_s <= before[0]) {
      std::copy_n(before + 1, width, columns.begin());
      return;
    }
    const double* const after = at(read_ + 1, width);
    const double share = (wanted_s - before[0]) / (after[0] - before[0]);
    for (std::size_t i = 0; i < width; ++i) columns[i] = before[i + 1] + share * (after[i + 1] - before[i + 1]);
  }

 private:
  static constexpr std::size_t kNumbers = 65536;
  [[nodiscard]] double* at(std::size_t number, std::size_t width) noexcept {
    return ring_.get() + number % depth_ * (width + 1);
  }
  double delay_s_;
  std::size_t newest_ = 0;
  std::size_t read_ = 0;
  std::size_t depth_ = 1;
  std::unique_ptr<double[]> ring_;  // time and columns of each instant; what was never written is never read
};

}  // namespace

const Physics& force_delay() {
  static const Physics physics{
      "force_delay",
      Stage::kSensorDelay,
      "Dead time between the position and the force channel.",
      "Dead time of a channel: buffers, clocks aligned late (Ljung 1999, on delays in identification).",
      "Sines of 1 mm at 0.5 to 4 Hz: the phase grows with frequency and the gain stays. See force_lag.",
      {{"dead_time",
        "F'(t) = F(t - d)",
        {{.name = "delay_s",
          .symbol = "d",
          .lower = 0.0,
          .upper = 1.0,
          .starts = {0.004, 0.03},
          .traits = {.resolution = Resolution::kSampleInterval, .resolution_factor = 0.1},
          .sheet =
              {.what = "Time by which the force reading is late on the position reading.",
               .unit = "s",
               .range =
                   "Numerics: the past of 1 s is kept; negative would need the future, and is a position that is late.",
               .errors = "Clocks that are aligned wrongly are such a delay. Less than a tenth of a sample interval is "
                         "not claimed. Mistaken for a lag where only ramps were run."}}},
        {},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Delay>(p[0]); }}},
      {.acts_on = "force channel",
       .depends_on = {"onset"},
       .shape_of = ShapeOf::kStep,
       .words = "a force reading that comes late"}};
  return physics;
}

}  // namespace isorig::model::effect
