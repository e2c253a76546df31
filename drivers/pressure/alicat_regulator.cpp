#include "drivers/pressure/alicat_regulator.hpp"

#include <array>
#include <cmath>

#include "base/number_text.hpp"

namespace isorig::pressure {

using drivers::DeviceError;
using drivers::Fault;
using modbus::RegisterType;
using modbus::WordOrder;

namespace {

using base::number_text;

double float_of(std::span<const std::uint16_t> words, WordOrder order) {
  return modbus::number_of(modbus::join_words(words, RegisterType::kFloat32, order), RegisterType::kFloat32);
}

/// Its answer's length differs from that of every other request but the state's, as ModbusLink wants of a probe.
modbus::ReadBlock probe_of(const RegulatorMap& map) {
  modbus::ReadBlock block;
  block.address = map.status;
  block.registers = static_cast<std::uint16_t>(map.pressure + 2 - map.status);
  return block;
}

}  // namespace

AlicatRegulator::AlicatRegulator(RegulatorConfig config)
    : config_(std::move(config)), link_(config_.line, probe_of(config_.map), "regulator") {}

double AlicatRegulator::read_float(std::uint16_t address) {
  std::array<std::uint16_t, 2> words{};
  link_.read(3, address, words);
  return float_of(words, config_.map.order);
}

/// Word order, unit and address base in one: a number that is known while nothing has pressure.
void AlicatRegulator::check_known() {
  const auto& map = config_.map;
  std::array<std::uint16_t, 2> words{};
  link_.read(3, map.known, words);
  const auto fits = [&](double value) { return value >= map.known_min && value <= map.known_max; };
  const double value = float_of(words, map.order);
  if (fits(value)) return;
  std::string hint = "; check pressure_unit and address_base";
  constexpr std::array<std::pair<WordOrder, const char*>, 4> kOrders{
      {{WordOrder::kABCD, "ABCD"}, {WordOrder::kCDAB, "CDAB"}, {WordOrder::kBADC, "BADC"}, {WordOrder::kDCBA, "DCBA"}}};
  for (const auto& [order, name] : kOrders) {
    if (fits(float_of(words, order))) hint = std::string("; with word_order = \"") + name + "\" it would be right";
  }
  throw DeviceError(Fault::kIdentity, at() + "the known register reads " + number_text(value) + ", and map \"" +
                                          map.name + "\" says " + number_text(map.known_min) + " to " +
                                          number_text(map.known_max) + hint);
}

std::string AlicatRegulator::connect() {
  link_.open();
  try {
    check_known();
    exhaust();
    const auto state = read();
    return "pressure regulator (" + config_.map.name + "), reads " + number_text(double{state.pressure_psi}) + " psi";
  } catch (...) {
    link_.close();
    throw;
  }
}

void AlicatRegulator::disconnect() noexcept {
  link_.close();
}

void AlicatRegulator::write_setpoint(double psi) {
  const auto& map = config_.map;
  const auto bits = modbus::bits_of(psi / map.psi_per_unit, RegisterType::kFloat32);
  const auto words = modbus::split_words(bits.value(), RegisterType::kFloat32, map.order);
  link_.write(16, map.setpoint, words);
  const double back_psi = read_float(map.setpoint) * map.psi_per_unit;
  if (!(std::abs(back_psi - psi) <= config_.setpoint_tolerance_psi)) {
    throw DeviceError(Fault::kRefused, at() + "the set-point " + number_text(psi) + " psi was read back as " +
                                           number_text(back_psi) +
                                           " psi; check its own limits, and that it takes its set-point from the bus");
  }
}

void AlicatRegulator::valve(std::uint16_t argument) {
  const std::array<std::uint16_t, 2> words{config_.map.valve_command, argument};
  link_.write(16, config_.map.command, words);
}

void AlicatRegulator::regulate(float setpoint_psi) {
  if (!(setpoint_psi >= 0.0F && setpoint_psi <= static_cast<float>(config_.max_psi))) {
    throw DeviceError(Fault::kRefused, at() + "a set-point of " + number_text(double{setpoint_psi}) +
                                           " psi is outside 0 to max_psi = " + number_text(config_.max_psi));
  }
  write_setpoint(double{setpoint_psi});
  if (exhausting_) valve(config_.map.cancel);
  exhausting_ = false;
}

/// The valve first: it is what lets the air out.
void AlicatRegulator::exhaust() {
  exhausting_ = true;
  valve(config_.map.exhaust);
  write_setpoint(0.0);
}

RegulatorState AlicatRegulator::read() {
  const auto& map = config_.map;
  std::array<std::uint16_t, 125> words{};
  const auto block = std::span(words).first(static_cast<std::size_t>(map.pressure + 2 - map.status));
  link_.read(3, map.status, block);
  const auto flags = modbus::join_words(block, RegisterType::kUint32, map.order);
  const double pressure =
      float_of(block.subspan(static_cast<std::size_t>(map.pressure - map.status)), map.order) * map.psi_per_unit;
  if (!std::isfinite(pressure) || std::abs(pressure) > 1e4) {
    throw DeviceError(Fault::kProtocol, at() + "its pressure reads " + number_text(pressure) + " psi");
  }
  const double setpoint = read_float(map.setpoint) * map.psi_per_unit;
  if (!std::isfinite(setpoint) || std::abs(setpoint) > 1e4) {
    throw DeviceError(Fault::kProtocol, at() + "its set-point reads " + number_text(setpoint) + " psi");
  }
  RegulatorState state;
  state.setpoint_psi = static_cast<float>(setpoint);
  state.pressure_psi = static_cast<float>(pressure);
  state.exhausting = (flags & map.exhausting_bits) != 0;
  state.faulty = (flags & map.fault_bits) != 0;
  return state;
}

}  // namespace isorig::pressure
