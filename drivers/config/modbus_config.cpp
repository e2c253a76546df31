#include "drivers/config/modbus_config.hpp"

namespace isorig::modbus {

std::string ModbusConfig::where() const {
  return transport == ModbusTransport::kTcp ? "tcp " + host + ":" + std::to_string(port) : "rtu " + tty;
}

ModbusConfig read_modbus_config(const base::TomlTable& frame, const std::filesystem::path& directory) {
  ModbusConfig config;
  const auto map_file = frame.string("map");
  if (!map_file.empty()) config.map = read_register_map(directory / map_file);

  if (frame.choice("transport", {"tcp", "rtu"}) == "tcp") {
    config.host = frame.string("host");
    config.port = static_cast<std::uint16_t>(frame.integer("port", {1.0, 65535.0}));
  } else {
    config.transport = ModbusTransport::kRtu;
    config.tty = frame.string("tty");
    config.baud = static_cast<int>(frame.integer("baud", {1200.0, 4000000.0}));
    const auto parity = frame.choice_or("parity", "none", {"none", "even", "odd"});
    config.parity = parity == "even" ? 'E' : parity == "odd" ? 'O' : 'N';
    config.data_bits = static_cast<int>(frame.integer_or("data_bits", 8, {7.0, 8.0}));
    config.stop_bits = static_cast<int>(frame.integer_or("stop_bits", 1, {1.0, 2.0}));
    config.frame_gap_us = static_cast<int>(frame.integer_or("frame_gap_us", 0, {0.0, 100000.0}));
  }
  config.response_timeout_ms =
      static_cast<int>(frame.integer_or("response_timeout_ms", config.response_timeout_ms, {1.0, 10000.0}));
  config.connect_timeout_ms =
      static_cast<int>(frame.integer_or("connect_timeout_ms", config.connect_timeout_ms, {1.0, 10000.0}));
  config.start_confirm_ms =
      static_cast<int>(frame.integer_or("start_confirm_ms", config.start_confirm_ms, {1.0, 10000.0}));

  const auto expect = [&](std::string_view key, bool mapped) {
    const auto text = frame.string_or(key, "");
    if (!text.empty() && !mapped && !map_file.empty()) {
      frame.error(key, "`" + std::string(key) +
                           "` cannot be checked: the register map has no such text under "
                           "[identity]");
    }
    return text;
  };
  config.expected_maker = expect("maker", config.map.maker.has_value());
  config.expected_model = expect("model", config.map.model.has_value());
  config.expected_serial = expect("serial", config.map.serial.has_value());
  return config;
}

}  // namespace isorig::modbus
