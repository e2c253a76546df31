#include <algorithm>
#include <cmath>
#include <limits>

#include "drivers/frame/modbus_frame.hpp"

/// ModbusFrame: who is there, is it the configured frame, and is it the same that was there before.
namespace isorig::frame {

using drivers::DeviceError;
using drivers::Fault;
using modbus::Quantity;

namespace {

/// The answer's time on the line, and the frame's clock against ours.
constexpr double kClockSlack_us = 50e3, kClockDrift = 1e-3;
/// Of a sample rate that a map or a register names.
constexpr double kRateError = 0.01;

}  // namespace

std::string ModbusFrame::read_text(const std::optional<modbus::TextRegisters>& text) {
  if (!text) return {};
  std::vector<std::uint16_t> words(text->registers);
  link_.read(text->function, text->address, words);
  std::string characters;
  for (const auto word : words) {
    characters += static_cast<char>(word >> 8);
    characters += static_cast<char>(word & 0xFF);
  }
  characters.resize(std::min(characters.find('\0'), characters.size()));
  while (!characters.empty() && characters.back() == ' ') characters.pop_back();
  return characters;
}

void ModbusFrame::check_identity(const Identity& identity) const {
  const auto expect = [&](const char* what, const std::string& expected, const std::string& found) {
    if (expected.empty() || expected == found) return;
    throw DeviceError(Fault::kIdentity, at() + what + " is \"" + found + "\" and the rig's [frame] names \"" +
                                            expected + "\"; connect the right frame or correct the rig file");
  };
  expect("maker", config_.expected_maker, identity.maker);
  expect("model", config_.expected_model, identity.model);
  expect("serial", config_.expected_serial, identity.serial);
}

Identity ModbusFrame::connect() {
  const auto& map = config_.map;
  link_.limit(0);
  link_.open();
  try {
    const auto read_value = [&](Quantity quantity) {
      const auto& reg = *map.at(quantity);
      std::array<std::uint16_t, 2> words{};
      link_.read(reg.function, reg.address, std::span(words).first(reg.format.registers()));
      return reg.format.decode(words);
    };
    if (map.at(Quantity::kIdentityWord)) {
      const auto word = static_cast<std::uint32_t>(read_value(Quantity::kIdentityWord));
      if (word != map.expected_identity_word) {
        throw DeviceError(Fault::kIdentity, at() + "identity word is " + std::to_string(word) + ", not " +
                                                std::to_string(map.expected_identity_word) + " as map \"" + map.name +
                                                "\" says; another gateway, or another map");
      }
    }
    Identity identity;
    identity.maker = read_text(map.maker);
    identity.model = read_text(map.model);
    identity.serial = read_text(map.serial);
    identity.firmware = read_text(map.firmware);
    identity.sample_rate_hz =
        map.at(Quantity::kSampleRate_Hz) ? read_value(Quantity::kSampleRate_Hz) : map.sample_rate_Hz;
    check_identity(identity);
    if (!(identity.sample_rate_hz > 0.0 && identity.sample_rate_hz < 1e6)) {
      throw DeviceError(Fault::kIdentity, at() + "sample rate reads " + std::to_string(identity.sample_rate_hz) +
                                              " Hz; check address, type and word_order of sample_rate_Hz");
    }
    resume_or_restart(identity);
    identity.reference_epoch = reference_epoch_;
    return identity;
  } catch (...) {
    link_.close();
    throw;
  }
}

void ModbusFrame::disconnect() noexcept {
  link_.close();
}

/// A restarted frame's clock reads anything, and its counter with it. The share of a turn that is let pass is the
/// chance that it is taken for the old one: an error of 1/64 to either side is 3 %. Longer breaks than that allows are
/// not told from a restart: with 1000 ppm 19 h for microseconds in 32 bits, 16 min for milliseconds in 16.
bool ModbusFrame::went_on(const Header& header) const noexcept {
  constexpr double kMostOfATurn = 1.0 / 64.0;
  const double elapsed_us = static_cast<double>(header.received_ns - anchor_ns_) / 1000.0;
  const double error_us = std::abs(header.device_us - anchor_device_us_ - elapsed_us);
  const double allowed_us = kClockSlack_us + kClockDrift * elapsed_us;
  const double clock_us = turn_us(config_.map.at(Quantity::kDeviceTime_us)->format);
  if (error_us > allowed_us || allowed_us > kMostOfATurn * clock_us) return false;

  // To either side, within the counter's width: it has no business to be slow.
  const double turn = static_cast<double>(newer_by(0, 1)) + 1.0;
  const double expected = static_cast<double>(header.received_ns - advanced_ns_) * 1e-9 * rate_Hz_;
  const double off = std::remainder(static_cast<double>(newer_by(header.counter, newest_counter_)) - expected, turn);
  const double allowed = kAdvanceSlack + kRateError * expected;
  return std::abs(off) <= allowed && allowed <= turn / 8.0 && expected + off > -0.5;  // nor does it go back
}

/// The same frame that never stopped counting goes on; anything else starts anew.
void ModbusFrame::resume_or_restart(const Identity& identity) {
  rate_Hz_ = identity.sample_rate_hz;
  Header header = read_header();
  if (has_history_) has_history_ = identity.serial == serial_ && went_on(header);
  if (!has_history_) {
    header = read_header();  // device time without the old epoch
    has_history_ = true;
    ++reference_epoch_;
    sequence_ = counter_ = newest_counter_ = header.counter;
    const bool is_dated = config_.map.at(Quantity::kNewestSampleTime_us).has_value();
    last_sample_us_ = is_dated ? header.newest_us : -std::numeric_limits<double>::infinity();
    advanced_ns_ = anchor_ns_ = header.received_ns;
    anchor_device_us_ = last_device_us_ = header.device_us;
  }
  serial_ = identity.serial;
}

}  // namespace isorig::frame
