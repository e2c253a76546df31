#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/toml_reader.hpp"
#include "drivers/api/frame.hpp"
#include "drivers/config/register_codec.hpp"

/// The register map of a frame gateway, from TOML (docs/wire-frame.md), used by the driver to talk to one and
/// by the emulator to be one. No I/O here.
namespace isorig::modbus {

/// What a register can mean. The TOML key under [registers] is quantity_name(); its unit is in the name.
enum class Quantity : std::uint8_t {
  kIdentityWord,         ///< a constant that tells this gateway from another
  kSampleRate_Hz,        ///< of the frame's own sampling
  kSampleCounter,        ///< of the newest complete sample in the ring
  kWriteIndex,           ///< ring slot, for gateways whose slot does not follow from the counter
  kDeviceTime_us,        ///< the frame's clock, now
  kNewestSampleTime_us,  ///< the frame's clock at the newest complete sample
  kState,
  kSegmentId,      ///< read back: the segment it executes or executed last
  kTarget_mm,      ///< read back
  kVelocity_mm_s,  ///< read back
  kTargetReached,  ///< not zero: there
  kFaultBits,
  kHeartbeatEcho,
  kSegmentIdSetpoint,  // written from here on
  kTargetSetpoint_mm,
  kVelocitySetpoint_mm_s,
  kHeartbeat,
  kCommand,
};
inline constexpr std::size_t kQuantities = 18;
[[nodiscard]] std::string_view quantity_name(Quantity quantity) noexcept;
[[nodiscard]] constexpr bool is_written(Quantity quantity) noexcept {
  return quantity >= Quantity::kSegmentIdSetpoint;
}

/// How one number lies in registers: engineering value = number * scale + offset.
struct NumberFormat {
  RegisterType type = RegisterType::kUint16;
  WordOrder order = WordOrder::kABCD;
  double scale = 1.0;
  double offset = 0.0;

  [[nodiscard]] std::size_t registers() const noexcept { return registers_of(type); }
  [[nodiscard]] double decode(std::span<const std::uint16_t> words) const noexcept {
    return number_of(join_words(words, type, order), type) * scale + offset;
  }
  [[nodiscard]] std::optional<std::array<std::uint16_t, 2>> encode(double value) const noexcept;
  /// The largest difference between a value and what its registers say of it, near `value`.
  [[nodiscard]] double resolution(double value) const noexcept;
};

struct Register {
  std::uint16_t address = 0;  ///< as on the wire: the first register is 0
  NumberFormat format;
  std::uint8_t function = 3;  ///< 3 or 4 to read, 6 or 16 to write
};

/// A text of the identity, two characters a register, the first in the high byte, padded with 0 or spaces.
struct TextRegisters {
  std::uint16_t address = 0;
  std::uint16_t registers = 0;
  std::uint8_t function = 3;
};

/// The ring of samples.
struct SampleRing {
  std::uint16_t address = 0;  ///< of slot 0
  std::uint32_t slots = 0;
  std::uint16_t stride_registers = 0;
  std::uint8_t function = 3;
  struct Field {
    std::uint16_t at = 0;  ///< registers from the start of the slot
    NumberFormat format;
  };
  Field position_mm;
  Field force_N;
  std::optional<Field> time_us;  ///< absent: counted back from newest_sample_time_us at the sample rate

  enum class Slot : std::uint8_t {
    kCounterModulo,  ///< slot = counter mod slots
    kIndexOfNewest,  ///< write_index is the slot of the newest sample
    kIndexOfNext,    ///< write_index is the slot that is filled next
  };
  Slot slot = Slot::kCounterModulo;
};

/// Registers that one request reads together.
struct ReadBlock {
  std::uint16_t address = 0;
  std::uint16_t registers = 0;
  std::uint8_t function = 3;
  std::vector<Quantity> quantities;
};

struct RegisterMap {
  std::string name;
  std::uint8_t unit_id = 1;
  std::uint16_t max_read_registers = 125;   ///< 125 is the protocol's own limit
  std::uint16_t max_write_registers = 123;  ///< 123 is the protocol's own limit
  std::uint16_t bridge_gap_registers = 0;   ///< unmapped registers that may be read to join two blocks
  double sample_rate_Hz = 0.0;              ///< 0: the gateway says it in sample_rate_Hz
  std::uint16_t expected_identity_word = 0;

  std::array<std::optional<Register>, kQuantities> registers;
  std::optional<TextRegisters> maker, model, serial, firmware;
  SampleRing samples;
  std::map<std::uint16_t, frame::Motion> states;            ///< code in the state register -> meaning
  std::array<std::optional<std::uint8_t>, 6> fault_bit_at;  ///< bit of FaultBit i in the gateway's word
  std::uint16_t start_command = 1;
  std::uint16_t stop_command = 2;

  [[nodiscard]] const std::optional<Register>& at(Quantity quantity) const noexcept {
    return registers[static_cast<std::size_t>(quantity)];
  }
  /// The block that holds counter, index, device time and newest sample's time: what has to be of one moment.
  [[nodiscard]] ReadBlock header_block() const;
  /// The other blocks that hold what poll() reads of the state, without what the header brings already.
  [[nodiscard]] std::vector<ReadBlock> state_blocks() const;
  [[nodiscard]] frame::Motion motion_of(std::uint16_t code) const noexcept;
  [[nodiscard]] std::uint16_t state_code_of(frame::Motion motion) const noexcept;
  /// The gateway's fault word as FaultBit; a bit nobody named counts as a drive fault.
  [[nodiscard]] std::uint16_t fault_bits_of(std::uint16_t word) const noexcept;
  [[nodiscard]] std::uint16_t fault_word_of(std::uint16_t bits) const noexcept;
  /// Slot of sample `sequence` when the newest is `newest` and the write index reads `index`.
  [[nodiscard]] std::uint32_t slot_of(std::uint32_t sequence, std::uint32_t newest, std::uint32_t index) const noexcept;
};

/// Throws base::ConfigError with everything that is wrong, each with file:line:column.
[[nodiscard]] RegisterMap read_register_map(const std::filesystem::path& path);
[[nodiscard]] RegisterMap read_register_map(const base::TomlDocument& document);

}  // namespace isorig::modbus
