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
  static constexpr std::size_t kCount = 8;
  [[nodiscard]] static double time_s(std::size_t arm, double shortest_s, double decades) noexcept {
    return shortest_s * std::pow(10.0, decades * static_cast<double>(arm) / (kCount - 1));
  }

  Spectrum(double shortest_s, double decades) noexcept {
    for (std::size_t i = 0; i < kCount; ++i) arms_[i] = MaxwellState(time_s(i, shortest_s, decades));
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
  std::array<MaxwellState, kCount> arms_{MaxwellState(1), MaxwellState(1), MaxwellState(1), MaxwellState(1),
                                         MaxwellState(1), MaxwellState(1), MaxwellState(1), MaxwellState(1)};
};

std::vector<double> times_of_arms_s(std::span<const double> parameters) {
  return {parameters.begin(), parameters.end()};
}

std::vector<double> times_of_spectrum_s(std::span<const double> parameters) {
  std::vector<double> out;
  for (std::size_t i = 0; i < Spectrum::kCount; ++i) out.push_back(Spectrum::time_s(i, parameters[0], parameters[1]));
  return out;
}

constexpr NumberSheet kTime{
    .what = "Time constant of an added Maxwell arm: in a hold its force falls to 1/e in that time.",
    .unit = "s",
    .range =
        "Instrument: 5 ms is five intervals at 1 kHz, below which an arm is a dashpot; 2e4 s, more than five hours, is "
        "beyond every hold and the arm is a spring.",
    .errors =
        "A hold shorter than it cannot separate it from the stiffness. A short one is mistaken for force_lag, a long "
        "one for "
        "friction or zero_drift."};
constexpr NumberSheet kStiffnessSheet{
    .what = "Stiffness of the arms: the force per mm that a step adds at once and that a hold takes away.",
    .unit = "N/mm",
    .range = "Physics: a spring pushes back, so it is not negative; no upper bound.",
    .errors =
        "Where the fastest ramp lasts longer than the time constant only their product is seen, a viscosity. Mistaken "
        "for the parallel spring where the hold is short."};

}  // namespace

const Physics& second_relaxation() {
  static const Physics physics{
      "second_relaxation",
      Stage::kSpecimen,
      "A further relaxation time, or a spectrum of them.",
      "Wiechert 1893 (generalised Maxwell); box spectrum after Fung 1972 (quasi-linear viscoelasticity).",
      "A hold ten times as long as the slowest time constant; ramps over three decades of velocity. A fast "
      "arm is "
      "mistaken for a lag of the force channel, a slow one for friction or drift.",
      {{"arm",
        "F = k z, dz/dt = v - z / tau",
        {{.name = "time_constant_s",
          .symbol = "tau",
          .lower = 5e-3,
          .upper = 2e4,
          .starts = {0.1, 2.0, 20.0, 200.0},
          .logarithmic = true,
          .traits = {.lower_limit_law = "a dashpot", .upper_limit_law = "a spring"},
          .sheet = kTime}},
        {{.name = "stiffness_N_mm", .symbol = "k", .sign = Sign::kNonNegative, .sheet = kStiffnessSheet}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Arm>(p[0]); },
        {.relaxation_times_s = times_of_arms_s}},
       {"two_arms",
        "F = k z + k' z', dz/dt = v - z / tau, dz'/dt = v - z' / tau'",
        {{.name = "time_constant_s",
          .symbol = "tau",
          .lower = 5e-3,
          .upper = 2e4,
          .starts = {0.2},
          .logarithmic = true,
          .traits = {.lower_limit_law = "a dashpot", .upper_limit_law = "a spring"},
          .sheet = kTime},
         {.name = "slow_time_constant_s",
          .symbol = "tau'",
          .lower = 5e-3,
          .upper = 2e4,
          .starts = {30.0},
          .logarithmic = true,
          .traits = {.lower_limit_law = "a dashpot", .upper_limit_law = "a spring"},
          .sheet = kTime}},
        {{.name = "stiffness_N_mm", .symbol = "k", .sign = Sign::kNonNegative, .sheet = kStiffnessSheet},
         {.name = "slow_stiffness_N_mm", .symbol = "k'", .sign = Sign::kNonNegative, .sheet = kStiffnessSheet}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<TwoArms>(p[0], p[1]); },
        {.relaxation_times_s = times_of_arms_s}},
       {"spectrum",
        "F = k mean of arms, their times even in log over N decades from tau0",
        {{.name = "shortest_time_s",
          .symbol = "tau0",
          .lower = 5e-3,
          .upper = 1e3,
          .starts = {0.1},
          .logarithmic = true,
          .sheet = {.what = "Shortest relaxation time of the spectrum.",
                    .unit = "s",
                    .range = "Instrument: 5 ms is five intervals at 1 kHz, below which an arm is a dashpot; beyond "
                             "1000 s no hold shows a spectrum.",
                    .errors =
                        "Ramps slower than it leave it undetermined. Mistaken for the one time constant of an arm."}},
         {.name = "decades",
          .symbol = "N",
          .lower = 0.5,
          .upper = 5.0,
          .starts = {3.0},
          .sheet = {.what = "How many decades of time the spectrum spans from its shortest time.",
                    .unit = "1",
                    .range = "Numerics: the law has eight arms, over more than 5 decades fewer than two a decade, "
                             "whose steps show; less than half a decade is a single arm.",
                    .errors = "A hold that ends before the slowest time shortens it. Mistaken for two arms."}}},
        {{.name = "stiffness_N_mm", .symbol = "k", .sign = Sign::kNonNegative, .sheet = kStiffnessSheet}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Spectrum>(p[0], p[1]); },
        {.relaxation_times_s = times_of_spectrum_s}}},
      // What has no elastic part has nothing that could relax.
      {.needs_any_of = {"spring", "maxwell"},
       .repeatable = true,
       .acts_on = "arm",
       .depends_on = {"hold", "rate"},
       .shape_of = ShapeOf::kStep,
       .words = "a second relaxation"}};
  return physics;
}

}  // namespace isorig::model::effect
