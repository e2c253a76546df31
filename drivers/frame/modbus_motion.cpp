#include <algorithm>
#include <cmath>

#include "base/number_text.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/frame/modbus_frame.hpp"

namespace isorig::frame {

using base::number_text;
using drivers::DeviceError;
using drivers::Fault;
using modbus::Quantity;

void ModbusFrame::write_setpoints(const Segment& segment) {
  struct Setpoint {
    Quantity quantity{};
    double value = 0.0;
    modbus::Register reg;
    std::array<std::uint16_t, 2> words{};
  };
  std::array<Setpoint, 3> setpoints;
  std::size_t count = 0;
  for (const auto& [quantity, value] : {std::pair{Quantity::kTargetSetpoint_mm, double{segment.target_mm}},
                                        std::pair{Quantity::kVelocitySetpoint_mm_s, double{segment.velocity_mm_s}},
                                        std::pair{Quantity::kSegmentIdSetpoint, static_cast<double>(segment.id)}}) {
    const auto& reg = *config_.map.at(quantity);
    const auto words = reg.format.encode(value);
    if (!words) {
      const auto range = modbus::range_of(reg.format.type);
      throw DeviceError(Fault::kRefused, at() + std::string(modbus::quantity_name(quantity)) + " = " +
                                             number_text(value) + " does not fit its register, which holds " +
                                             number_text(range.min * reg.format.scale + reg.format.offset) + " to " +
                                             number_text(range.max * reg.format.scale + reg.format.offset));
    }
    setpoints[count++] = {quantity, value, reg, *words};
  }
  std::sort(setpoints.begin(), setpoints.end(),
            [](const Setpoint& a, const Setpoint& b) { return a.reg.address < b.reg.address; });

  // Neighbours go out in one request, as far as function 16 reaches.
  std::array<std::uint16_t, 6> words_of_all{}, back_of_all{};
  for (std::size_t i = 0; i < setpoints.size();) {
    std::size_t size = 0, j = i;
    do {
      const auto& setpoint = setpoints[j];
      std::copy_n(setpoint.words.begin(), setpoint.reg.format.registers(),
                  words_of_all.begin() + static_cast<std::ptrdiff_t>(size));
      size += setpoint.reg.format.registers();
      ++j;
    } while (j < setpoints.size() && setpoints[i].reg.function == 16 && setpoints[j].reg.function == 16 &&
             setpoints[j].reg.address == setpoints[i].reg.address + size);
    const std::uint16_t address = setpoints[i].reg.address;
    const auto words = std::span(words_of_all).first(size), back = std::span(back_of_all).first(size);
    link_.write(setpoints[i].reg.function, address, words);
    // The answer to a write echoes what was sent, not what the frame made of it.
    link_.read(3, address, back);
    if (!std::equal(words.begin(), words.end(), back.begin())) {
      std::string text = at() + "the frame changed the set-points it was given:";
      for (; i < j; ++i) {
        const auto from = static_cast<std::size_t>(setpoints[i].reg.address - address);
        text += " " + std::string(modbus::quantity_name(setpoints[i].quantity)) + " " +
                number_text(setpoints[i].value) + " -> " +
                number_text(setpoints[i].reg.format.decode(back.subspan(from)));
      }
      throw DeviceError(Fault::kRefused, text + "; nothing was started. Check the frame's own limits");
    }
    i = j;
  }
}

void ModbusFrame::write_command(std::uint16_t command) {
  const auto& reg = *config_.map.at(Quantity::kCommand);
  const auto words = modbus::split_words(command, reg.format.type, reg.format.order);
  link_.write(reg.function, reg.address, std::span(words).first(reg.format.registers()));
}

void ModbusFrame::start_segment(const Segment& segment) {
  if (!std::isfinite(segment.target_mm) || !std::isfinite(segment.velocity_mm_s) || segment.velocity_mm_s <= 0.0F) {
    throw DeviceError(Fault::kRefused, at() + "a segment needs a finite target and a velocity above 0, not " +
                                           number_text(double{segment.target_mm}) + " mm at " +
                                           number_text(double{segment.velocity_mm_s}) + " mm/s");
  }
  limit_to(kRequestsAtOnce);
  write_setpoints(segment);
  bool refused = true;
  try {
    try {
      write_command(config_.map.start_command);
    } catch (const DeviceError& error) {
      // Refused: nothing new runs, and what ran before is not ours to stop. No answer: it may have started.
      refused = error.fault() == Fault::kRefused;
      throw;
    }
    refused = false;
    confirm(segment);
  } catch (const DeviceError&) {
    if (refused) throw;
    try {
      stop();
    } catch (const DeviceError&) {  // the first error says more; the frame's heartbeat time-out stops it
    }
    throw;
  }
}

void ModbusFrame::confirm(const Segment& segment) {
  const auto tolerance = [&](Quantity a, Quantity b, double value) {
    return 1.01 * (config_.map.at(a)->format.resolution(value) + config_.map.at(b)->format.resolution(value));
  };
  const double target_tolerance_mm =
      tolerance(Quantity::kTarget_mm, Quantity::kTargetSetpoint_mm, double{segment.target_mm});
  const double velocity_tolerance_mm_s =
      tolerance(Quantity::kVelocity_mm_s, Quantity::kVelocitySetpoint_mm_s, double{segment.velocity_mm_s});
  clock::RealClock real;
  const std::int64_t until_ns = real.now_ns() + std::int64_t{config_.start_confirm_ms} * 1'000'000;
  link_.limit(until_ns + std::int64_t{config_.response_timeout_ms} * 1'000'000);
  State state;
  do {
    std::array<std::uint16_t, 125> words{};
    const auto part = std::span(words).first(header_block_.registers);
    link_.read(header_block_.function, header_block_.address, part);
    take_words(header_block_, part);
    read_state_blocks();
    state = decode_state();
    const bool runs = state.motion == Motion::kMoving || state.motion == Motion::kReached;
    if (runs && state.segment_id == segment.id &&
        std::abs(double{state.target_mm} - double{segment.target_mm}) <= target_tolerance_mm &&
        std::abs(double{state.velocity_mm_s} - double{segment.velocity_mm_s}) <= velocity_tolerance_mm_s) {
      return;
    }
    real.sleep_until_ns(real.now_ns() + 1'000'000);
  } while (real.now_ns() < until_ns);
  throw DeviceError(Fault::kRefused,
                    at() + "segment " + std::to_string(segment.id) + " to " + number_text(double{segment.target_mm}) +
                        " mm at " + number_text(double{segment.velocity_mm_s}) + " mm/s was sent, and after " +
                        std::to_string(config_.start_confirm_ms) + " ms the frame shows segment " +
                        std::to_string(state.segment_id) + " to " + number_text(double{state.target_mm}) + " mm at " +
                        number_text(double{state.velocity_mm_s}) + " mm/s, state " +
                        std::to_string(code(Quantity::kState)) + ", faults " + std::to_string(state.fault_bits) +
                        "; it was stopped. Look at the frame's own panel");
}

void ModbusFrame::stop() {
  const auto& reg = *config_.map.at(Quantity::kCommand);
  const auto words = modbus::split_words(config_.map.stop_command, reg.format.type, reg.format.order);
  link_.limit(0);
  link_.write_at_once(reg.function, reg.address, std::span(words).first(reg.format.registers()));
}

void ModbusFrame::heartbeat(std::uint16_t counter) {
  link_.limit(0);
  const auto& reg = *config_.map.at(Quantity::kHeartbeat);
  const auto words = modbus::split_words(counter, reg.format.type, reg.format.order);
  link_.write(reg.function, reg.address, std::span(words).first(reg.format.registers()));
}

}  // namespace isorig::frame
