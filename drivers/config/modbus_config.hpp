#pragma once
#include <cstdint>
#include <filesystem>
#include <string>

#include "base/toml_reader.hpp"
#include "drivers/config/register_map.hpp"

namespace isorig::modbus {

enum class ModbusTransport : std::uint8_t { kTcp, kRtu };

/// How to reach one frame gateway.
struct ModbusConfig {
  RegisterMap map;
  ModbusTransport transport = ModbusTransport::kTcp;

  std::string host = "127.0.0.1";  ///< an address; a name would bring the resolver's own time-outs in
  std::uint16_t port = 502;

  std::string tty;
  int baud = 115200;
  char parity = 'N';
  int data_bits = 8;
  int stop_bits = 1;
  /// Silence before each request. 0: 3.5 characters, at least 1.75 ms (Modbus over serial line
  /// V1.02, 2.5.1.1).
  int frame_gap_us = 0;

  /// For a whole answer, first byte to last. libmodbus' own 500 ms are far too long beside a heartbeat; too
  /// short makes every slow answer an error (libmodbus issue 776).
  int response_timeout_ms = 100;
  int connect_timeout_ms = 500;
  /// How long the frame may take from the start command to showing the segment in its state.
  int start_confirm_ms = 100;

  /// What the gateway has to say of itself; empty takes any.
  std::string expected_maker, expected_model, expected_serial;

  /// "tcp 127.0.0.1:502" or "rtu /dev/ttyUSB0", for messages.
  [[nodiscard]] std::string where() const;
};

/// Reads a rig's [frame] table; `map` in it is relative to `directory`. What is wrong in the table is noted
/// in its document (finish() it); what is wrong in the map is thrown as base::ConfigError.
[[nodiscard]] ModbusConfig read_modbus_config(const base::TomlTable& frame, const std::filesystem::path& directory);

}  // namespace isorig::modbus
