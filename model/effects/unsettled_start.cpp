#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

class Unsettled : public Process {
 public:
  explicit Unsettled(double time_constant_s) noexcept : tau_s_(time_constant_s) {}
  void reset(const Instant& first) noexcept override { start_s_ = first.t_s; }
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = std::exp(-(now.t_s - start_s_) / tau_s_);
  }

 private:
  double tau_s_;
  double start_s_ = 0.0;
};

}  // namespace

const Physics& unsettled_start() {
  static const Physics physics{
      "unsettled_start",
      Stage::kSpecimen,
      "The recording starts before the specimen has come to rest.",
      "Maxwell arm with force left in it.",
      "Wait longer before the first motion.",
      {{"exponential",
        "F = F0 exp(-t / tau)",
        {{"time_constant_s", 0.05, 100.0, {1.0, 20.0}, true}},
        {{"force_N", Sign::kFree}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Unsettled>(p[0]); },
        {.counts = Counts::kTime}}},
      {.unusual = true}};
  return physics;
}

}  // namespace isorig::model::effect
