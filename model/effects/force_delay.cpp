#include <array>
#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// F_read(t) = F(t - d), straight between instants.
class Delay : public Process {
 public:
  explicit Delay(double delay_s) noexcept : delay_s_(delay_s) {}
  void reset(const Instant&) noexcept override { newest_ = read_ = 0; }
  void shape(const Instant& now, std::span<double> columns, std::span<const double>) noexcept override {
    const std::size_t width = std::min(columns.size(), kMost);
    Entry& entry = ring_[newest_ % kDepth];
    entry.t_s = now.t_s;
    for (std::size_t i = 0; i < width; ++i) entry.columns[i] = columns[i];
    ++newest_;
    const double wanted_s = now.t_s - delay_s_;
    const std::size_t oldest = newest_ > kDepth ? newest_ - kDepth : 0;
    if (read_ < oldest) read_ = oldest;
    while (read_ + 1 < newest_ && ring_[(read_ + 1) % kDepth].t_s <= wanted_s) ++read_;
    const Entry& before = ring_[read_ % kDepth];
    if (read_ + 1 >= newest_ || wanted_s <= before.t_s) {
      for (std::size_t i = 0; i < width; ++i) columns[i] = before.columns[i];
      return;
    }
    const Entry& after = ring_[(read_ + 1) % kDepth];
    const double share = (wanted_s - before.t_s) / (after.t_s - before.t_s);
    for (std::size_t i = 0; i < width; ++i)
      columns[i] = before.columns[i] + share * (after.columns[i] - before.columns[i]);
  }

 private:
  static constexpr std::size_t kMost = 32;
  static constexpr std::size_t kDepth = 512;
  struct Entry {
    double t_s = 0.0;
    std::array<double, kMost> columns{};
  };
  double delay_s_;
  std::size_t newest_ = 0;
  std::size_t read_ = 0;
  std::array<Entry, kDepth> ring_{};
};

}  // namespace

const Physics& force_delay() {
  static const Physics physics{
      "force_delay",
      Stage::kSensorDelay,
      "Dead time between the position and the force channel.",
      "Buffers, clocks aligned late.",
      "Sines of 1 mm at 0.5 to 4 Hz: the phase grows with frequency and the gain stays. See force_lag.",
      {{"dead_time",
        "F'(t) = F(t - d)",
        {{"delay_s", 0.0, 1.0, {0.004, 0.03}}},
        {},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Delay>(p[0]); }}}};
  return physics;
}

}  // namespace isorig::model::effect
