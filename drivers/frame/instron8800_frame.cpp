#include "drivers/frame/instron8800_frame.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/error.hpp"

namespace isorig::frame {

using drivers::DeviceError;
using drivers::Fault;

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kSlice_ns = 20 * kMs;
/// Positions further apart than this are not interpolated between: a hang lay there.
constexpr std::int64_t kFarApart_ns = 250 * kMs;
/// A loss of control this soon after a doubt is the watchdog's doing, not the operator's.
constexpr std::int64_t kWatchdogSuspected_ns = 3'000 * kMs;
constexpr unsigned kTravelLimitCode = 1, kEmergencyStopCode = 6, kAllWellCode = 15;
constexpr double kAbsoluteRamp = 3.0;

/// Status, actuator, movement, control; the watchdog is asked about before it is fed.
constexpr std::array<std::int64_t, 4> kPeriods_ns{100 * kMs, 250 * kMs, 100 * kMs, 250 * kMs};

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

}  // namespace

const char* describe_instron8800_status(unsigned code) noexcept {
  switch (code) {
    case 0:
    case kAllWellCode: return nullptr;
    case kTravelLimitCode: return "travel limit exceeded";
    case 2: return "power amplifier too hot";
    case kEmergencyStopCode: return "emergency stop pushed";
    case 7: return "oil too hot";
    case 8: return "oil level too low";
    case 9: return "motor too hot";
    case 10: return "oil pressure too high";
    case 11: return "oil pressure too low";
    case 12: return "manifold or pump blocked";
    case 13: return "oil level going too low";
    case 14: return "manifold pressure low";
    default: return "a fault code this driver does not know";
  }
}

Instron8800Frame::Instron8800Frame(Instron8800Config config, clock::Clock& clock)
    : config_(std::move(config)), clock_(clock), link_(config_, clock) {}

Instron8800Frame::Statistics Instron8800Frame::statistics() const noexcept {
  auto all = statistics_;
  all.link = link_.statistics();
  return all;
}

std::string Instron8800Frame::channel(std::string_view question, int number) const {
  return std::string(question) + "," + std::to_string(number);
}

double Instron8800Frame::ask_number(std::string_view question) {
  const auto answer = link_.ask(question);
  try {
    return parse_numbers(question, answer.text, 1).front();
  } catch (const DeviceError&) {
    link_.doubt();
    throw;
  }
}

Instron8800Frame::Reading Instron8800Frame::reading(const Instron8800Link::Answer& answer, double value) const noexcept {
  const std::int64_t earliest_ns = answer.sent_ns - static_cast<std::int64_t>(1e6 * config_.reading_age_max_ms);
  const std::int64_t half_ns = (answer.received_ns - earliest_ns) / 2;
  return {true, value, earliest_ns + half_ns, half_ns};
}

Instron8800Frame::Reading Instron8800Frame::ask_position() {
  const auto question = text_of(Ask::kPosition);
  const auto answer = link_.ask(question);
  return reading(answer, parse_numbers(question, answer.text, 1).front() * mm_per_raw_);
}

// ---- connection
// -----------------------------------------------------------------------------------------------

void Instron8800Frame::check_channels() {
  const auto scale = [&](int number_, const char* key, double expected, double unit, const char* unit_name) {
    const auto question = channel("Q308", number_);
    const double full_scale = ask_number(question) * unit;
    if (!(full_scale > 0.0) || (expected > 0.0 && std::abs(full_scale - expected) > 1e-3 * expected)) {
      throw DeviceError(Fault::kIdentity, at() + question + " says a full scale of " + number(full_scale) + " " + unit_name +
                                              (expected > 0.0 ? ", and the rig's [frame] says " + std::string(key) + " = " +
                                                                    number(expected)
                                                              : "") +
                                              "; another transducer, another unit or another controller");
    }
    return full_scale;
  };
  mm_per_raw_ = scale(config_.position_channel, "position_full_scale_mm", config_.position_full_scale_mm, 1e3, "mm");
  N_per_raw_ = scale(config_.force_channel, "force_full_scale_N", config_.force_full_scale_N, 1.0, "N");
  const auto refuse = [&](const std::string& why) { throw DeviceError(Fault::kIdentity, at() + why); };
  if (ask_number("Q300") != config_.position_channel) {
    refuse("the controller is not in position control (Q300); switch it at its panel, at rest, and look what it does");
  }
}

void Instron8800Frame::take_control() {
  link_.tell("P909,1");
  link_.tell(config_.watchdog_command);
  if (ask_number("Q909") != 1.0) {
    throw DeviceError(Fault::kIdentity, at() + "the front panel keeps control (Q909); give it to the computer");
  }
  if (ask_number("Q904") != config_.watchdog_on) {
    throw DeviceError(Fault::kIdentity, at() + "the controller's watchdog is not on (Q904) after \"" +
                                            config_.watchdog_command + "\"; without it nothing would stop the actuator when "
                                            "this computer fails. Correct watchdog_command and watchdog_on");
  }
  const auto ramp = channel("2", config_.position_channel);
  if (ask_number("Q" + ramp) != kAbsoluteRamp) {
    link_.tell("C" + ramp + ",3");
    if (ask_number("Q" + ramp) != kAbsoluteRamp) {
      throw DeviceError(Fault::kIdentity, at() + "the position channel does not take the absolute ramp (C2)");
    }
  }
}

