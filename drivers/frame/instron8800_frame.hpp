#pragma once
#include <array>
#include <cstdint>
#include <string>

#include "drivers/clock/clock.hpp"
#include "drivers/frame/frame.hpp"
#include "drivers/frame/instron8800_config.hpp"
#include "drivers/frame/instron8800_link.hpp"

namespace isorig::frame {

/// A frame behind a controller with the ASCII Q/C/P command set of Instron's 8800/FastTrack family
/// (docs/wire-8800.md).
///
/// Samples: the controller neither counts nor dates them; each is one question for the force between two for the
/// position. The force was taken between its question and its answer, less reading_age_max_ms: the sample is stamped in
/// the middle of that by the host's own clock, with half of it as its bound; the position is interpolated to that
/// moment. The rate is what the line gives, and a controller that hangs leaves a gap.
///
/// Motion: an absolute ramp in position control (C2,c,3), target by C4, duration by C86, both read back before C1,1
/// starts it. Reached: within in_position_mm for in_position_ms, and not before its time.
///
/// Safety: the controller's watchdog is switched on by connect() and fed only when there was a heartbeat(), Q904 has just
/// said that it is on (feeding would switch it on again and hide it) and Q909 that the computer has control (a command
/// without it trips the actuator). Off means a fault. A loop without a heartbeat is stopped here first. Control that the front panel took is not taken
/// back but by a new connection. A stop that is not confirmed is followed by C23,0 (actuator off); this driver never
/// switches the actuator on.
///
/// Blocking, poll() at most some 20 ms also while the controller hangs; one thread only.
class Instron8800Frame final : public Device {
 public:
  Instron8800Frame(Instron8800Config config, clock::Clock& clock);

  Identity connect() override;
  void disconnect() noexcept override;
  Poll poll(std::span<Sample> out) override;
  void start_segment(const Segment& segment) override;
  void stop() override;
  void heartbeat(std::uint16_t counter) override;

  struct Statistics {
    std::uint64_t samples = 0;
    std::uint64_t actuator_off_sent = 0;
    Instron8800Link::Statistics link;
  };
  [[nodiscard]] Statistics statistics() const noexcept;

 private:
  /// One answer as a value, somewhere in the interval middle +- half.
  struct Reading {
    bool valid = false;
    double value = 0.0;
    std::int64_t middle_ns = 0;
    std::int64_t half_ns = 0;
  };
  enum class Ask : std::uint8_t { kForce, kPosition, kStatus, kActuator, kMovement, kControl, kWatchdog };
  static constexpr std::size_t kSideQuestions = 5;  // from kStatus on

  [[nodiscard]] std::string at() const { return "frame at " + config_.where() + ": "; }
  [[nodiscard]] std::string channel(std::string_view question, int number) const;
  double ask_number(std::string_view question);
  [[nodiscard]] Reading reading(const Instron8800Link::Answer& answer, double value) const noexcept;
  Reading ask_position();
  void check_channels();
  void take_control();
  [[nodiscard]] double measured_rate_hz();

  [[nodiscard]] std::string text_of(Ask ask) const;
  [[nodiscard]] Ask next_question(std::int64_t now_ns) noexcept;
  bool take_answer(Ask ask, const Instron8800Link::Answer& answer, std::span<Sample> out);
  bool take_position(const Reading& position, std::span<Sample> out);
  void follow_motion(const Reading& position) noexcept;
  void take_status(std::uint16_t word);
  void note_condition();
  void check_heartbeat();
  void feed_watchdog();
  [[nodiscard]] State state() const noexcept;
  [[nodiscard]] std::string ailment() const;

  void write_ramp(const Segment& segment, double from_mm);
  void confirm_start();
  [[nodiscard]] bool stands_still();

  const Instron8800Config config_;
  clock::Clock& clock_;
  Instron8800Link link_;
  double mm_per_raw_ = 0.0, N_per_raw_ = 0.0;

  // What the controller says of itself, as last read.
  unsigned status_code_ = 0;
  bool actuator_on_ = true, has_control_ = true, watchdog_on_ = true;
  std::string ailment_;  // the last one reported

  // The round of questions.
  Ask current_ = Ask::kForce;
  bool force_next_ = true;
  std::array<std::int64_t, kSideQuestions> due_ns_{};
  Reading force_, position_;
  std::uint32_t sequence_ = 0;

  // The motion.
  Motion motion_ = Motion::kIdle;
  Segment segment_;
  float echoed_target_mm_ = 0.0F, echoed_velocity_mm_s_ = 0.0F;
  std::int64_t not_before_ns_ = 0;  // the ramp's own end
  std::int64_t in_position_since_ns_ = -1;
  int stopped_answers_ = 0;

  std::uint16_t beat_ = 0;
  bool beat_seen_ = false, beat_lost_ = false;
  std::int64_t beat_ns_ = 0;
  bool feed_wanted_ = false, watchdog_seen_on_ = false;
  Statistics statistics_;
};

/// What bits 9 to 12 of the status word (Q22) say; nullptr when all is well. As ISIS' EPICS support reads them.
[[nodiscard]] const char* describe_instron8800_status(unsigned code) noexcept;

}  // namespace isorig::frame
