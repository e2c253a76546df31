#pragma once
#include <cstdint>
#include <limits>
#include <memory>
#include <mutex>
#include <vector>

#include "drivers/api/clock.hpp"
#include "model/actuator.hpp"
#include "sim/config.hpp"
#include "sim/frame/frame.hpp"
#include "sim/host.hpp"
#include "sim/interlock/interlock.hpp"
#include "sim/physics.hpp"
#include "sim/pressure/pressure.hpp"
#include "sim/specimen.hpp"

namespace isorig::sim {

/// What the plant really did, at the end of the last physics step.
struct Truth {
  std::int64_t mono_ns = 0;
  double position_mm = 0.0;  ///< relative to the unpressurized rest length, extension positive
  double velocity_mm_s = 0.0;
  double force_N = 0.0;       ///< tension positive
  double pressure_psi = 0.0;  ///< gauge, in the actuator
  double supply_psi = 0.0;
};

/// A pressure regulator in the plant: its valves, behind the Teensy's fill valve, which is then its supply valve.
struct RegulatorValves {
  bool present = false;
  double fill = 0.0, vent = 0.0;  ///< openings
};

struct RigOptions {
  /// Time of the first step; kNow: the clock's present time, or 0 without a clock. The rig then stands at 0
  /// mm, 0 psi, vented, relaxed.
  static constexpr std::int64_t kNow = std::numeric_limits<std::int64_t>::min();
  std::int64_t start_ns = kNow;
  /// When set, every call to a device first brings the rig up to this clock's time. Without it, advance()
  /// does.
  const clock::Clock* clock = nullptr;
  /// Devices are called from several threads (one I/O thread each): lock. Not needed in virtual time.
  bool threaded = false;
  /// Every step's truth is kept for take_truth(); somebody has to take it.
  bool keep_truth = false;
};

/// The virtual rig: actuator, pneumatics, and the three devices that stand for it. Fixed 1 ms steps; all
/// random numbers from one seed, so equal calls give equal bytes.
///
/// Order within a step: valve commands and frame supervision, crosshead, air (with the new volume), actuator
/// (with the new position and pressure), then the devices sample between the step's two ends.
class Rig final : public Host {
 public:
  static constexpr std::int64_t kStep_ns = 1'000'000;

  explicit Rig(const SimConfig& config);  ///< loads config.specimen; throws base::ConfigError
  Rig(const SimConfig& config, const Specimen& specimen, const RigOptions& options = {});
  Rig(const Rig&) = delete;
  Rig& operator=(const Rig&) = delete;

  /// Steps everything up to `now_ns` (whole steps; the rest follows with the next call). Never goes back.
  void advance(std::int64_t now_ns);

  [[nodiscard]] SimFrame& frame() noexcept { return frame_; }
  [[nodiscard]] SimPressure& pressure() noexcept { return pressure_; }
  [[nodiscard]] SimInterlock& interlock() noexcept { return interlock_; }
  [[nodiscard]] Pneumatics& pneumatics() noexcept { return pneumatics_; }
  /// Of the emulated regulator; set it under enter().
  [[nodiscard]] RegulatorValves& regulator() noexcept { return regulator_; }
  [[nodiscard]] const model::Actuator& actuator() const noexcept { return physics_.actuator(); }
  [[nodiscard]] const Specimen& specimen() const noexcept { return specimen_; }
  [[nodiscard]] Truth truth();
  /// Every step since the last call, 1 ms apart, also those that were made up for after the host had stood still.
  [[nodiscard]] std::vector<Truth> take_truth();

  Visit enter() override;

 private:
  void advance_unlocked(std::int64_t now_ns) noexcept;
  void step() noexcept;

  Specimen specimen_;
  RigOptions options_;  // start_ns resolved
  std::mutex mutex_;
  std::int64_t now_ns_;  // what the host has told us
  SpecimenPhysics physics_;
  Pneumatics pneumatics_;
  SimFrame frame_;
  SimPressure pressure_;
  SimInterlock interlock_;
  RegulatorValves regulator_;
  StepView step_;
  Truth truth_;
  std::vector<Truth> kept_;
};

}  // namespace isorig::sim
