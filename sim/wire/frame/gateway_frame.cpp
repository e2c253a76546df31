#include "sim/wire/frame/gateway_frame.hpp"

#include <modbus/modbus.h>

#include <algorithm>

namespace isorig::sim {

using drivers::DeviceError;
using modbus::Quantity;

GatewayFrame::GatewayFrame(const modbus::RegisterMap& map, frame::Device& backend, FrameWireFaults& faults)
    : map_(map), backend_(backend), faults_(faults), image_(map) {
  samples_.resize(map_.samples.slots);
  identity_ = backend_.connect();
  image_.set_identity(identity_, false);
  refresh();
}

void GatewayFrame::refresh() {
  image_.set_identity(identity_, faults_.wrong_identity.load());
  if (faults_.freeze.load()) return;
  try {
    if (faults_.restart.exchange(false)) restart();
    for (;;) {
      const auto poll = backend_.poll(samples_);
      for (std::size_t i = 0; i < poll.samples; ++i) add_sample(samples_[i]);
      if (poll.has_exchange) {
        device_us_ = poll.exchange.device_tx_us;
      } else if (poll.samples > 0) {
        device_us_ = std::max(device_us_, static_cast<double>(samples_[poll.samples - 1].device_us));
      }
      image_.set_state(poll.state);
      image_.set_device_time_us(device_us_ - static_cast<double>(started_us_));
      if (poll.samples < samples_.size()) return;
    }
  } catch (const DeviceError&) {
    // The frame behind the gateway does not answer: the registers stand still, as they do in a real one.
  }
}

void GatewayFrame::restart() {
  backend_.stop();
  first_sequence_ = next_sequence_;
  started_us_ = static_cast<std::int64_t>(device_us_);
}

void GatewayFrame::add_sample(frame::Sample sample) {
  next_sequence_ = sample.sequence + 1;
  sample.sequence -= first_sequence_;
  sample.device_us -= started_us_;
  image_.add_sample(sample);
}

int GatewayFrame::spoil_stop() {
  if (const int silent_ms = faults_.stop.silent_ms.exchange(0); silent_ms > 0) {
    silent_until_ = std::chrono::steady_clock::now() + std::chrono::milliseconds(silent_ms);
    return kNoAnswer;
  }
  if (take_one(faults_.stop.cut)) {
    cut_ = true;
    return kNoAnswer;
  }
  if (take_one(faults_.stop.busy)) return MODBUS_EXCEPTION_SLAVE_OR_SERVER_BUSY;
  answer_late_ms_ = faults_.stop.late_ms.exchange(0);
  return 0;
}

int GatewayFrame::act(std::uint16_t address, std::span<const std::uint16_t> words) {
  if (!image_.covers(address, words.size())) return MODBUS_EXCEPTION_ILLEGAL_DATA_ADDRESS;
  if (faults_.freeze.load()) return 0;  // written, and nobody there to act on it
  const auto value = [&](Quantity quantity) {
    return image_.touched(quantity, address, words).value_or(image_.written(quantity));
  };
  try {
    if (const auto command = image_.touched(Quantity::kCommand, address, words)) {
      if (*command == map_.start_command) {
        if (faults_.refuse.load()) return MODBUS_EXCEPTION_SLAVE_OR_SERVER_FAILURE;
        backend_.start_segment({static_cast<std::uint16_t>(value(Quantity::kSegmentIdSetpoint)),
                                static_cast<float>(value(Quantity::kTargetSetpoint_mm)),
                                static_cast<float>(value(Quantity::kVelocitySetpoint_mm_s))});
      } else if (*command == map_.stop_command) {
        if (const auto instead = spoil_stop(); instead != 0) return instead;
        if (!take_one(faults_.stop.lost)) backend_.stop();
      } else {
        return MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE;
      }
    }
    if (const auto counter = image_.touched(Quantity::kHeartbeat, address, words)) {
      backend_.heartbeat(static_cast<std::uint16_t>(*counter));
    }
  } catch (const DeviceError& error) {
    return error.fault() == drivers::Fault::kRefused ? MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE
                                                     : MODBUS_EXCEPTION_SLAVE_OR_SERVER_FAILURE;
  }
  return 0;
}

}  // namespace isorig::sim
