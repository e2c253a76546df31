#pragma once
#include <algorithm>
#include <array>
#include <cstdint>

#include "daemon/core/pressure_loop.hpp"
#include "drivers/api/pressure.hpp"

namespace isorig::daemon {

/// Why the reading is not believed: numbers, and what to do.
struct PressureDoubt {
  const char* code = nullptr;
  const char* what = "";
  double value = 0.0;
  double threshold = 0.0;

  explicit operator bool() const noexcept { return code != nullptr; }
};

/// Compares the sensor's reading with the valve commands: a reading that does not follow the valves must not be used
/// for filling. (3D printers have the same for their heaters: Klipper's verify_heater.) It judges in every state, also
/// while the chamber is sealed or vented; the caller of doubt() goes to the safe state.
///
/// From the commands and the ISO 6358 flows of daemon/core/valve_flow.hpp it keeps bounds on the rate of a sound rig:
///
///   low  =  r (fill - d) F  -  vent V / r  -  leak  -  thermal  -  motion
///   high =  fill F / r  -  r (vent - d) V  +  leak  +  thermal  +  motion
///
/// with F and V the full-duty rates at the present reading; r = `response_min`, the part of the configured gain that
/// has to be there, either way (a chamber three times as large, or as small); d the dead part of a duty; `leak` the
/// fastest loss that is no fault; `motion` the change by the crosshead. `thermal` is what the air's temperature may
/// still do after a fast filling or venting: a fifth of the last second's change, in a second.
///
/// Where between command and reading a change takes effect is not known to better than `kDelayNs` (queues, wire, PWM
/// period, valve, sensor). So of the commands in force within that time before a sample `low` takes the least filling
/// and the most venting, `high` the contrary, and no delay is ever mistaken for a fault.
///
/// What the reading falls short of `low`, or exceeds `high` by, is added up (a CUSUM: Page 1954) and must stay below
/// `allowance_psi`. With the shipped gains a full fill that does not show trips after 0.18 s.
///
/// Three further sums need no bound on the gains:
///  - a hold that goes on taking more air than `leak`, in or out, while the reading stands: the chamber leaks, or the
///    reading is stuck. The chamber's volume depends on the crosshead's place and not on its way there, so over any
///    time the motion explains at most motion_max_psi_per_mm times the displacement; a stroke out and back explains
///    nothing;
///  - the time of the fill valve, as full-duty seconds above `leak`: more than three fillings from empty to the limit
///    without venting between is no filling;
///  - the change expected since the sensor's count last changed, for messages::ElvhMonitor.
///
/// It cannot see a sensor that reads a constant part too little from the start, nor a reading that stands exactly at
/// the set-point while less than `leak` flows in. docs/states.md says what limits these two.
///
/// Pure: no clock, no I/O, no allocation.
class PressureGuard {
 public:
  PressureGuard(const PressureLoopConfig& loop, double pressure_max_psi) noexcept;

  /// The command handed to the device, once a tick.
  void on_command(std::int64_t mono_ns, const pressure::Command& command) noexcept;
  /// A valid, fresh reading. `is_holding`: the loop has it where it wants it.
  void on_reading(std::int64_t mono_ns, double pressure_psi, double crosshead_velocity_mm_s, bool is_holding) noexcept;
  /// Sets all sums to zero: the device was away, or an operator has reset. Readings from before `judged_from_ns` are
  /// not judged: nobody knows what the device did with its valves then.
  void restart(std::int64_t judged_from_ns = -1) noexcept;

  /// The first doubt since restart(); it stays.
  [[nodiscard]] const PressureDoubt& doubt() const noexcept { return doubt_; }
  /// The least change that the reading must show now; 0 when it may stand still. For the monitor of a stuck count.
  [[nodiscard]] double sure_rate_psi_s() const noexcept { return sure_rate_psi_s_; }

  /// Bounds in force, for status, tests and the device's own limits.
  [[nodiscard]] double leak_psi_s() const noexcept { return leak_psi_s_; }
  [[nodiscard]] double fill_time_max_s() const noexcept { return fill_time_max_s_; }
  [[nodiscard]] double dead_duty() const noexcept { return dead_duty_; }

  static constexpr std::int64_t kDelayNs = 100'000'000;

 private:
  struct Duties {
    std::uint16_t fill_min = 0, fill_max = 0, vent_min = 0, vent_max = 0;
    void take(const Duties& other) noexcept {
      fill_min = std::min(fill_min, other.fill_min);
      fill_max = std::max(fill_max, other.fill_max);
      vent_min = std::min(vent_min, other.vent_min);
      vent_max = std::max(vent_max, other.vent_max);
    }
  };
  static constexpr std::int64_t kSlotNs = 4'000'000;
  static constexpr std::int64_t kSlots = 256;  // a second: how late a reading may come in

  [[nodiscard]] Duties duties_before(std::int64_t mono_ns) noexcept;
  void raise(const char* code, const char* what, double value, double threshold) noexcept;
  void judge_hold(double fed_psi_s, double drained_psi_s, double thermal_psi_s, double change_psi, double dt_s,
                  bool is_holding) noexcept;
  void judge_fill_time(const Duties& duties, double dt_s) noexcept;

  PressureLoopConfig config_;
  double dead_duty_, leak_psi_s_, motion_psi_mm_, free_duty_, fill_time_max_s_;

  std::array<Duties, kSlots> slots_{};
  std::int64_t newest_slot_ = -1;
  Duties newest_;                            // the last command alone
  Duties taken_;                             // of the slots from split_ to taken_last_
  std::array<Duties, kSlots> taken_from_{};  // of the slots from its own to the one before split_
  std::int64_t split_ = -1, taken_first_ = -1, taken_last_ = -1;

  std::int64_t judged_from_ns_ = -1;
  std::int64_t last_ns_ = -1;
  double last_psi_ = 0.0;
  double slow_psi_ = 0.0;  // a second behind
  double short_psi_ = 0.0, over_psi_ = 0.0;
  double fed_in_vain_psi_ = 0.0, drained_in_vain_psi_ = 0.0;
  double displacement_mm_ = 0.0;                      // of the crosshead, as commanded
  double fed_from_mm_ = 0.0, drained_from_mm_ = 0.0;  // where it was when the sum was 0 last
  double hold_s_ = 0.0;
  double fill_used_s_ = 0.0;
  double sure_rate_psi_s_ = 0.0;
  PressureDoubt doubt_;
};

}  // namespace isorig::daemon
