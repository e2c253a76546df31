#include "drivers/config/register_map.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::modbus {
namespace {

constexpr std::array<std::string_view, kQuantities> kNames{
    "identity_word",          "sample_rate_Hz", "sample_counter", "write_index",         "device_time_us",
    "newest_sample_time_us",  "state",          "segment_id",     "target_mm",           "velocity_mm_s",
    "target_reached",         "fault_bits",     "heartbeat_echo", "segment_id_setpoint", "target_setpoint_mm",
    "velocity_setpoint_mm_s", "heartbeat",      "command"};

/// What poll() reads. The identity and the rate are read once, at connect().
bool is_polled(Quantity quantity) {
  return quantity >= Quantity::kSampleCounter && quantity <= Quantity::kHeartbeatEcho;
}

}  // namespace

std::string_view quantity_name(Quantity quantity) noexcept {
  return kNames[static_cast<std::size_t>(quantity)];
}

std::optional<std::array<std::uint16_t, 2>> NumberFormat::encode(double value) const noexcept {
  const auto bits = bits_of((value - offset) / scale, type);
  if (!bits) return std::nullopt;
  return split_words(*bits, type, order);
}

double NumberFormat::resolution(double value) const noexcept {
  if (type != RegisterType::kFloat32) return std::abs(scale) / 2.0;
  // Half a unit in the last place of the float, on either side of the conversion.
  return std::abs(scale) * std::max(1e-30, std::abs((value - offset) / scale) * 1.2e-7);
}

namespace {

/// All requests a poll of the status needs: runs of polled registers of one function without larger gaps than
/// the map allows.
std::vector<ReadBlock> polled_blocks(const RegisterMap& map) {
  struct Item {
    Quantity quantity;
    Register reg;
  };
  std::vector<Item> items;
  for (std::size_t i = 0; i < kQuantities; ++i) {
    const auto quantity = static_cast<Quantity>(i);
    if (is_polled(quantity) && map.at(quantity)) items.push_back({quantity, *map.at(quantity)});
  }
  std::sort(items.begin(), items.end(), [](const Item& a, const Item& b) {
    return std::pair(a.reg.function, a.reg.address) < std::pair(b.reg.function, b.reg.address);
  });
  std::vector<ReadBlock> blocks;
  for (const auto& item : items) {
    const std::uint32_t end = item.reg.address + static_cast<std::uint32_t>(item.reg.format.registers());
    if (!blocks.empty()) {
      auto& last = blocks.back();
      const std::uint32_t last_end = static_cast<std::uint32_t>(last.address) + last.registers;
      if (last.function == item.reg.function && item.reg.address <= last_end + map.bridge_gap_registers &&
          end - last.address <= map.max_read_registers) {
        last.registers = static_cast<std::uint16_t>(std::max(end, last_end) - last.address);
        last.quantities.push_back(item.quantity);
        continue;
      }
    }
    blocks.push_back(
        {item.reg.address, static_cast<std::uint16_t>(end - item.reg.address), item.reg.function, {item.quantity}});
  }
  return blocks;
}

bool holds_counter(const ReadBlock& block) {
  return std::find(block.quantities.begin(), block.quantities.end(), Quantity::kSampleCounter) !=
         block.quantities.end();
}

}  // namespace

ReadBlock RegisterMap::header_block() const {
  for (auto& block : polled_blocks(*this)) {
    if (holds_counter(block)) return block;
  }
  return {};
}

std::vector<ReadBlock> RegisterMap::state_blocks() const {
  auto blocks = polled_blocks(*this);
  std::erase_if(blocks, holds_counter);
  return blocks;
}

frame::Motion RegisterMap::motion_of(std::uint16_t code) const noexcept {
  const auto found = states.find(code);
  return found == states.end() ? frame::Motion::kFault : found->second;  // a state nobody named is not a good one
}

std::uint16_t RegisterMap::state_code_of(frame::Motion motion) const noexcept {
  for (const auto& [code, meaning] : states) {
    if (meaning == motion) return code;
  }
  return 0;
}

std::uint16_t RegisterMap::fault_bits_of(std::uint16_t word) const noexcept {
  unsigned bits = 0, known = 0;
  for (std::size_t i = 0; i < fault_bit_at.size(); ++i) {
    if (!fault_bit_at[i]) continue;
    const unsigned mask = 1U << *fault_bit_at[i];
    known |= mask;
    if ((word & mask) != 0) bits |= 1U << i;
  }
  if ((word & ~known) != 0) bits |= frame::kDriveFault;
  return static_cast<std::uint16_t>(bits);
}

std::uint16_t RegisterMap::fault_word_of(std::uint16_t bits) const noexcept {
  unsigned word = 0;
  for (std::size_t i = 0; i < fault_bit_at.size(); ++i) {
    if (fault_bit_at[i] && (bits & (1U << i)) != 0) word |= 1U << *fault_bit_at[i];
  }
  return static_cast<std::uint16_t>(word);
}

std::uint32_t RegisterMap::slot_of(std::uint32_t sequence, std::uint32_t newest, std::uint32_t index) const noexcept {
  if (samples.slot == SampleRing::Slot::kCounterModulo) return sequence % samples.slots;
  const std::uint32_t newest_slot = samples.slot == SampleRing::Slot::kIndexOfNewest
                                        ? index % samples.slots
                                        : (index + samples.slots - 1) % samples.slots;
  return (newest_slot + samples.slots - (newest - sequence) % samples.slots) % samples.slots;
}

}  // namespace isorig::modbus
