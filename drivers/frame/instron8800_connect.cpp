#include <algorithm>
#include <cmath>

#include "base/number_text.hpp"
#include "drivers/api/error.hpp"
#include "drivers/frame/instron8800_frame.hpp"
#include "drivers/frame/instron8800_times.hpp"
#include "drivers/frame/instron8800_words.hpp"

namespace isorig::frame {

using drivers::DeviceError;
using drivers::Fault;

namespace {

using base::number_text;

constexpr double kAbsoluteRamp = 3.0;
constexpr std::string_view kTwoNumbers = "C904,1,0", kOneNumber = "C904,1";

}  // namespace

void Instron8800Frame::check_channels() {
  const auto scale = [&](int number_, const char* key, double expected, double unit, const char* unit_name) {
    const auto question = channel("Q308", number_);
    const double full_scale = ask_number(question, in_ms(2 * config_.response_timeout_ms)) * unit;
    if (!(full_scale > 0.0) || (expected > 0.0 && std::abs(full_scale - expected) > 1e-3 * expected)) {
      throw DeviceError(
          Fault::kIdentity,
          at() + question + " says a full scale of " + number_text(full_scale) + " " + unit_name +
              (expected > 0.0 ? ", and the rig's [frame] says " + std::string(key) + " = " + number_text(expected)
                              : "") +
              "; another transducer, another unit or another controller");
    }
    return full_scale;
  };
  mm_per_raw_ = scale(config_.position_channel, "position_full_scale_mm", config_.position_full_scale_mm, 1e3, "mm");
  N_per_raw_ = scale(config_.force_channel, "force_full_scale_N", config_.force_full_scale_N, 1.0, "N");
  if (ask_number("Q300", in_ms(2 * config_.response_timeout_ms)) != config_.position_channel) {
    throw DeviceError(Fault::kIdentity,
                      at() +
                          "the controller is not in position control (Q300); switch it at its panel, at "
                          "rest, and look what it does");
  }
}

/// Which form of C904 this controller has, by what it makes of Q904. Only questions: control stays where it is.
void Instron8800Frame::find_watchdog() {
  std::string answered;
  std::size_t numbers = 0;
  try {
    const auto answer = link_.ask({"Q904"}, in_ms(2 * config_.response_timeout_ms + 4 * config_.quiet_ms)).front();
    answered = "answered by " + in_quotes(answer.text);
    numbers = parse_numbers("Q904", answer.text, 1, 2).size();
  } catch (const DeviceError& error) {
    if (error.fault() == Fault::kDisconnected || error.fault() == Fault::kIdentity) throw;
    if (answered.empty()) answered = "not answered";
    link_.doubt();
    (void)ask_number("Q909", in_ms(4 * config_.response_timeout_ms));  // but it answers what it knows
  }
  watchdog_can_be_asked_ = numbers > 0;
  watchdog_command_ = config_.watchdog_command;
  if (watchdog_command_.empty()) watchdog_command_ = numbers == 2 ? kTwoNumbers : kOneNumber;
  if (!watchdog_can_be_asked_ && !config_.watchdog_tested) {
    throw DeviceError(Fault::kIdentity,
                      at() + "Q904 is " + answered +
                          ": this controller cannot say whether its watchdog is on, and without it nothing "
                          "would stop the actuator when this computer fails. Try it out as docs/wire-8800.md "
                          "says (" +
                          watchdog_command_ + "), then set watchdog_tested = true in [frame]");
  }
}

void Instron8800Frame::tell_known(std::string_view command) {
  if (const auto line = link_.tell_and_listen(command, in_ms(2 * config_.response_timeout_ms))) {
    throw DeviceError(Fault::kIdentity, at() + in_quotes(command) + " is a command and was answered, by " +
                                            in_quotes(*line) +
                                            ": this controller does not know it, or somebody else talks to it");
  }
}

void Instron8800Frame::take_control() {
  const auto ask = [&](std::string_view question) {
    return ask_number(question, in_ms(2 * config_.response_timeout_ms));
  };
  const bool was_ours = ask("Q909") == 1.0;
  if (!was_ours) tell_known("P909,1");
  if (!was_ours && ask("Q909") != 1.0) {
    throw DeviceError(Fault::kIdentity, at() + "the front panel keeps control (Q909); give it to the computer");
  }
  // Control that is ours already is that of a connection that broke. What it left moving is its watchdog's to stop, and
  // connections that break one after the other must not feed that: only the loop's heartbeat does.
  const bool watches = was_ours && watchdog_can_be_asked_ && ask("Q904") == config_.watchdog_on;
  if (!watches) {
    if (was_ours) tell_known("C1,0");
    tell_known(watchdog_command_);
    if (watchdog_can_be_asked_ && ask("Q904") != config_.watchdog_on) {
      throw DeviceError(Fault::kIdentity,
                        at() + "the controller's watchdog is not on (Q904) after \"" + watchdog_command_ +
                            "\"; without it nothing would stop the actuator when this computer fails. "
                            "Correct watchdog_command and watchdog_on in [frame], or leave them out");
    }
  }
  const auto ramp = channel("2", config_.position_channel);
  if (ask("Q" + ramp) != kAbsoluteRamp) {
    tell_known("C" + ramp + ",3");
    if (ask("Q" + ramp) != kAbsoluteRamp) {
      throw DeviceError(Fault::kIdentity, at() + "the position channel does not take the absolute ramp (C2)");
    }
  }
}

void Instron8800Frame::give_control_back() noexcept {
  try {
    if (link_.is_open()) link_.tell("P909,0");
  } catch (const std::exception&) {  // the panel's own button takes it
  }
}

/// From a question to its answer, the fastest of a few: what the line gives when nothing disturbs it.
double Instron8800Frame::measured_question_s() {
  std::int64_t best_ns = 1'000'000'000;
  for (int i = 0; i < 5; ++i) {
    const auto answer = link_.ask({text_of(Ask::kPosition)}, in_ms(2 * config_.response_timeout_ms)).front();
    best_ns = std::min(best_ns, answer.received_ns - answer.sent_ns);
  }
  return 1e-9 * static_cast<double>(std::max<std::int64_t>(best_ns, 1));
}

Identity Instron8800Frame::connect() {
  link_.open();
  bool took_control = false;
  try {
    // Whatever can be asked is asked before the panel loses control.
    check_channels();
    find_watchdog();
    take_status(static_cast<std::uint16_t>(ask_number("Q22", in_ms(2 * config_.response_timeout_ms))));
    actuator_on_ = ask_number("Q23", in_ms(2 * config_.response_timeout_ms)) != 0.0;
    took_control = true;
    take_control();
    has_control_ = watchdog_on_ = true;
    ailment_.clear();  // what ails it is said by the first poll
    early_.clear();
    to_be_said_.reset();
    forget_round();
    // What runs from before is not ours to judge: a stop has to be seen to work on it.
    motion_ = ask_number("Q1", in_ms(2 * config_.response_timeout_ms)) == kQ1Moving ? Motion::kMoving : Motion::kIdle;
    segment_ = {};
    not_before_ns_ = ramp_ns_ = 0;
    segment_.target_mm = std::nanf("");
    takes_sign_ = false;
    stop_since_ns_ = -1;
    stop_called_ns_ = kNever_ns;
    beat_seen_ = beat_lost_ = false;
    watchdog_seen_on_ = feed_wanted_ = false;
    told_ = state();
    Identity identity;
    identity.maker = "Instron";
    identity.model = "8800-type controller";
    identity.firmware =
        "watchdog " + watchdog_command_ + (watchdog_can_be_asked_ ? " (read back)" : " (cannot be read back)");
    const double question_s = measured_question_s(), gap_s = 1e-6 * config_.gap_us;
    const double characters_s = times_of(config_, 0.0).value_s - gap_s;  // the controller's part is beside them
    identity.firmware += ", answers in " + number_text(1e3 * std::max(0.0, question_s - characters_s), 2) + " ms";
    identity.sample_rate_hz = 1.0 / (3.0 * (question_s + gap_s));
    // Nothing in the command set tells a controller that was switched off meanwhile from one that was not.
    identity.reference_epoch = ++reference_epoch_;
    return identity;
  } catch (...) {
    if (took_control) give_control_back();
    link_.close();
    throw;
  }
}

void Instron8800Frame::disconnect() noexcept {
  if (!link_.is_open()) return;
  try {
    if (has_control_) link_.tell("C1,0");
    // In order, control goes back to the panel. After a fault it does not: the watchdog has its say.
    if (has_control_ && link_.in_step() && !link_.pending() && motion_ != Motion::kMoving) link_.tell("P909,0");
  } catch (const std::exception&) {  // the controller's watchdog stops the actuator
  }
  link_.close();
}

}  // namespace isorig::frame
