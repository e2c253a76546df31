#include <cmath>
#include <numbers>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

class Linear : public Process {
 public:
  void reset(const Instant& first) noexcept override { start_s_ = first.t_s; }
  void force(const Instant& now, double* columns) noexcept override { columns[0] = (now.t_s - start_s_) / 3600.0; }

 private:
  double start_s_ = 0.0;
};

class Settling : public Process {
 public:
  explicit Settling(double time_constant_s) noexcept : tau_s_(time_constant_s) {}
  void reset(const Instant& first) noexcept override { start_s_ = first.t_s; }
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = -std::expm1(-(now.t_s - start_s_) / tau_s_);
  }

 private:
  double tau_s_;
  double start_s_ = 0.0;
};

/// A drift of any slow shape: the first six cosines over the recording. Only for what was recorded: beyond
/// its duration it holds the last value.
class Wander : public Process {
 public:
  explicit Wander(double duration_s) noexcept : duration_s_(duration_s) {}
  void reset(const Instant& first) noexcept override { start_s_ = first.t_s; }
  void force(const Instant& now, double* columns) noexcept override {
    const double u = std::fmin((now.t_s - start_s_) / duration_s_, 1.0);
    for (int k = 1; k <= 6; ++k) columns[k - 1] = std::cos(std::numbers::pi * k * u);
  }

 private:
  double duration_s_;
  double start_s_ = 0.0;
};

}  // namespace

const Physics& zero_drift() {
  static const Physics physics{
      "zero_drift",
      Stage::kSensor,
      "Slow drift of the force zero.",
      "Temperature of the load cell and its amplifier (OIML R 60).",
      "A dead weight, or no specimen, for an hour. Mistaken for creep and for softening, which stop with the "
      "motion.",
      {{"linear",
        "F = r t",
        {},
        {{"rate_N_h", Sign::kFree}},
        [](auto, const Reference&) { return std::make_unique<Linear>(); },
        {.counts = Counts::kTime}},
       {"settling",
        "F = D (1 - exp(-t / T))",
        {{"time_constant_s", 100.0, 2e4, {600.0}, true}},
        {{"drift_N", Sign::kFree}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Settling>(p[0]); },
        {.counts = Counts::kTime}},
       {"wander",
        "F = sum of six cosines over the recording",
        {{"duration_s", 1.0, 1e7, {}, true, true, {.filled_by = FilledBy::kRecordingDuration}}},
        {{"c1_N", Sign::kFree},
         {"c2_N", Sign::kFree},
         {"c3_N", Sign::kFree},
         {"c4_N", Sign::kFree},
         {"c5_N", Sign::kFree},
         {"c6_N", Sign::kFree}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Wander>(p[0]); },
        {.counts = Counts::kTime}}}};
  return physics;
}

}  // namespace isorig::model::effect
