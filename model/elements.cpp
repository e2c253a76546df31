#include "model/elements.hpp"

#include <cmath>

#include "model/stepping.hpp"

namespace isorig::model::element {
namespace {

/// Force that follows the instant alone.
class Memoryless : public Process {
 public:
  using Function = double (*)(const Instant&);
  explicit Memoryless(Function function) noexcept : function_(function) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override { columns[0] = function_(now); }

 private:
  Function function_;
};

class Maxwell : public Process {
 public:
  explicit Maxwell(double time_constant_s) noexcept : state_(time_constant_s) {}
  void reset(const Instant&) noexcept override { state_.reset(); }
  void force(const Instant& now, double* columns) noexcept override { columns[0] = state_.step(now.step_mm, now.dt_s); }

 private:
  MaxwellState state_;
};

class ArmStart : public Process {
 public:
  ArmStart(double time_constant_s, double start_s, bool here) noexcept
      : tau_s_(time_constant_s), start_s_(start_s), here_(here) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = here_ && now.t_s >= start_s_ ? std::exp(-(now.t_s - start_s_) / tau_s_) : 0.0;
  }

 private:
  double tau_s_;
  double start_s_;
  bool here_;
};

class ForceZero : public Process {
 public:
  explicit ForceZero(double share) noexcept : share_(share) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant&, double* columns) noexcept override { columns[0] = share_; }

 private:
  double share_;
};

class Gravity : public Process {
 public:
  explicit Gravity(double length_mm) noexcept : length_mm_(length_mm) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = std::sin(now.position_mm / length_mm_);
  }

 private:
  double length_mm_;
};

Law memoryless(std::string_view name, std::string_view formula, Coefficient coefficient,
               Memoryless::Function function) {
  return {name, formula, {}, {coefficient}, [function](auto, const Reference&) {
            return std::make_unique<Memoryless>(function);
          }};
}

constexpr std::string_view kNotNegative = "Physics: it is not negative.";

constexpr NumberSheet kStiffness{
    "Force per elongation when everything has relaxed.", "N/mm", "Physics: a passive spring pushes back.",
    "Friction and a relaxation slower than the recording stand in it. A spring of the load train in series lowers it."};
constexpr NumberSheet kTimeConstant{"Time in which the arm's force falls to 1/e in a hold.", "s",
                                    "Numerics: far beyond what any hold or stroke of a recording shows, on both sides.",
                                    "A second relaxation, friction or a lag beside it shifts it towards its own time."};
constexpr NumberSheet kArmStiffness{"Force per elongation of the arm's spring, before anything has relaxed.", "N/mm",
                                    "Physics: a passive spring pushes back.",
                                    "A time constant outside of what was recorded leaves it undetermined."};
constexpr NumberSheet kArmForce{"Force that the arm holds at its start.", "N",
                                "Physics: stretched or compressed, so it has no sign.",
                                "It belongs to its recording, and takes up whatever settles there."};
constexpr NumberSheet kViscosity{"Force per velocity.", "N s/mm", kNotNegative,
                                 "Dry friction where all strokes have one speed."};
constexpr NumberSheet kMass{"Mass that moves with the position.", "kg", kNotNegative,
                            "Accelerations from noisy positions make it small."};
constexpr NumberSheet kTare{"Force where the model has none.", "N", "Physics: a tare may have either sign.",
                            "A friction that has one direction, a drift."};
constexpr NumberSheet kForceZero{"The force's zero in this recording, less that of the recordings without one.", "N",
                                 "Physics: a tare may have either sign.",
                                 "It takes up whatever the recordings differ by on average."};
constexpr NumberSheet kWeight{"Weight of the pendulum.", "N", kNotNegative, "A spring beside it."};

}  // namespace

const Physics& spring() {
  static const Physics physics{
      "spring",
      Stage::kSpecimen,
      "Linear spring, slack-free, unstretched at the pressurized rest length.",
      "Paper, eq. for the system force, k1; stiffness per mm = k1 / pressurized rest length.",
      "Slow triangle.",
      {memoryless("linear", "F = k e", {.name = "stiffness_N_mm", .sign = Sign::kNonNegative, .sheet = kStiffness},
                  [](const Instant& now) { return now.elongation_mm; })}};
  return physics;
}

const Physics& maxwell() {
  static const Physics physics{
      "maxwell",
      Stage::kSpecimen,
      "Spring and dashpot in series: the viscous arm of a standard linear solid.",
      "Paper, eqs. for the system force and the strain rate of k2; time constant = eta / k2 = 1 / gamma.",
      "Ramps of different velocity; relaxation in a hold.",
      {{"linear",
        "F = k z, dz/dt = v - z / tau",
        {{.name = "time_constant_s",
          .lower = 1e-3,
          .upper = 1e5,
          .starts = {0.3, 3.0},
          .logarithmic = true,
          .sheet = kTimeConstant}},
        {{.name = "stiffness_N_mm", .sign = Sign::kNonNegative, .sheet = kArmStiffness}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Maxwell>(p[0]); }}},
      {.words = "Maxwell arm"}};
  return physics;
}

