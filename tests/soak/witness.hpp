#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "../daemon/pressure_ceiling.hpp"
#include "daemon/rig/virtual_rig.hpp"

namespace isorig::soak {

/// What the plant truly does, millisecond by millisecond, held to the bounds of docs/faults.md. It asks the daemon for
/// what it wants (set-point, segment, state) and never for what it believes.
class Witness {
 public:
  explicit Witness(const daemon::RigConfig& config);

  /// After every tick of the rig.
  void look(daemon::VirtualRig& rig);

  /// From now on a reading may be a lie (a fault of sensor, tube or valves): then *ready* may be said under pressure.
  void set_reading_lies(bool lies) noexcept { reading_lies_ = lies; }
  /// A fault strikes.
  void strike(daemon::VirtualRig& rig) noexcept;
  /// Since then, in s.
  [[nodiscard]] double trip_s() const noexcept { return since_strike(trip_ns_); }  ///< negative: none
  [[nodiscard]] double stood_s() const noexcept { return since_strike(moved_ns_); }
  [[nodiscard]] double vented_s(double rest_psi) const noexcept {
    return since_strike(rest_psi < 2.0 ? pressed_ns_ : pressed_4_ns_);
  }
  [[nodiscard]] bool moved_at_trip() const noexcept { return moved_at_trip_; }
  [[nodiscard]] double began_psi() const noexcept { return began_psi_; }
  [[nodiscard]] double began_mm_s() const noexcept { return began_mm_s_; }

  /// The greatest of the whole run.
  struct Extremes {
    double over_setpoint_psi = 0.0, pressure_psi = 0.0;
    double force_min_N = 0.0, force_max_N = 0.0;
    double off_path_mm = 0.0;  ///< beyond where the segment goes, and from where
  };
  [[nodiscard]] const Extremes& extremes() const noexcept { return extremes_; }
  /// What broke a bound: each kind once a strike, with the first numbers.
  [[nodiscard]] std::vector<std::string> take_breaches();

 private:
  void breach(const char* kind, double value, double bound);
  [[nodiscard]] double since_strike(std::int64_t ns) const noexcept {
    return ns < 0 ? -1.0 : static_cast<double>(ns - strike_ns_) * 1e-9;
  }
  void follow_segment(daemon::VirtualRig& rig, const sim::Truth& truth);

  const daemon::RigConfig& config_;
  std::int64_t now_ns_ = 0, strike_ns_ = 0, trip_ns_ = -1, moved_ns_ = 0, pressed_ns_ = 0, pressed_4_ns_ = 0;
  daemon::RunState last_state_ = daemon::RunState::kIdle;
  bool reading_lies_ = false, moved_at_trip_ = false;
  double began_psi_ = 0.0, began_mm_s_ = 0.0;
  daemon::test::PressureCeiling ceiling_;
  double low_mm_ = 0.0, high_mm_ = 0.0, over_mm_ = 0.02, target_mm_ = 0.0, speed_mm_s_ = 0.0;  // it stands at 0
  double old_low_mm_ = 0.0, old_high_mm_ = 0.0, old_over_mm_ = 0.02;
  Extremes extremes_;
  std::vector<std::string> kinds_, breaches_;
};

}  // namespace isorig::soak
