#include <array>
#include <cmath>

#include "model/effects/effects.hpp"
#include "model/stepping.hpp"

namespace isorig::model::effect {
namespace {

class Arm : public Process {
 public:
  explicit Arm(double time_constant_s) noexcept : state_(time_constant_s) {}
  void reset(const Instant&) noexcept override { state_.reset(); }
  void force(const Instant& now, double* columns) noexcept override { columns[0] = state_.step(now.step_mm, now.dt_s); }

 private:
  MaxwellState state_;
};

class TwoArms : public Process {
 public:
  TwoArms(double fast_s, double slow_s) noexcept : fast_(fast_s), slow_(slow_s) {}
  void reset(const Instant&) noexcept override {
    fast_.reset();
    slow_.reset();
  }
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = fast_.step(now.step_mm, now.dt_s);
    columns[1] = slow_.step(now.step_mm, now.dt_s);
  }

 private:
  MaxwellState fast_;
  MaxwellState slow_;
};

/// A box of relaxation times, even in log tau: about three arms per decade keep its ripple below 1 %.
class Spectrum : public Process {
 public:
  Spectrum(double shortest_s, double decades) noexcept {
    for (std::size_t i = 0; i < kCount; ++i) {
      const double at = decades * static_cast<double>(i) / (kCount - 1);
      arms_[i] = MaxwellState(shortest_s * std::pow(10.0, at));
    }
  }
  void reset(const Instant&) noexcept override {
    for (MaxwellState& arm : arms_) arm.reset();
  }
  void force(const Instant& now, double* columns) noexcept override {
    double sum = 0.0;
    for (MaxwellState& arm : arms_) sum += arm.step(now.step_mm, now.dt_s);
    columns[0] = sum / kCount;
  }

 private:
  static constexpr std::size_t kCount = 8;
  std::array<MaxwellState, kCount> arms_{MaxwellState(1), MaxwellState(1), MaxwellState(1), MaxwellState(1),
                                         MaxwellState(1), MaxwellState(1), MaxwellState(1), MaxwellState(1)};
};

}  // namespace

const Physics& second_relaxation() {
  static const Physics physics{
      "second_relaxation",
      Stage::kSpecimen,
      "A further relaxation time, or a spectrum of them.",
      "Wiechert / generalised Maxwell; box spectrum after Fung's quasi-linear viscoelasticity.",
      "A hold ten times as long as the slowest time constant; ramps over three decades of velocity. A fast "
      "arm is "
      "mistaken for a lag of the force channel, a slow one for friction or drift.",
      {{"arm",
        "F = k z, dz/dt = v - z / tau",
        {{"time_constant_s",
          5e-3,
          2e4,
          {0.1, 2.0, 20.0, 200.0},
          true,
          false,
          {.lower_limit_law = "a dashpot", .upper_limit_law = "a spring"}}},
        {{"stiffness_N_mm", Sign::kNonNegative}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Arm>(p[0]); }},
       {"two_arms",
        "F = k z + k' z', each as an arm",
        {{"time_constant_s",
          5e-3,
          2e4,
          {0.2},
          true,
          false,
          {.lower_limit_law = "a dashpot", .upper_limit_law = "a spring"}},
         {"slow_time_constant_s",
          5e-3,
          2e4,
          {30.0},
          true,
          false,
          {.lower_limit_law = "a dashpot", .upper_limit_law = "a spring"}}},
        {{"stiffness_N_mm", Sign::kNonNegative}, {"slow_stiffness_N_mm", Sign::kNonNegative}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<TwoArms>(p[0], p[1]); }},
       {"spectrum",
        "F = k mean of arms, tau even in log from tau0 over `decades`",
        {{"shortest_time_s", 5e-3, 1e3, {0.1}, true}, {"decades", 0.5, 5.0, {3.0}}},
        {{"stiffness_N_mm", Sign::kNonNegative}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Spectrum>(p[0], p[1]); }}},
      // What has no elastic part has nothing that could relax.
      {.needs_any_of = {"spring", "maxwell"}, .repeatable = true}};
  return physics;
}

}  // namespace isorig::model::effect