/// Of two questions a sample, from the fastest of a few: what the line gives when nothing disturbs it.
double Instron8800Frame::measured_rate_hz() {
  std::int64_t best_ns = 1'000'000'000;
  for (int i = 0; i < 5; ++i) {
    const auto answer = link_.ask(text_of(Ask::kPosition));
    best_ns = std::min(best_ns, answer.received_ns - answer.sent_ns);
  }
  return 1e9 / (2.0 * static_cast<double>(best_ns + std::int64_t{config_.gap_us} * 1000));
}

Identity Instron8800Frame::connect() {
  link_.open();
  try {
    check_channels();
    take_control();
    take_status(static_cast<std::uint16_t>(ask_number("Q22")));
    actuator_on_ = ask_number("Q23") != 0.0;
    has_control_ = watchdog_on_ = true;
    ailment_ = ailment();
    force_ = position_ = {};
    current_ = Ask::kForce;
    force_next_ = true;
    motion_ = Motion::kIdle;
    segment_ = {};
    beat_seen_ = beat_lost_ = false;
    watchdog_seen_on_ = feed_wanted_ = false;
    Identity identity;
    identity.maker = "Instron";
    identity.model = "8800-type controller, ASCII command set";
    identity.sample_rate_hz = measured_rate_hz();
    return identity;
  } catch (...) {
    link_.close();
    throw;
  }
}

void Instron8800Frame::disconnect() noexcept {
  if (!link_.is_open()) return;
  try {
    if (has_control_) link_.tell("C1,0");
    // In order, control goes back to the panel. After a fault it does not: the watchdog has its say.
    if (has_control_ && !link_.pending() && motion_ != Motion::kMoving) link_.tell("P909,0");
  } catch (const std::exception&) {  // the controller's watchdog stops the actuator
  }
  link_.close();
}

// ---- samples
// --------------------------------------------------------------------------------------------------

std::string Instron8800Frame::text_of(Ask ask) const {
  switch (ask) {
    case Ask::kForce: return "Q134," + std::to_string(config_.force_channel) + ",0";
    case Ask::kPosition: return "Q134," + std::to_string(config_.position_channel) + ",0";
    case Ask::kStatus: return "Q22";
    case Ask::kActuator: return "Q23";
    case Ask::kMovement: return "Q1";
    case Ask::kControl: return "Q909";
    case Ask::kWatchdog: return "Q904";
  }
  return {};
}

/// Position, force, position, force ...; after a position at most one question about the controller itself.
Instron8800Frame::Ask Instron8800Frame::next_question(std::int64_t now_ns) noexcept {
  if (force_next_ && current_ == Ask::kPosition) {
    std::size_t most = kSideQuestions;
    for (std::size_t i = 0; i < kSideQuestions; ++i) {
      if (now_ns >= due_ns_[i] && (most == kSideQuestions || due_ns_[i] < due_ns_[most])) most = i;
    }
    if (most < kSideQuestions) {
      due_ns_[most] = now_ns + (most < kPeriods_ns.size() ? kPeriods_ns[most] : config_.watchdog_feed_ms * kMs);
      return static_cast<Ask>(static_cast<std::size_t>(Ask::kStatus) + most);
    }
  }
  return force_next_ && position_.valid ? Ask::kForce : Ask::kPosition;
}

Poll Instron8800Frame::poll(std::span<Sample> out) {
  Poll poll;
  check_heartbeat();
  const std::int64_t until_ns = clock_.now_ns() + kSlice_ns;
  try {
    while (poll.samples == 0 && clock_.now_ns() < until_ns) {
      if (!link_.pending()) {
        current_ = next_question(clock_.now_ns());
        link_.begin(text_of(current_));
      }
      const auto answer = link_.finish(until_ns);
      if (!answer) break;
      if (take_answer(current_, *answer, out)) poll.samples = 1;
    }
  } catch (const DeviceError&) {
    force_ = position_ = {};  // the next sample stands on answers from after this
    force_next_ = true;
    throw;
  }
  note_condition();
  poll.state = state();
  if (poll.samples > 0) {
    // The clock that stamps is the host's own.
    const std::int64_t before_ns = clock_.now_ns();
    const double stamp_us = static_cast<double>(clock_.now_ns()) * 1e-3;
    poll.has_exchange = true;
    poll.exchange = {before_ns, std::max(clock_.now_ns(), before_ns + 1), stamp_us, stamp_us};
  }
  return poll;
}