const Physics& arm_start() {
  static const Physics physics{
      "arm_start",
      Stage::kSpecimen,
      "Force that a Maxwell arm holds when the rows of one recording begin, or begin again after a gap.",
      "Solution of dz/dt = v - z / tau for z(t0) not 0; it adds to that of an arm at rest.",
      "None: it is a state, not a property.",
      {{"relaxing",
        "F = F0 exp(-(t - t0) / tau) for t >= t0, tau that of the arm",
        {{.name = "time_constant_s", .lower = 1e-3, .upper = 1e5, .starts = {1.0}, .fixed = true},
         {.name = "arm", .lower = 1.0, .upper = 9.0, .starts = {1.0}, .fixed = true},  // counted in the order of the
                                                                                       // file
         {.name = "recording_id",
          .lower = 0.0,
          .upper = kLargestRecordingId,
          .starts = {0.0},
          .fixed = true},  // 0: every one
         {.name = "start_s", .lower = -1e9, .upper = 1e9, .starts = {0.0}, .fixed = true}},
        {{.name = "force_N", .sign = Sign::kFree, .sheet = kArmForce}},
        [](std::span<const double> p, const Reference& reference) {
          return std::make_unique<ArmStart>(p[0], p[3], p[2] == 0.0 || p[2] == reference.recording_id);
        }}},
      {.words = "state of the arm at the start"}};
  return physics;
}

const Physics& dashpot() {
  static const Physics physics{
      "dashpot",
      Stage::kSpecimen,
      "Linear dashpot in parallel.",
      "Newton.",
      "Ramps of different velocity.",
      {memoryless("linear", "F = c v", {.name = "viscosity_N_s_mm", .sign = Sign::kNonNegative, .sheet = kViscosity},
                  [](const Instant& now) { return now.velocity_mm_s; })}};
  return physics;
}

const Physics& mass() {
  static const Physics physics{
      "mass",
      Stage::kRig,
      "Mass that moves with the position.",
      "Newton.",
      "Fast reversals.",
      {memoryless("linear", "F = m a", {.name = "mass_kg", .sign = Sign::kNonNegative, .sheet = kMass},
                  [](const Instant& now) { return now.acceleration_mm_s2 * 1e-3; })}};
  return physics;
}

const Physics& constant() {
  static const Physics physics{"constant",
                               Stage::kSensor,
                               "Constant force: a tare that is not zero, a dead weight.",
                               "None needed.",
                               "Any rest.",
                               {memoryless("linear", "F = F0", {.name = "force_N", .sign = Sign::kFree, .sheet = kTare},
                                           [](const Instant&) { return 1.0; })},
                               {.words = "force tare"}};
  return physics;
}

const Physics& force_zero() {
  static const Physics physics{
      "force_zero",
      Stage::kSensor,
      "Force by which the zero of one recording differs from that of the others.",
      "None needed.",
      "None: it is a state, not a property.",
      {{"recording",
        "F = F0 in its recording, 0 in the other n - 1 of the fit, F0 / n in any other",
        {{.name = "recording_id", .lower = 0.0, .upper = kLargestRecordingId, .starts = {0.0}, .fixed = true}},
        {{.name = "force_N", .sign = Sign::kFree, .sheet = kForceZero}},
        [](std::span<const double> p, const Reference& reference) {
          return std::make_unique<ForceZero>(p[0] == 0.0 || p[0] == reference.recording_id ? 1.0 : 0.0);
        }}},
      {.words = "force zero of a recording"}};
  return physics;
}

std::unique_ptr<Process> force_zero_elsewhere(std::size_t recordings) {
  return std::make_unique<ForceZero>(1.0 / static_cast<double>(recordings));
}

const Physics& gravity() {
  static const Physics physics{
      "gravity",
      Stage::kSpecimen,
      "Weight of a pendulum whose position is arc length.",
      "Newton.",
      "Free swings.",
      {{"pendulum",
        "F = W sin(x / length)",
        {{.name = "length_mm", .lower = 1e-3, .upper = 1e6, .starts = {1000.0}, .logarithmic = true, .fixed = true}},
        {{.name = "weight_N", .sign = Sign::kNonNegative, .sheet = kWeight}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Gravity>(p[0]); }}}};
  return physics;
}

}  // namespace isorig::model::element
