#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "drivers/api/frame.hpp"
#include "drivers/config/register_map.hpp"

namespace isorig::sim {

/// The registers of a gateway whose map this is: what a frame says goes in, what a client wrote comes out.
/// No I/O; one thread.
class RegisterImage {
 public:
  explicit RegisterImage(const modbus::RegisterMap& map);

  void set_identity(const frame::Identity& identity, bool wrong);
  void set_state(const frame::State& state);
  void set_device_time_us(double device_us);
  /// Into the ring, then the counter, as a frame does it.
  void add_sample(const frame::Sample& sample);

  /// A client's write, in the holding registers. False when a register lies outside the map.
  [[nodiscard]] bool covers(std::uint16_t address, std::size_t count) const;
  void write(std::uint16_t address, std::span<const std::uint16_t> words);
  /// What a written quantity would be if `words` were written at `address`; nothing when they do not touch
  /// it.
  [[nodiscard]] std::optional<double> touched(modbus::Quantity quantity, std::uint16_t address,
                                              std::span<const std::uint16_t> words) const;
  [[nodiscard]] double written(modbus::Quantity quantity) const;

  /// The two areas, from register 0; the last register is size() - 1.
  [[nodiscard]] std::vector<std::uint16_t>& holding() noexcept { return holding_; }
  [[nodiscard]] std::vector<std::uint16_t>& input() noexcept { return input_; }

 private:
  [[nodiscard]] std::vector<std::uint16_t>& area(std::uint8_t function) noexcept {
    return function == 4 ? input_ : holding_;
  }
  void put(std::uint8_t function, std::size_t address, const modbus::NumberFormat& format, double value);
  void put(modbus::Quantity quantity, double value);
  void put_text(const std::optional<modbus::TextRegisters>& where, const std::string& text);

  const modbus::RegisterMap map_;
  std::vector<std::uint16_t> holding_, input_;
  std::uint32_t next_slot_ = 0;
};

}  // namespace isorig::sim
