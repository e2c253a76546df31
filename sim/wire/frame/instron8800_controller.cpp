#include "sim/wire/frame/instron8800_controller.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace isorig::sim {
namespace {

using drivers::DeviceError;

constexpr int kStopped = 0, kRunning = 1;
constexpr int kAbsoluteRamp = 3;
constexpr std::int64_t kBeat_ns = 100'000'000;

std::string decimal(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.8f", value);
  return text;
}

}  // namespace

Instron8800Controller::Instron8800Controller(const Instron8800Server::Options& options, frame::Device& backend,
                                             Instron8800Faults& faults)
    : options_(options), backend_(backend), faults_(faults), samples_(512), control_channel_(options.position_channel) {
  backend_.connect();
  backend_.heartbeat(++beat_);
  read_backend();
}

void Instron8800Controller::read_backend() {
  try {
    for (;;) {
      const auto poll = backend_.poll(samples_);
      if (poll.samples > 0) newest_ = samples_[poll.samples - 1];
      state_ = poll.state;
      if (poll.samples < samples_.size()) return;
    }
  } catch (const DeviceError&) {
    // The crosshead's own electronics are silent: the last values stay.
  }
}

void Instron8800Controller::advance(std::int64_t now_ns) {
  if (now_ns >= next_beat_ns_) {
    next_beat_ns_ = now_ns + kBeat_ns;
    try {
      backend_.heartbeat(++beat_);
    } catch (const DeviceError&) {
    }
  }
  read_backend();
  const bool watched = !faults_.panel.load() && !faults_.watchdog_off.load();
  if (!watched) {
    fed_ns_ = now_ns;
  } else if (static_cast<double>(now_ns - fed_ns_) > 1e9 * options_.watchdog_s) {
    ++watchdog_trips_;
    trip_actuator();
    faults_.panel = true;
  }
  if ((state_.fault_bits & frame::kInterlockOpen) != 0 && !faults_.actuator_off.load()) trip_actuator();
  if (options_.ends_ramps && movement_ == kRunning && state_.segment_id == segment_ &&
      state_.motion == frame::Motion::kReached) {
    movement_ = kStopped;
  }
  const bool must_stand = faults_.actuator_off.load() || faults_.limit.load() || faults_.panel.load();
  if (must_stand && movement_ == kRunning) stop_backend();
}

void Instron8800Controller::stop_backend() {
  movement_ = kStopped;
  try {
    backend_.stop();
  } catch (const DeviceError&) {
  }
}

void Instron8800Controller::restart() {
  stop_backend();
  channels_ = {};
  faults_.panel = faults_.watchdog_off = true;
}

void Instron8800Controller::trip_actuator() {
  stop_backend();
  faults_.actuator_off = true;
}

unsigned Instron8800Controller::status_code() const noexcept {
  if ((state_.fault_bits & frame::kInterlockOpen) != 0) return 6;
  if ((state_.fault_bits & frame::kDriveFault) != 0) return 2;
  if (faults_.limit.load() || (state_.fault_bits & (frame::kTravelLimit | frame::kForceLimit)) != 0) return 1;
  return 15;
}

std::optional<std::string> Instron8800Controller::execute(std::string_view line, std::int64_t now_ns) {
  if (line.size() < 2) return std::nullopt;
  const std::string rest(line.substr(1));
  std::vector<double> numbers;
  for (const char* at = rest.c_str();;) {
    char* end = nullptr;
    const double value = std::strtod(at, &end);
    if (end == at) return unknown();
    numbers.push_back(value);
    if (*end == '\0') break;
    if (*end != ',') return unknown();
    at = end + 1;
  }
  const int code = static_cast<int>(numbers.front());
  numbers.erase(numbers.begin());
  advance(now_ns);
  if (line.front() == 'Q') {
    auto text = answer(code, numbers);
    return text.empty() ? unknown() : std::optional(std::move(text));
  }
  if (line.front() == 'P' && code == 909 && !numbers.empty()) {
    faults_.panel = numbers[0] != 1.0;
    fed_ns_ = now_ns;
    return std::nullopt;
  }
  if (line.front() == 'C' && command(code, numbers, now_ns)) return std::nullopt;
  return unknown();
}

std::optional<std::string> Instron8800Controller::unknown() const {
  return options_.answers_unknown ? std::optional<std::string>("None of the device's commands matched.") : std::nullopt;
}

std::string Instron8800Controller::feedback(int channel) {
  if (channel == options_.position_channel)
    return decimal(double{newest_.position_mm} / options_.position_full_scale_mm);
  if (channel == options_.force_channel) return decimal(double{newest_.force_N} / options_.force_full_scale_N);
  return decimal(0.0);
}

