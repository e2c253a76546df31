#include "sim/wire/frame/register_image.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace isorig::sim {

using modbus::Quantity;

RegisterImage::RegisterImage(const modbus::RegisterMap& map) : map_(map) {
  std::size_t holding = 0, input = 0;
  const auto cover = [&](std::uint8_t function, std::size_t end) {
    auto& size = function == 4 ? input : holding;
    size = std::max(size, end);
  };
  for (const auto& reg : map_.registers) {
    if (reg) cover(reg->function, reg->address + reg->format.registers());
  }
  for (const auto* text : {&map_.maker, &map_.model, &map_.serial, &map_.firmware}) {
    if (*text) cover((*text)->function, std::size_t{(*text)->address} + (*text)->registers);
  }
  const auto& ring = map_.samples;
  cover(ring.function, ring.address + std::size_t{ring.slots} * ring.stride_registers);
  holding_.resize(holding);
  input_.resize(input);
}

void RegisterImage::put(std::uint8_t function, std::size_t address, const modbus::NumberFormat& format, double value) {
  auto bits = std::bit_cast<std::uint32_t>(static_cast<float>((value - format.offset) / format.scale));
  if (format.type != modbus::RegisterType::kFloat32) {
    // A gateway saturates what its registers cannot hold.
    const auto range = modbus::range_of(format.type);
    const auto number = std::clamp((value - format.offset) / format.scale, range.min, range.max);
    bits = modbus::bits_of(number, format.type).value_or(0);
  }
  const auto words = modbus::split_words(bits, format.type, format.order);
  std::copy_n(words.begin(), format.registers(), area(function).begin() + static_cast<std::ptrdiff_t>(address));
}

void RegisterImage::put(Quantity quantity, double value) {
  if (const auto& reg = map_.at(quantity)) put(reg->function, reg->address, reg->format, value);
}

void RegisterImage::put_text(const std::optional<modbus::TextRegisters>& where, const std::string& text) {
  if (!where) return;
  const auto character = [&](std::size_t i) {
    return i < text.size() ? static_cast<unsigned>(static_cast<unsigned char>(text[i])) : 0U;
  };
  for (std::size_t i = 0; i < where->registers; ++i) {
    area(where->function)[where->address + i] =
        static_cast<std::uint16_t>((character(2 * i) << 8) | character(2 * i + 1));
  }
}

void RegisterImage::set_identity(const frame::Identity& identity, bool wrong) {
  put(Quantity::kIdentityWord, wrong ? map_.expected_identity_word ^ 0xFF : map_.expected_identity_word);
  put(Quantity::kSampleRate_Hz, identity.sample_rate_hz);
  put_text(map_.maker, identity.maker);
  put_text(map_.model, identity.model);
  put_text(map_.serial, wrong ? "not the frame" : identity.serial);
  put_text(map_.firmware, identity.firmware);
}

void RegisterImage::set_state(const frame::State& state) {
  put(Quantity::kState, map_.state_code_of(state.motion));
  put(Quantity::kSegmentId, state.segment_id);
  put(Quantity::kTarget_mm, double{state.target_mm});
  put(Quantity::kVelocity_mm_s, double{state.velocity_mm_s});
  put(Quantity::kTargetReached, state.motion == frame::Motion::kReached ? 1 : 0);
  put(Quantity::kFaultBits, map_.fault_word_of(state.fault_bits));
  put(Quantity::kHeartbeatEcho, state.heartbeat_echo);
}

namespace {

/// A clock in a register counts whole ticks and wraps.
double wrapped_us(const modbus::NumberFormat& format, double time_us) {
  const double turn = format.type == modbus::RegisterType::kUint16 ? 0x1p16 : 0x1p32;
  double ticks = std::fmod(std::floor(time_us / format.scale), turn);
  if (ticks < 0.0) ticks += turn;
  return ticks * format.scale;
}

}  // namespace

void RegisterImage::set_device_time_us(double device_us) {
  put(Quantity::kDeviceTime_us, wrapped_us(map_.at(Quantity::kDeviceTime_us)->format, device_us));
}

void RegisterImage::add_sample(const frame::Sample& sample) {
  const auto& ring = map_.samples;
  if (ring.slot == modbus::SampleRing::Slot::kCounterModulo) next_slot_ = sample.sequence % ring.slots;
  const std::size_t base = ring.address + std::size_t{next_slot_} * ring.stride_registers;
  const auto time_us = static_cast<double>(sample.device_us);
  put(ring.function, base + ring.position_mm.at, ring.position_mm.format, double{sample.position_mm});
  put(ring.function, base + ring.force_N.at, ring.force_N.format, double{sample.force_N});
  if (ring.time_us) {
    put(ring.function, base + ring.time_us->at, ring.time_us->format, wrapped_us(ring.time_us->format, time_us));
  }
  if (const auto& newest = map_.at(Quantity::kNewestSampleTime_us)) {
    put(Quantity::kNewestSampleTime_us, wrapped_us(newest->format, time_us));
  }
  const bool narrow = map_.at(Quantity::kSampleCounter)->format.type == modbus::RegisterType::kUint16;
  put(Quantity::kSampleCounter, narrow ? sample.sequence & 0xFFFFU : sample.sequence);
  const std::uint32_t newest_slot = next_slot_;
  next_slot_ = (next_slot_ + 1) % ring.slots;
  put(Quantity::kWriteIndex, ring.slot == modbus::SampleRing::Slot::kIndexOfNext ? next_slot_ : newest_slot);
}

bool RegisterImage::covers(std::uint16_t address, std::size_t count) const {
  return address + count <= holding_.size();
}

void RegisterImage::write(std::uint16_t address, std::span<const std::uint16_t> words) {
  std::copy(words.begin(), words.end(), holding_.begin() + address);
}

std::optional<double> RegisterImage::touched(Quantity quantity, std::uint16_t address,
                                             std::span<const std::uint16_t> words) const {
  const auto& reg = *map_.at(quantity);
  std::array<std::uint16_t, 2> merged{};
  bool any = false;
  for (std::size_t i = 0; i < reg.format.registers(); ++i) {
    const std::size_t at = reg.address + i;
    const bool here = at >= address && at < address + words.size();
    merged[i] = here ? words[at - address] : holding_[at];
    any = any || here;
  }
  if (!any) return std::nullopt;
  return reg.format.decode(merged);
}

double RegisterImage::written(Quantity quantity) const {
  const auto& reg = *map_.at(quantity);
  return reg.format.decode(std::span(holding_).subspan(reg.address));
}

}  // namespace isorig::sim