bool Instron8800Frame::take_answer(Ask ask, const Instron8800Link::Answer& answer, std::span<Sample> out) {
  double value = 0.0;
  try {
    value = parse_numbers(text_of(ask), answer.text, 1).front();
  } catch (const DeviceError&) {
    link_.doubt();
    throw;
  }
  switch (ask) {
    case Ask::kForce:
      force_ = reading(answer, value * N_per_raw_);
      force_next_ = false;
      return false;
    case Ask::kPosition: {
      const bool sampled = take_position(reading(answer, value * mm_per_raw_), out);
      force_next_ = true;
      return sampled;
    }
    case Ask::kStatus: take_status(static_cast<std::uint16_t>(value)); break;
    case Ask::kActuator: actuator_on_ = value != 0.0; break;
    case Ask::kMovement:
      // Twice in a row, since a ramp that has just arrived may say so before its position does.
      stopped_answers_ = value != 1.0 ? stopped_answers_ + 1 : 0;
      if (motion_ == Motion::kMoving && stopped_answers_ >= 2) motion_ = Motion::kStopped;
      break;
    case Ask::kControl:
      has_control_ = value == 1.0;
      feed_watchdog();
      break;
    case Ask::kWatchdog:
      watchdog_on_ = value == config_.watchdog_on;
      watchdog_seen_on_ = watchdog_on_;
      due_ns_[static_cast<std::size_t>(Ask::kControl) - static_cast<std::size_t>(Ask::kStatus)] = 0;  // and then it is fed
      break;
  }
  return false;
}

bool Instron8800Frame::take_position(const Reading& position, std::span<Sample> out) {
  const Reading before = position_;
  position_ = position;
  follow_motion(position);
  const std::int64_t apart_ns = position.middle_ns - before.middle_ns;
  if (!before.valid || !force_.valid || apart_ns <= 0 || apart_ns > kFarApart_ns || out.empty()) return false;
  const double weight = static_cast<double>(force_.middle_ns - before.middle_ns) / static_cast<double>(apart_ns);
  Sample& sample = out[0];
  sample.sequence = sequence_++;
  sample.device_us = (force_.middle_ns + 500) / 1000;
  sample.position_mm = static_cast<float>(before.value + weight * (position.value - before.value));
  sample.force_N = static_cast<float>(force_.value);
  sample.bound_us = static_cast<float>(static_cast<double>(std::max({before.half_ns, force_.half_ns, position.half_ns})) * 1e-3);
  force_.valid = false;
  ++statistics_.samples;
  return true;
}

void Instron8800Frame::follow_motion(const Reading& position) noexcept {
  if (motion_ != Motion::kMoving) return;
  if (std::abs(position.value - double{segment_.target_mm}) > config_.in_position_mm) {
    in_position_since_ns_ = -1;
    return;
  }
  if (in_position_since_ns_ < 0) in_position_since_ns_ = position.middle_ns;
  if (position.middle_ns >= not_before_ns_ && position.middle_ns - in_position_since_ns_ >= config_.in_position_ms * kMs) {
    motion_ = Motion::kReached;
  }
}

// ---- what the controller says of itself
// -----------------------------------------------------------------------

void Instron8800Frame::take_status(std::uint16_t word) { status_code_ = (word >> 9U) & 15U; }

std::string Instron8800Frame::ailment() const {
  if (const char* what = describe_instron8800_status(status_code_)) return what;
  if (!has_control_) return "the front panel has taken control; give it back there, or restart isorigd when nobody is at it";
  if (!actuator_on_) return "the actuator is off; find out why, then switch it on at the panel (after C23,0 send C23,1 first)";
  if (!watchdog_on_) return "the controller's watchdog has been switched off; nothing moves until it is on again";
  return {};
}

/// Says once what is wrong, after having stopped what still moves.
void Instron8800Frame::note_condition() {
  auto now = ailment();
  if (now == ailment_) return;
  ailment_ = std::move(now);
  if (ailment_.empty()) return;
  const bool was_moving = motion_ == Motion::kMoving;
  if (was_moving) motion_ = status_code_ == kTravelLimitCode ? Motion::kLimit : Motion::kDisabled;
  if (!has_control_ && link_.last_doubt_ns() >= 0 && clock_.now_ns() - link_.last_doubt_ns() < kWatchdogSuspected_ns) {
    link_.close();
    throw DeviceError(Fault::kDisconnected, at() + "the controller was silent and its watchdog took control back");
  }
  if (was_moving && has_control_) link_.tell("C1,0");
  if (!watchdog_on_ && has_control_) link_.tell(config_.watchdog_command);
  throw DeviceError(Fault::kRefused, at() + ailment_);
}

State Instron8800Frame::state() const noexcept {
  State s;
  s.motion = motion_;
  s.segment_id = segment_.id;
  s.target_mm = echoed_target_mm_;
  s.velocity_mm_s = echoed_velocity_mm_s_;
  s.heartbeat_echo = beat_;
  if (beat_lost_) s.fault_bits |= kHeartbeatLost;
  if (status_code_ == kTravelLimitCode) {
    s.fault_bits |= kTravelLimit;
  } else if (status_code_ == kEmergencyStopCode) {
    s.fault_bits |= kInterlockOpen;
  } else if (describe_instron8800_status(status_code_) != nullptr || !actuator_on_ || !has_control_ || !watchdog_on_) {
    s.fault_bits |= kDriveFault;
  }
  return s;
}

}  // namespace isorig::frame
