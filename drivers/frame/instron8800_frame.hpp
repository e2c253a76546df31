#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/api/clock.hpp"
#include "drivers/api/error.hpp"
#include "drivers/api/frame.hpp"
#include "drivers/config/instron8800_config.hpp"
#include "drivers/frame/instron8800_link.hpp"

namespace isorig::frame {

/// A frame behind a controller with the ASCII Q/C/P command set of Instron's 8800/FastTrack family
/// (docs/wire-8800.md).
///
/// Samples: the controller neither counts nor dates them; each is one question for the force between two for the
/// position. The force was taken between its question and its answer, less reading_age_max_ms: the sample is stamped in
/// the middle of that by the host's own clock, with half of it as its bound; the position is interpolated to that
/// moment. Questions go out in rounds that end with the link's check; a round whose check fails is thrown away whole,
/// so no force is ever taken for a position. The rate is what the line gives, and a controller that hangs leaves a gap.
///
/// Motion: an absolute ramp in position control (C2,c,3), target by C4, duration by C86, both read back before C1,1
/// starts it. Reached: within in_position_mm for in_position_ms, and not before its time unless Q1 says that it is
/// over.
///
/// Safety: the controller's watchdog is switched on by connect() and fed only when there was a heartbeat(), the
/// controller has just said that it is on (feeding would switch it on again and hide it; where it can be asked) and
/// Q909 that the computer has control (a command without it trips the actuator). Off means a fault. A loop without a
/// heartbeat is stopped here first. Control that the front panel took is not taken back but by a new connection, and is
/// given back by a connection that fails. A stop is sent again until it is confirmed, and followed by C23,0 (actuator
/// off) when it is not within stop_confirm_ms; this driver never switches the actuator on.
///
/// Blocking: poll() 20 ms and gap_us, stop() one response time-out, start_segment() two and start_confirm_ms; one
/// thread only. A stop() that repeats the last one on a line in step does not block: the rounds of poll() look after
/// it, and it leaves them alone, since on a slow line no sample would come otherwise.
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
  static constexpr std::int64_t kNever_ns = -1;

  [[nodiscard]] std::string at() const { return "frame at " + config_.where() + ": "; }
  [[nodiscard]] std::string channel(std::string_view question, int number) const;
  [[nodiscard]] double number_in(std::string_view question, const Instron8800Link::Answer& answer);
  double ask_number(std::string_view question, std::int64_t until_ns);
  [[nodiscard]] Reading reading(const Instron8800Link::Answer& answer, double value) const noexcept;
  Reading ask_position(std::int64_t until_ns);
  [[nodiscard]] std::int64_t in_ms(int milliseconds) const noexcept;
  void check_channels();
  void find_watchdog();
  void take_control();
  void give_control_back() noexcept;
  /// A command at rest, of a controller that may answer what it does not know.
  void tell_known(std::string_view command);
  [[nodiscard]] double measured_question_s();

  [[nodiscard]] std::string text_of(Ask ask) const;
  void begin_round(std::int64_t now_ns) noexcept;
  bool go_on_with_round(std::int64_t until_ns, std::span<Sample> out);
  bool take_round(std::span<Sample> out);
  bool take_position(const Reading& position, std::span<Sample> out);
  void take_condition(Ask ask, double value);
  void take_movement(bool moves);
  void follow_motion(const Reading& position) noexcept;
  void take_status(std::uint16_t word);
  void note_condition();
  void say_what_waits();
  void check_heartbeat();
  void check_stop();
  void feed_watchdog();
  void forget_round() noexcept;
  [[nodiscard]] State state() const noexcept;
  [[nodiscard]] std::string ailment() const;

  void start_now(const Segment& segment);
  void write_ramp(const Segment& segment, double from_mm, std::int64_t until_ns);
  [[noreturn]] void refuse_sign(const std::string& what) const;
  void confirm_start(std::int64_t until_ns);
  void begin_stop();
  void repeat_stop();
  /// The last stop() was a moment ago, and nothing was started since.
  [[nodiscard]] bool stop_is_fresh() const noexcept;
  [[nodiscard]] bool stands_still(std::int64_t until_ns);
  void stopped() noexcept;
  [[noreturn]] void switch_off(const std::string& why);

  const Instron8800Config config_;
  clock::Clock& clock_;
  Instron8800Link link_;
  double mm_per_raw_ = 0.0, N_per_raw_ = 0.0;
  std::uint32_t reference_epoch_ = 0;

  // What the controller says of itself, as last read.
  unsigned status_code_ = 0;
  bool actuator_on_ = true, has_control_ = true, watchdog_on_ = true;
  std::string ailment_;  // the last one reported
  // What the poll after one with a sample throws, and the state that goes with the sample: of before.
  std::optional<drivers::DeviceError> to_be_said_;
  State told_;
  std::string watchdog_command_;
  bool watchdog_can_be_asked_ = true;

  // The round of questions: what is asked, and what has been answered of it. The check comes last.
  std::vector<Ask> round_;
  std::vector<Instron8800Link::Answer> answers_;
  std::array<std::int64_t, kSideQuestions> due_ns_{};
  Reading force_, position_;
  std::uint32_t sequence_ = 0;

  // The motion.
  Motion motion_ = Motion::kIdle;
  Segment segment_;
  float echoed_target_mm_ = 0.0F, echoed_velocity_mm_s_ = 0.0F;
  std::int64_t not_before_ns_ = 0;  // the ramp's own end
  std::int64_t ramp_ns_ = 0;        // and its length
  std::int64_t in_position_since_ns_ = -1;
  int stopped_answers_ = 0;
  bool takes_sign_ = false;          // C4 took a negative target
  std::string early_;                // a ramp that was over long before its time, to be said once
  std::int64_t stop_since_ns_ = -1;  // an unconfirmed stop
  std::int64_t stop_again_ns_ = 0;
  std::int64_t stop_called_ns_ = kNever_ns;  // when the last stop() was over; kNever_ns: a start came after it
  bool moves_after_stop_ = false;
  std::string stop_unconfirmed_;  // why, as stop() last found
  Reading stop_position_;

  std::uint16_t beat_ = 0;
  bool beat_seen_ = false, beat_lost_ = false;
  std::int64_t beat_ns_ = 0;
  bool feed_wanted_ = false, watchdog_seen_on_ = false;
  Statistics statistics_;
};

}  // namespace isorig::frame
