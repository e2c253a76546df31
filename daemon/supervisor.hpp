#pragma once
#include <array>
#include <cstdint>

#include "daemon/records.hpp"
#include "drivers/frame/frame.hpp"
#include "drivers/interlock/interlock.hpp"
#include "protocol/limits.hpp"

namespace isorig::base {
class TomlTable;
}

namespace isorig::daemon {

/// What may not happen while the rig is live, beyond the travel, force and pressure limits of [limits].
struct SupervisorConfig {
  protocol::Limits limits;
  double frame_age_max_s = 0.25;      ///< no frame sample for longer: safe state
  double pressure_age_max_s = 0.25;   ///< no valid pressure reading for longer: safe state
  double regulator_age_max_s = 0.0;   ///< no word from the pressure regulator for longer: safe state; 0: there is none
  double regulator_error_max_psi = 1.0;  ///< its own sensor against the ELVH for longer than a second: safe state
  double interlock_age_max_s = 0.5;   ///< no interlock reading for longer: safe state
  double late_tick_max_s = 0.25;      ///< a tick later than this: program stop
  double following_error_max_mm = 1.0;  ///< position against the commanded segment: program stop
  double segment_ack_max_s = 0.5;     ///< a segment the frame does not echo within this: program stop
  double force_rate_window_s = 0.02;  ///< the force rate is the difference over this window
  double frozen_force_max_s = 1.0;    ///< the very same raw force for longer while the crosshead moves: program stop

  /// Reads [supervisor]; `limits` come from [limits].
  static SupervisorConfig read(const base::TomlTable& table, const protocol::Limits& limits);
};

/// A limit that was broken: which one, what was measured, what it was compared with.
struct Trip {
  Severity severity = Severity::kInfo;  ///< kProgramStop or kSafeState; kInfo: nothing happened
  const char* code = "";                ///< stable, e.g. "limit.force"
  const char* what = "";                ///< for people, with what to do
  double value = 0.0;
  double threshold = 0.0;
  [[nodiscard]] explicit operator bool() const noexcept { return severity != Severity::kInfo; }
};

/// Watches the streams. Pure: it is told what arrived and when, and answers with the worst trip; it moves nothing
/// itself. noexcept, no allocation.
class Supervisor {
 public:
  explicit Supervisor(const SupervisorConfig& config) noexcept;

  void on_frame_sample(const FrameRecord& sample) noexcept;
  void on_frame_report(const frame::State& state) noexcept;
  /// `valid`: the word decoded to a plausible current reading.
  void on_pressure_sample(std::int64_t mono_ns, double pressure_psi, bool valid) noexcept;
  /// The sensor sends fresh conversions, and has sent one and the same count for longer than noise can explain.
  void on_pressure_stuck() noexcept;
  /// A regulator's word, and what the ELVH says at that time.
  void on_regulator(std::int64_t mono_ns, double pressure_psi, double elvh_psi, bool faulty) noexcept;
  /// The pressure device's own watchdog opened the vent: it missed our heartbeat.
  void on_device_vented() noexcept;
  void on_interlock(const interlock::State& state) noexcept;
  void on_tick_lateness(std::int64_t now_ns, std::int64_t late_ns) noexcept;
  /// The segment that was commanded, for the check that the frame does it.
  void on_segment(const frame::Segment& segment, double from_mm, std::int64_t mono_ns) noexcept;
  void on_stop() noexcept;

  /// Age of the newest sample of each, in s; negative before the first.
  [[nodiscard]] double frame_age_s(std::int64_t now_ns) const noexcept;
  [[nodiscard]] double pressure_age_s(std::int64_t now_ns) const noexcept;

  /// The worst thing since the last call, and what is stale now.
  [[nodiscard]] Trip check(std::int64_t now_ns) noexcept;

  /// Every stream fresh, the chain closed, the frame without fault. `why` says what is missing, in plain words.
  [[nodiscard]] bool healthy(std::int64_t now_ns, const char** why) const noexcept;

  /// Forgets what was seen (after a reset): ages start again at `now_ns`.
  void rearm(std::int64_t now_ns) noexcept;

 private:
  void note(Trip trip) noexcept;

  static constexpr std::size_t kForceHistory = 64;

  SupervisorConfig config_;
  Trip worst_;
  std::int64_t frame_seen_ns_ = -1;
  std::int64_t pressure_seen_ns_ = -1;
  std::int64_t interlock_seen_ns_ = -1;
  std::int64_t regulator_seen_ns_ = -1;
  std::int64_t disagree_since_ns_ = -1;
  interlock::State interlock_;
  frame::State frame_state_;
  bool frame_state_known_ = false;

  struct ForceSample {
    std::int64_t mono_ns = 0;
    double force_N = 0.0;
  };
  std::array<ForceSample, kForceHistory> force_history_{};
  std::size_t force_count_ = 0;
  float same_force_N_ = 0.0F;
  std::int64_t same_force_since_ns_ = -1;
  std::int64_t excused_until_ns_ = 0;   ///< after a late tick the streams get time to come in

  bool segment_active_ = false;
  bool segment_acknowledged_ = false;
  bool segment_moving_ = false;         ///< the frame says so
  frame::Segment segment_;
  double segment_from_mm_ = 0.0;
  std::int64_t segment_start_ns_ = 0;
};

}  // namespace isorig::daemon
