#include "drivers/frame/instron8800_frame.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "drivers/api/error.hpp"
#include "drivers/frame/instron8800_status.hpp"
#include "drivers/frame/instron8800_words.hpp"

namespace isorig::frame {

using drivers::DeviceError;
using drivers::Fault;

namespace {

/// Longer than this, and a tenth of the ramp, before its time a ramp is early.
constexpr std::int64_t kEarly_ns = 500 * kMs;
/// A loss of control this soon after a silence is the watchdog's doing, not the operator's.
constexpr std::int64_t kWatchdogSuspected_ns = 3'000 * kMs;

/// Status, actuator, movement, control; the watchdog is asked about before it is fed.
constexpr std::array<std::int64_t, 4> kPeriods_ns{100 * kMs, 250 * kMs, 100 * kMs, 250 * kMs};
constexpr std::size_t kMovementIndex = 2, kControlIndex = 3;

}  // namespace

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

std::int64_t Instron8800Frame::in_ms(int milliseconds) const noexcept {
  return clock_.now_ns() + milliseconds * kMs;
}

double Instron8800Frame::number_in(std::string_view question, const Instron8800Link::Answer& answer) {
  try {
    // The watchdog has one number or two.
    return parse_numbers(question, answer.text, 1, question == "Q904" ? 2 : 1).front();
  } catch (const DeviceError& error) {
    link_.doubt();
    throw DeviceError(error.fault(), at() + error.what() + link_.suspects());
  }
}

double Instron8800Frame::ask_number(std::string_view question, std::int64_t until_ns) {
  return number_in(question, link_.ask({question}, until_ns).front());
}

Instron8800Frame::Reading Instron8800Frame::reading(const Instron8800Link::Answer& answer,
                                                    double value) const noexcept {
  const std::int64_t earliest_ns = answer.sent_ns - static_cast<std::int64_t>(1e6 * config_.reading_age_max_ms);
  const std::int64_t half_ns = (answer.received_ns - earliest_ns) / 2;
  return {true, value, earliest_ns + half_ns, half_ns};
}

Instron8800Frame::Reading Instron8800Frame::ask_position(std::int64_t until_ns) {
  const auto question = text_of(Ask::kPosition);
  const auto answer = link_.ask({question}, until_ns).front();
  return reading(answer, number_in(question, answer) * mm_per_raw_);
}

// ---- samples
// --------------------------------------------------------------------------------------------------

std::string Instron8800Frame::text_of(Ask ask) const {
  switch (ask) {
    case Ask::kForce:
      return "Q134," + std::to_string(config_.force_channel) + ",0";
    case Ask::kPosition:
      return "Q134," + std::to_string(config_.position_channel) + ",0";
    case Ask::kStatus:
      return "Q22";
    case Ask::kActuator:
      return "Q23";
    case Ask::kMovement:
      return "Q1";
    case Ask::kControl:
      return "Q909";
    case Ask::kWatchdog:
      return "Q904";
  }
  return {};
}

/// Force between two positions, at most one question about the controller itself, and the link's check.
void Instron8800Frame::begin_round(std::int64_t now_ns) noexcept {
  round_.clear();
  answers_.clear();
  if (!position_.valid) round_.push_back(Ask::kPosition);
  round_.push_back(Ask::kForce);
  round_.push_back(Ask::kPosition);
  if (stop_since_ns_ >= 0) due_ns_[kMovementIndex] = 0;
  std::size_t most = kSideQuestions;
  for (std::size_t i = 0; i < kSideQuestions; ++i) {
    const bool asked =
        static_cast<Ask>(static_cast<std::size_t>(Ask::kStatus) + i) != Ask::kWatchdog || watchdog_can_be_asked_;
    if (asked && now_ns >= due_ns_[i] && (most == kSideQuestions || due_ns_[i] < due_ns_[most])) most = i;
  }
  if (most == kSideQuestions) return;
  due_ns_[most] = now_ns + (most < kPeriods_ns.size() ? kPeriods_ns[most] : config_.watchdog_feed_ms * kMs);
  round_.push_back(static_cast<Ask>(static_cast<std::size_t>(Ask::kStatus) + most));
}

void Instron8800Frame::forget_round() noexcept {
  force_ = position_ = stop_position_ = {};  // the next sample stands on answers from after this
  round_.clear();
  answers_.clear();
}

/// True when the round is over and has brought a sample; false when the time is up, or it brought none.
bool Instron8800Frame::go_on_with_round(std::int64_t until_ns, std::span<Sample> out) {
  if (!link_.pending()) {
    if (!link_.recover(until_ns)) return false;
    if (round_.empty()) begin_round(clock_.now_ns());
    const bool check = answers_.size() == round_.size();
    if (!link_.begin(check ? link_.check_question() : text_of(round_[answers_.size()]))) {
      forget_round();
      return false;
    }
  }
  const auto answer = link_.finish(until_ns);
  if (!answer) return false;
  if (answers_.size() < round_.size()) {
    (void)number_in(text_of(round_[answers_.size()]), *answer);
    answers_.push_back(*answer);
    return false;
  }
  if (link_.passes_check(answer->text)) return take_round(out);
  link_.doubt();
  throw DeviceError(Fault::kProtocol, at() + "answers are out of step: the channel's type was asked for and \"" +
                                          answer->text.substr(0, 40) +
                                          "\" came; what came since the last check is thrown away");
}

Poll Instron8800Frame::poll(std::span<Sample> out) {
  Poll poll;
  say_what_waits();
  try {
    check_heartbeat();
    check_stop();
    const std::int64_t until_ns = clock_.now_ns() + kSlice_ns;
    while (poll.samples == 0 && clock_.now_ns() < until_ns) {
      if (go_on_with_round(until_ns, out)) poll.samples = 1;
    }
  } catch (const DeviceError&) {
    forget_round();
    ailment_.clear();  // so that what ails the controller is said again afterwards
    throw;
  }
  try {
    note_condition();
    told_ = state();
  } catch (const DeviceError& error) {
    if (poll.samples == 0) throw;
    to_be_said_ = error;  // first the sample, then why
  }
  poll.state = told_;
  if (poll.samples > 0) {
    // The clock that stamps is the host's own.
    const std::int64_t before_ns = clock_.now_ns();
    const double stamp_us = static_cast<double>(clock_.now_ns()) * 1e-3;
    poll.has_exchange = true;
    poll.exchange = {before_ns, std::max(clock_.now_ns(), before_ns + 1), stamp_us, stamp_us};
  }
  return poll;
}

bool Instron8800Frame::take_round(std::span<Sample> out) {
  bool sampled = false;
  for (std::size_t i = 0; i < round_.size(); ++i) {
    const auto ask = round_[i];
    const auto& answer = answers_[i];
    const double value = number_in(text_of(ask), answer);
    if (ask == Ask::kForce) {
      force_ = reading(answer, value * N_per_raw_);
    } else if (ask == Ask::kPosition) {
      sampled = take_position(reading(answer, value * mm_per_raw_), out);
    } else {
      take_condition(ask, value);
    }
  }
  round_.clear();
  answers_.clear();
  return sampled;
}

void Instron8800Frame::take_condition(Ask ask, double value) {
  switch (ask) {
    case Ask::kForce:
    case Ask::kPosition:
      break;
    case Ask::kStatus:
      take_status(static_cast<std::uint16_t>(value));
      break;
    case Ask::kActuator:
      actuator_on_ = value != 0.0;
      break;
    case Ask::kMovement:
      take_movement(value == kQ1Moving);
      break;
    case Ask::kControl:
      has_control_ = value == 1.0;
      if (!watchdog_can_be_asked_) watchdog_seen_on_ = true;
      feed_watchdog();
      break;
    case Ask::kWatchdog:
      watchdog_on_ = value == config_.watchdog_on;
      watchdog_seen_on_ = watchdog_on_;
      due_ns_[kControlIndex] = 0;  // and then it is fed
      break;
  }
}

void Instron8800Frame::take_movement(bool moves) {
  if (moves && stop_since_ns_ < 0 && motion_ != Motion::kMoving && stop_is_fresh()) {
    stop_since_ns_ = clock_.now_ns();  // confirmed and moves all the same
    moves_after_stop_ = true;
    stop_unconfirmed_ = "Q1 says that it moves again";
  }
  if (stop_since_ns_ >= 0) {
    moves_after_stop_ = moves_after_stop_ || moves;
    // On a fast line the next round is too soon to compare with: the older position is kept until it is old enough.
    const bool is_old = stop_position_.valid && position_.middle_ns - stop_position_.middle_ns >= kStandstill_ns;
    const bool stands = !moves && is_old && position_.valid &&
                        std::abs(position_.value - stop_position_.value) <= config_.in_position_mm;
    if (moves || is_old || !stop_position_.valid) stop_position_ = position_;
    if (stands) stopped();
    return;
  }
  // Twice in a row, since a ramp that has just arrived may say so before its position does.
  stopped_answers_ = moves ? 0 : stopped_answers_ + 1;
  if (motion_ != Motion::kMoving || stopped_answers_ < 2) return;
  if (!position_.valid || !(std::abs(position_.value - double{segment_.target_mm}) <= config_.in_position_mm)) {
    motion_ = Motion::kStopped;
    return;
  }
  motion_ = Motion::kReached;  // some controllers end a ramp when it has arrived
  const std::int64_t early_ns = not_before_ns_ - clock_.now_ns();
  if (early_ns > std::max(kEarly_ns, ramp_ns_ / 10)) {
    early_ = "the ramp was there " + std::to_string(early_ns / kMs) + " ms before its time of " +
             std::to_string(ramp_ns_ / kMs) +
             " ms: this controller does not keep to the ramp time it was given (C86), and the velocity was another one";
  }
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
  sample.bound_us =
      static_cast<float>(static_cast<double>(std::max({before.half_ns, force_.half_ns, position.half_ns})) * 1e-3);
  force_.valid = false;
  ++statistics_.samples;
  return true;
}

void Instron8800Frame::follow_motion(const Reading& position) noexcept {
  if (motion_ != Motion::kMoving) return;
  if (!(std::abs(position.value - double{segment_.target_mm}) <= config_.in_position_mm)) {  // nor without a target
    in_position_since_ns_ = -1;
    return;
  }
  if (in_position_since_ns_ < 0) in_position_since_ns_ = position.middle_ns;
  if (position.middle_ns >= not_before_ns_ &&
      position.middle_ns - in_position_since_ns_ >= config_.in_position_ms * kMs) {
    motion_ = Motion::kReached;
  }
}

// ---- what the controller says of itself
// -----------------------------------------------------------------------

void Instron8800Frame::take_status(std::uint16_t word) {
  status_code_ = (word >> 9U) & 15U;
}

std::string Instron8800Frame::ailment() const {
  if (const char* what = describe_instron8800_status(status_code_)) return what;
  if (!has_control_)
    return "the front panel has taken control; give it back there, or restart isorigd when nobody is at it";
  if (!actuator_on_) return "the actuator is off: find out why, then switch it on at the console";
  if (!watchdog_on_) return "the controller's watchdog has been switched off; nothing moves until it is on again";
  return {};
}

/// Says once what is wrong, after having stopped what still moves.
void Instron8800Frame::note_condition() {
  if (!early_.empty()) throw DeviceError(Fault::kRefused, at() + std::exchange(early_, {}));
  auto now = ailment();
  if (now == ailment_) return;
  ailment_ = std::move(now);
  if (ailment_.empty()) return;
  const bool was_moving = motion_ == Motion::kMoving;
  if (was_moving) motion_ = status_code_ == kInstron8800TravelLimit ? Motion::kLimit : Motion::kDisabled;
  if (!has_control_ && link_.last_silence_ns() >= 0 &&
      clock_.now_ns() - link_.last_silence_ns() < kWatchdogSuspected_ns) {
    link_.close();
    throw DeviceError(Fault::kDisconnected, at() + "the controller was silent and its watchdog took control back");
  }
  if (was_moving && has_control_) link_.tell("C1,0");
  if (!watchdog_on_ && has_control_) link_.tell(watchdog_command_);
  throw DeviceError(Fault::kRefused, at() + ailment_);
}

void Instron8800Frame::say_what_waits() {
  if (!to_be_said_) return;
  const DeviceError error = *to_be_said_;
  to_be_said_.reset();
  throw error;
}

State Instron8800Frame::state() const noexcept {
  State s;
  s.motion = motion_;
  s.segment_id = segment_.id;
  s.target_mm = echoed_target_mm_;
  s.velocity_mm_s = echoed_velocity_mm_s_;
  s.heartbeat_echo = beat_;
  if (beat_lost_) s.fault_bits |= kHeartbeatLost;
  if (status_code_ == kInstron8800TravelLimit) {
    s.fault_bits |= kTravelLimit;
  } else if (status_code_ == kInstron8800EmergencyStop) {
    s.fault_bits |= kInterlockOpen;
  } else if (describe_instron8800_status(status_code_) != nullptr || !actuator_on_ || !has_control_ || !watchdog_on_) {
    s.fault_bits |= kDriveFault;
  }
  return s;
}

}  // namespace isorig::frame
