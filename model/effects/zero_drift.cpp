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

constexpr NumberSheet kCosine{
    .what =
        "Amplitude of the cosine with as many half periods over the recording as its name says; the sign is that at "
        "its start.",
    .unit = "N",
    .range = "Physics: temperature may rise or fall, so it has no sign.",
    .errors =
        "What is periodic in the protocol over the whole recording leaks into it. Mistaken for cyclic_softening or a "
        "slow relaxation."};

}  // namespace

const Physics& zero_drift() {
  static const Physics physics{
      "zero_drift",
      Stage::kSensor,
      "Slow drift of the force zero.",
      "Temperature of the load cell and its amplifier (OIML R 60:2017).",
      "A dead weight, or no specimen, for an hour. Mistaken for creep and for softening, which stop with the "
      "motion.",
      {{"linear",
        "F = r t",
        {},
        {{.name = "rate_N_h",
          .symbol = "r",
          .sign = Sign::kFree,
          .sheet = {.what = "Change of the force zero per hour; positive: the reading rises.",
                    .unit = "N/h",
                    .range = "Physics: temperature may rise or fall, so it has no sign.",
                    .errors =
                        "Softening and slow relaxation look like it while the motion goes on. Mistaken for creep."}}},
        [](auto, const Reference&) { return std::make_unique<Linear>(); },
        {.counts = Counts::kTime}},
       {"settling",
        "F = D (1 - exp(-t / T))",
        {{.name = "time_constant_s",
          .symbol = "T",
          .lower = 100.0,
          .upper = 2e4,
          .starts = {600.0},
          .logarithmic = true,
          .sheet = {.what = "Time in which the zero has made 63 % of its way to its new value.",
                    .unit = "s",
                    .range = "Physics: a load cell and its amplifier warm up in minutes to hours; below 100 s it "
                             "cannot be told from a relaxation, beyond 2e4 s from a straight drift.",
                    .errors =
                        "A record shorter than it cannot separate it from the drift. Mistaken for the time constant of "
                        "a slow arm."}}},
        {{.name = "drift_N",
          .symbol = "D",
          .sign = Sign::kFree,
          .sheet = {.what = "Change of the force zero in the end; positive: the reading rises.",
                    .unit = "N",
                    .range = "Physics: temperature may rise or fall, so it has no sign.",
                    .errors = "A record shorter than the time constant cannot separate it from it. Mistaken for "
                              "cyclic_softening."}}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Settling>(p[0]); },
        {.counts = Counts::kTime}},
       {"wander",
        "F = c1 cos(pi t / T) + c2 cos(2 pi t / T) + c3 cos(3 pi t / T) + c4 cos(4 pi t / T) + c5 cos(5 pi t / T) + c6 "
        "cos(6 pi t / T)",
        {{.name = "duration_s",
          .symbol = "T",
          .lower = 1e-6,
          .upper = 1e7,
          .logarithmic = true,
          .fixed = true,
          .traits = {.filled_by = FilledBy::kRecordingDuration},
          .sheet = {.what = "Duration of the recording, which the cosines divide.",
                    .unit = "s",
                    .range = "Numerics: any recording of up to four months; it is filled in, and not searched.",
                    .errors =
                        "Filled in from the recording; with the duration of another one the shape is stretched."}}},
        {{.name = "c1_N", .symbol = "c1", .sign = Sign::kFree, .sheet = kCosine},
         {.name = "c2_N", .symbol = "c2", .sign = Sign::kFree, .sheet = kCosine},
         {.name = "c3_N", .symbol = "c3", .sign = Sign::kFree, .sheet = kCosine},
         {.name = "c4_N", .symbol = "c4", .sign = Sign::kFree, .sheet = kCosine},
         {.name = "c5_N", .symbol = "c5", .sign = Sign::kFree, .sheet = kCosine},
         {.name = "c6_N", .symbol = "c6", .sign = Sign::kFree, .sheet = kCosine}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Wander>(p[0]); },
        {.counts = Counts::kTime}}},
      {.acts_on = "force channel",
       .depends_on = {"time"},
       .shape_of = ShapeOf::kTime,
       .words = "drift of the force's zero"}};
  return physics;
}

}  // namespace isorig::model::effect
