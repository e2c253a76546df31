#include <algorithm>
#include <cmath>
#include <cstdio>

#include "drivers/error.hpp"
#include "drivers/frame/instron8800_frame.hpp"

namespace isorig::frame {

using drivers::DeviceError;
using drivers::Fault;

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr double kShortestRamp_s = 0.001;
constexpr double kTargetTolerance_mm = 5e-4;   // half of what the supervisor takes for another target
constexpr double kMoving = 1.0;                // of Q1; what else it says is some way of standing
constexpr std::int64_t kStandstill_ns = 20 * kMs;
constexpr double kTimeTolerance = 5e-4;        // likewise, of the velocity

/// Without an exponent, which the command set may not know.
std::string fixed(double value, int decimals) {
  char out[64];
  std::snprintf(out, sizeof out, "%.*f", decimals, value);
  return out;
}

}  // namespace

void Instron8800Frame::write_ramp(const Segment& segment, double from_mm) {
  const double length_mm = std::abs(double{segment.target_mm} - from_mm);
  const double duration_s = std::max(length_mm / double{segment.velocity_mm_s}, kShortestRamp_s);
  const double raw = double{segment.target_mm} / mm_per_raw_;
  if (!(std::abs(raw) <= 1.0)) {
    throw DeviceError(Fault::kRefused, at() + "a target of " + fixed(double{segment.target_mm}, 4) +
                                           " mm is outside the channel's full scale of " + fixed(mm_per_raw_, 4) + " mm");
  }
  const auto target = channel("4", config_.position_channel), time = channel("86", config_.position_channel);
  link_.tell("C" + target + "," + fixed(raw, 9));
  link_.tell("C" + time + "," + fixed(duration_s, 6));
  const double target_back_mm = ask_number("Q" + target) * mm_per_raw_;
  const double duration_back_s = ask_number("Q" + time);
  const bool same_target = std::abs(target_back_mm - double{segment.target_mm}) <= kTargetTolerance_mm;
  const bool same_time = std::abs(duration_back_s - duration_s) <= kTimeTolerance * duration_s;
  if (!same_target || !same_time) {
    throw DeviceError(Fault::kRefused, at() + "the controller changed the ramp it was given: target " +
                                           fixed(double{segment.target_mm}, 5) + " -> " + fixed(target_back_mm, 5) + " mm, time " +
                                           fixed(duration_s, 6) + " -> " + fixed(duration_back_s, 6) + " s; nothing was started");
  }
  echoed_target_mm_ = static_cast<float>(target_back_mm);
  // A ramp of no length has no velocity: what was asked for is as true as anything.
  echoed_velocity_mm_s_ = length_mm > 2.0 * kShortestRamp_s * double{segment.velocity_mm_s}
                              ? static_cast<float>(length_mm / duration_back_s)
                              : segment.velocity_mm_s;
  not_before_ns_ = static_cast<std::int64_t>(duration_back_s * 1e9);  // from the start, which is not yet known
}

void Instron8800Frame::confirm_start() {
  const std::int64_t until_ns = clock_.now_ns() + config_.start_confirm_ms * kMs;
  do {
    if (ask_number("Q1") == kMoving) return;
    // The shortest ramps are over before they can be seen.
    if (std::abs(ask_position().value - double{segment_.target_mm}) <= config_.in_position_mm) return;
  } while (clock_.now_ns() < until_ns);
  throw DeviceError(Fault::kRefused, at() + "C1,1 was sent and Q1 says that nothing moves; it was stopped. Look at the panel");
}

void Instron8800Frame::start_segment(const Segment& segment) {
  const auto refuse = [&](const std::string& why) { throw DeviceError(Fault::kRefused, at() + why); };
  if (!std::isfinite(segment.target_mm) || !std::isfinite(segment.velocity_mm_s) || segment.velocity_mm_s <= 0.0F) {
    refuse("a segment needs a finite target and a velocity above 0");
  }
  if (const auto why = ailment(); !why.empty()) refuse(why);
  if (!beat_seen_ || beat_lost_) refuse("no heartbeat: nothing would stop a motion when the loop hangs");
  if (motion_ == Motion::kMoving) stop();
  const auto from = ask_position();
  write_ramp(segment, from.value);
  try {
    const std::int64_t duration_ns = not_before_ns_;
    link_.tell("C1,1");
    not_before_ns_ = clock_.now_ns() + duration_ns;
    segment_ = segment;
    motion_ = Motion::kMoving;
    in_position_since_ns_ = -1;
    stopped_answers_ = 0;
    confirm_start();
  } catch (const DeviceError&) {
    try {
      stop();
    } catch (const DeviceError&) {  // the first error says more; stop() did what can be done
    }
    throw;
  }
  position_ = force_ = {};  // the gap was long
  force_next_ = true;
}

bool Instron8800Frame::stands_still() {
  const auto first = ask_position();
  clock_.sleep_until_ns(first.middle_ns + kStandstill_ns);
  return std::abs(ask_position().value - first.value) <= config_.in_position_mm;
}

void Instron8800Frame::stop() {
  if (!link_.is_open()) throw DeviceError(Fault::kDisconnected, at() + "not connected");
  if (!has_control_) return;  // the panel's business now; a command would trip the actuator
  const bool was_moving = motion_ == Motion::kMoving;
  link_.tell("C1,0");
  const std::int64_t until_ns = clock_.now_ns() + config_.stop_confirm_ms * kMs;
  std::string why;
  do {
    try {
      if (ask_number("Q1") != kMoving && (!was_moving || stands_still())) {
        if (was_moving) motion_ = Motion::kStopped;
        return;
      }
      why = "it still moves";
    } catch (const DeviceError& error) {
      if (error.fault() == Fault::kDisconnected) throw;
      why = error.what();
    }
  } while (clock_.now_ns() < until_ns);
  if (!was_moving) throw DeviceError(Fault::kTimeout, at() + "a stop of the resting crosshead is not confirmed: " + why);
  link_.tell("C23,0");
  ++statistics_.actuator_off_sent;
  motion_ = Motion::kStopped;
  throw DeviceError(Fault::kTimeout, at() + "the stop was not confirmed (" + why + "): the actuator was switched off, C23,0");
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
  link_.tell(config_.watchdog_command);
  feed_wanted_ = watchdog_seen_on_ = false;
}

void Instron8800Frame::check_heartbeat() {
  if (!beat_seen_ || beat_lost_ || clock_.now_ns() - beat_ns_ < config_.heartbeat_timeout_ms * kMs) return;
  beat_lost_ = true;
  if (motion_ == Motion::kMoving) stop();
}

}  // namespace isorig::frame