std::string Instron8800Controller::answer(int code, const std::vector<double>& arguments) {
  const auto channel = arguments.empty() ? 0 : static_cast<int>(arguments[0]);
  const bool known = channel > 0 && channel < static_cast<int>(kChannels);
  const auto index = static_cast<std::size_t>(known ? channel : 0);
  switch (code) {
    case 1:
      return std::to_string(movement_);
    case 2:
      return known ? std::to_string(channels_[index].ramp) : "";
    case 4:
      return known ? decimal(channels_[index].amplitude) : "";
    case 22:
      return std::to_string(status_code() << 9U);
    case 23:
      return faults_.actuator_off.load() ? "0" : "1";
    case 86:
      return known ? decimal(channels_[index].time_s) : "";
    case 134:
      return known ? feedback(channel) : "";
    case 200:
      return std::to_string(waveform_);
    case 209:
      return std::to_string(quarter_counts_);
    case 300:
      return std::to_string(control_channel_);
    case 307:
      if (channel == options_.position_channel) return "0,3";
      return channel == options_.force_channel ? "0,2" : "0,4";
    case 308:
      if (channel == options_.position_channel) return decimal(options_.position_full_scale_mm * 1e-3);
      return decimal(options_.force_full_scale_N * (faults_.wrong_scale.load() ? 10.0 : 1.0));
    case 904: {
      const std::string on = faults_.watchdog_off.load() ? "0" : "1";
      if (options_.watchdog == Instron8800Server::Options::Watchdog::kNotAsked) return "";
      return options_.watchdog == Instron8800Server::Options::Watchdog::kTwoNumbers ? on + ",0" : on;
    }
    case 909:
      return faults_.panel.load() ? "0" : "1";
    default:
      return "";
  }
}

bool Instron8800Controller::command(int code, const std::vector<double>& a, std::int64_t now_ns) {
  if (a.empty()) return false;
  if (faults_.panel.load()) {
    trip_actuator();
    return true;
  }
  const bool channelled = a.size() > 1 && a[0] >= 1.0 && a[0] < static_cast<double>(kChannels);
  auto& channel = channels_[channelled ? static_cast<std::size_t>(a[0]) : 0];
  switch (code) {
    case 1:
      if (a[0] == kRunning) {
        start_ramp();
      } else {
        stop_backend();
      }
      return true;
    case 2:
      channel.ramp = static_cast<int>(a.back());
      return true;
    case 4:
      if (a.back() < 0.0 && !options_.takes_sign) return false;
      channel.amplitude = a.back();
      return true;
    case 23:
      if (a[0] == 0.0) {
        trip_actuator();
      } else {
        faults_.actuator_off = false;
      }
      return true;
    case 86:
      channel.time_s = faults_.clamp.load() ? std::max(a.back(), 1.0) : a.back();
      return true;
    case 200:
      waveform_ = a[0] == 1.0 ? 1 : 0;
      return true;
    case 209:
      quarter_counts_ = static_cast<long>(a[0]);
      return true;
    case 300:
      control_channel_ = static_cast<int>(a[0]);
      return true;
    case 904:
      if (a.size() != (options_.watchdog == Instron8800Server::Options::Watchdog::kTwoNumbers ? 2U : 1U)) return false;
      faults_.watchdog_off = a[0] == 0.0;
      fed_ns_ = now_ns;
      return true;
    default:
      return false;
  }
}

void Instron8800Controller::start_ramp() {
  const auto& channel = channels_[static_cast<std::size_t>(options_.position_channel)];
  if (faults_.actuator_off.load() || faults_.limit.load() || control_channel_ != options_.position_channel ||
      channel.ramp != kAbsoluteRamp || !(channel.time_s > 0.0)) {
    return;
  }
  const double target_mm = channel.amplitude * options_.position_full_scale_mm;
  const double velocity_mm_s = options_.ramp_of_scale_per_s > 0.0
                                   ? options_.ramp_of_scale_per_s * options_.position_full_scale_mm
                                   : std::abs(target_mm - double{newest_.position_mm}) / channel.time_s;
  try {
    backend_.start_segment(
        {++segment_, static_cast<float>(target_mm), static_cast<float>(std::max(velocity_mm_s, 1e-4))});
    movement_ = kRunning;  // and so it stays until somebody stops it, arrived or not, unless it ends its ramps
  } catch (const DeviceError&) {
    movement_ = kStopped;
  }
}

}  // namespace isorig::sim
