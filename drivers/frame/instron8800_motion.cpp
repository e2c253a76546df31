#include <algorithm>
#include <cmath>

#include "base/formatted.hpp"
#include "drivers/api/error.hpp"
#include "drivers/frame/instron8800_frame.hpp"
#include "drivers/frame/instron8800_words.hpp"

namespace isorig::frame {

using drivers::DeviceError;
using drivers::Fault;

namespace {

constexpr double kShortestRamp_s = 0.001;
constexpr double kTargetTolerance_mm = 5e-4;  // half of what the supervisor takes for another target
/// A stop() this soon after the last one repeats it: polls that block for a round's question lie between the two.
constexpr std::int64_t kStopRepeated_ns = 500 * kMs;
constexpr double kTimeTolerance = 5e-4;  // likewise, of the velocity

/// Without an exponent, which the command set may not know.
std::string fixed(double value, int decimals) {
  return base::formatted("%.*f", decimals, value);
}

}  // namespace

void Instron8800Frame::refuse_sign(const std::string& what) const {
  throw DeviceError(Fault::kRefused,
                    at() + what +
                        ": this controller takes no target below the zero of its position channel; nothing was "
                        "started. Move that zero, at the panel, below the lowest position of the protocol");
}

void Instron8800Frame::write_ramp(const Segment& segment, double from_mm, std::int64_t until_ns) {
  const double length_mm = std::abs(double{segment.target_mm} - from_mm);
  const double duration_s = std::max(length_mm / double{segment.velocity_mm_s}, kShortestRamp_s);
  const double raw = double{segment.target_mm} / mm_per_raw_;
  if (!(std::abs(raw) <= 1.0)) {
    throw DeviceError(Fault::kRefused, at() + "a target of " + fixed(double{segment.target_mm}, 4) +
                                           " mm is outside the channel's full scale of " + fixed(mm_per_raw_, 4) +
                                           " mm");
  }
  const auto target = channel("4", config_.position_channel), time = channel("86", config_.position_channel);
  const auto set_target = "C" + target + "," + fixed(raw, 9);
  // Some take no sign. Heard before it is asked for: its complaint would be taken for the next answer.
  if (raw < 0.0 && !takes_sign_) {
    if (const auto line = link_.tell_and_listen(set_target, until_ns))
      refuse_sign("\"" + set_target + "\" was answered by \"" + line->substr(0, 60) + "\"");
  } else {
    link_.tell(set_target);
  }
  link_.tell("C" + time + "," + fixed(duration_s, 6));
  const auto target_question = "Q" + target, time_question = "Q" + time;
  const auto answers = link_.ask({target_question, time_question}, until_ns);
  const double target_back_mm = number_in(target_question, answers[0]) * mm_per_raw_;
  const double duration_back_s = number_in(time_question, answers[1]);
  const bool same_target = std::abs(target_back_mm - double{segment.target_mm}) <= kTargetTolerance_mm;
  const bool same_time = std::abs(duration_back_s - duration_s) <= kTimeTolerance * duration_s;
  if (!same_target && raw < 0.0 && !takes_sign_) {
    refuse_sign("\"" + set_target + "\" left the target at " + fixed(target_back_mm, 5) + " mm");
  }
  if (!same_target || !same_time) {
    throw DeviceError(Fault::kRefused, at() + "the controller changed the ramp it was given: target " +
                                           fixed(double{segment.target_mm}, 5) + " -> " + fixed(target_back_mm, 5) +
                                           " mm, time " + fixed(duration_s, 6) + " -> " + fixed(duration_back_s, 6) +
                                           " s; nothing was started");
  }
  takes_sign_ = takes_sign_ || raw < 0.0;
  echoed_target_mm_ = static_cast<float>(target_back_mm);
  // A ramp of no length has no velocity: what was asked for is as true as anything.
  echoed_velocity_mm_s_ = length_mm > 2.0 * kShortestRamp_s * double{segment.velocity_mm_s}
                              ? static_cast<float>(length_mm / duration_back_s)
                              : segment.velocity_mm_s;
  ramp_ns_ = static_cast<std::int64_t>(duration_back_s * 1e9);
}

void Instron8800Frame::confirm_start(std::int64_t until_ns) {
  do {
    if (ask_number("Q1", until_ns) == kQ1Moving) return;
    // The shortest ramps are over before they can be seen.
    if (std::abs(ask_position(until_ns).value - double{segment_.target_mm}) <= config_.in_position_mm) return;
  } while (clock_.now_ns() < until_ns);
  throw DeviceError(Fault::kRefused,
                    at() + "C1,1 was sent and Q1 says that nothing moves; it was stopped. Look at the panel");
}

/// A heartbeat cannot come while the thread that brings it waits for a start in here: that time does not count.
void Instron8800Frame::start_segment(const Segment& segment) {
  const std::int64_t began_ns = clock_.now_ns();
  const bool was_fresh = began_ns - beat_ns_ < config_.heartbeat_timeout_ms * kMs;
  const auto excuse = [&] {
    const std::int64_t now_ns = clock_.now_ns();
    if (was_fresh) beat_ns_ = std::min(now_ns, beat_ns_ + now_ns - began_ns);
  };
  try {
    start_now(segment);
  } catch (const DeviceError&) {
    excuse();
    throw;
  }
  excuse();
}

void Instron8800Frame::start_now(const Segment& segment) {
  const auto refuse = [&](const std::string& why) { throw DeviceError(Fault::kRefused, at() + why); };
  if (!std::isfinite(segment.target_mm) || !std::isfinite(segment.velocity_mm_s) || segment.velocity_mm_s <= 0.0F) {
    refuse("a segment needs a finite target and a velocity above 0");
  }
  if (const auto why = ailment(); !why.empty()) refuse(why);
  if (!beat_seen_ || beat_lost_) refuse("no heartbeat: nothing would stop a motion when the loop hangs");
  if (motion_ == Motion::kMoving || stop_since_ns_ >= 0) stop();
  forget_round();
  const std::int64_t until_ns = in_ms(2 * config_.response_timeout_ms);
  stop_called_ns_ = kNever_ns;  // the next one stops this motion
  const auto from = ask_position(until_ns);
  write_ramp(segment, from.value, until_ns);
  try {
    link_.tell("C1,1");
    not_before_ns_ = clock_.now_ns() + ramp_ns_;
    segment_ = segment;
    motion_ = Motion::kMoving;
    in_position_since_ns_ = -1;
    stopped_answers_ = 0;
    confirm_start(in_ms(config_.start_confirm_ms));
  } catch (const DeviceError&) {
    try {
      stop();
    } catch (const DeviceError&) {  // the first error says more; poll() goes on with the stop
    }
    throw;
  }
}

bool Instron8800Frame::stands_still(std::int64_t until_ns) {
  const auto first = ask_position(until_ns);
  clock_.sleep_until_ns(first.middle_ns + kStandstill_ns);
  return std::abs(ask_position(until_ns).value - first.value) <= config_.in_position_mm;
}

void Instron8800Frame::stopped() noexcept {
  stop_since_ns_ = -1;
  if (motion_ == Motion::kMoving) motion_ = Motion::kStopped;
}

void Instron8800Frame::switch_off(const std::string& why) {
  link_.tell("C23,0");
  ++statistics_.actuator_off_sent;
  motion_ = Motion::kDisabled;
  stop_since_ns_ = -1;
  stop_called_ns_ = kNever_ns;  // the next one has to find out what became of it
  throw DeviceError(Fault::kTimeout,
                    at() + "the stop was not confirmed (" + why + "): the actuator was switched off, C23,0");
}

void Instron8800Frame::stop() {
  if (!link_.is_open()) {
    say_what_waits();  // why it was closed
    throw DeviceError(Fault::kDisconnected, at() + "not connected");
  }
  beat_ns_ = clock_.now_ns();  // nobody beats while it stops; what was lost before stays lost
  if (!has_control_) return;   // the panel's business now; a command would trip the actuator
  feed_wanted_ = false;        // a heartbeat from before: the watchdog may be what stops it
  // In doubt there is no round to be spared, and one call for each response time-out is enough.
  const bool is_repeated = stop_is_fresh() && link_.in_step() && (stop_since_ns_ >= 0 || motion_ != Motion::kMoving);
  try {
    is_repeated ? repeat_stop() : begin_stop();
  } catch (const DeviceError&) {
    if (stop_since_ns_ >= 0) stop_called_ns_ = clock_.now_ns();
    beat_ns_ = clock_.now_ns();
    throw;
  }
  stop_called_ns_ = beat_ns_ = clock_.now_ns();
}

bool Instron8800Frame::stop_is_fresh() const noexcept {
  return stop_called_ns_ != kNever_ns && clock_.now_ns() - stop_called_ns_ < kStopRepeated_ns;
}

/// The daemon repeats a stop at every poll until the samples stand still. To ask here each time would leave the round
/// of samples no time on a slow line, and to forget the round would make it begin afresh for ever.
void Instron8800Frame::repeat_stop() {
  const std::int64_t now_ns = clock_.now_ns();
  if (now_ns >= stop_again_ns_) {
    stop_again_ns_ = now_ns + kStopAgain_ns;
    link_.tell("C1,0");
  }
  if (stop_since_ns_ < 0) return;
  throw DeviceError(Fault::kTimeout,
                    at() + "the stop is not confirmed yet (" + stop_unconfirmed_ + "); it is sent again");
}

void Instron8800Frame::begin_stop() {
  link_.tell("C1,0");
  forget_round();
  const std::int64_t now_ns = clock_.now_ns();
  if (stop_since_ns_ < 0) {
    stop_since_ns_ = now_ns;
    moves_after_stop_ = motion_ == Motion::kMoving;
    stop_unconfirmed_ = "no answer";
  }
  stop_again_ns_ = now_ns + kStopAgain_ns;
  const std::int64_t off_ns = stop_since_ns_ + config_.stop_confirm_ms * kMs;
  const std::int64_t until_ns = std::min(now_ns + config_.response_timeout_ms * kMs, std::max(off_ns, now_ns + kMs));
  std::string why;
  do {
    try {
      if (ask_number("Q1", until_ns) == kQ1Moving) {
        moves_after_stop_ = true;
        why = "Q1 says that it still moves";
      } else if (!moves_after_stop_ || stands_still(until_ns)) {
        stopped();
        return;
      } else {
        why = "its position still changes";
      }
    } catch (const DeviceError& error) {
      if (error.fault() == Fault::kDisconnected) throw;
      why = error.what();
    }
    if (clock_.now_ns() >= stop_again_ns_ && link_.in_step()) {
      stop_again_ns_ = clock_.now_ns() + kStopAgain_ns;
      link_.tell("C1,0");
    }
  } while (clock_.now_ns() < until_ns);
  if (moves_after_stop_ && clock_.now_ns() >= off_ns) switch_off(why);
  stop_unconfirmed_ = why;
  throw DeviceError(Fault::kTimeout, at() + "the stop is not confirmed yet (" + why + "); it is sent again");
}

/// Goes on with a stop that is not confirmed: by what the rounds bring.
void Instron8800Frame::check_stop() {
  if (stop_since_ns_ < 0) return;
  if (!has_control_) {
    stop_since_ns_ = -1;
    return;
  }
  const std::int64_t now_ns = clock_.now_ns();
  if (now_ns - stop_since_ns_ >= config_.stop_confirm_ms * kMs) {
    if (moves_after_stop_) switch_off("for " + std::to_string(config_.stop_confirm_ms) + " ms");
    stop_since_ns_ = -1;
    stop_called_ns_ = kNever_ns;  // the next stop() asks again
    throw DeviceError(Fault::kTimeout, at() + "a stop of the resting crosshead was not confirmed");
  }
  // A controller that hangs has it in its input already, and takes many commands at once badly.
  if (now_ns < stop_again_ns_ || !link_.in_step()) return;
  stop_again_ns_ = now_ns + kStopAgain_ns;
  link_.tell("C1,0");
}

void Instron8800Frame::heartbeat(std::uint16_t counter) {
  beat_ = counter;
  beat_ns_ = clock_.now_ns();
  beat_seen_ = true;
  beat_lost_ = false;
  feed_wanted_ = true;
}

void Instron8800Frame::feed_watchdog() {
  if (!feed_wanted_ || !has_control_ || !watchdog_seen_on_) return;
  link_.tell(watchdog_command_);
  feed_wanted_ = watchdog_seen_on_ = false;
}

void Instron8800Frame::check_heartbeat() {
  if (stop_since_ns_ >= 0)
    beat_ns_ = clock_.now_ns();  // withheld until the stop is confirmed, and nothing is to be lost
  if (!beat_seen_ || beat_lost_ || clock_.now_ns() - beat_ns_ < config_.heartbeat_timeout_ms * kMs) return;
  beat_lost_ = true;
  if (motion_ == Motion::kMoving) stop();
}

}  // namespace isorig::frame
