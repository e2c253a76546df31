#include "drivers/config/regulator_config.hpp"

namespace isorig::pressure {

RegulatorMap read_regulator_map(const std::filesystem::path& file) {
  const auto document = base::TomlDocument::parse_file(file);
  const auto root = document.root();
  RegulatorMap map;
  (void)root.choice_or("format", "isorig-regulator-map/1", {"isorig-regulator-map/1"});  // files of before have none
  map.name = root.string("name");
  map.unit_id = static_cast<std::uint8_t>(root.integer_or("unit_id", 1, {1.0, 247.0}));
  const auto base = root.integer_or("address_base", 0, {0.0, 1.0});
  const auto order = root.choice("word_order", {"ABCD", "CDAB", "BADC", "DCBA"});
  map.order = order == "CDAB"   ? modbus::WordOrder::kCDAB
              : order == "BADC" ? modbus::WordOrder::kBADC
              : order == "DCBA" ? modbus::WordOrder::kDCBA
                                : modbus::WordOrder::kABCD;
  const auto unit = root.choice("pressure_unit", {"psi", "bar", "kPa"});
  map.psi_per_unit = unit == "bar" ? 14.503773773 : unit == "kPa" ? 0.14503773773 : 1.0;

  const auto address = [&](const base::TomlTable& table, std::string_view key) {
    return static_cast<std::uint16_t>(table.integer(key, {static_cast<double>(base), 65'000.0}) - base);
  };
  const auto registers = root.table("registers");
  map.setpoint = address(registers, "setpoint");
  map.status = address(registers, "status");
  map.pressure = address(registers, "pressure");
  map.command = address(registers, "command");
  if (map.pressure < map.status || map.pressure > map.status + 100) {
    registers.error("pressure", "`pressure` has to follow `status` within 100 registers: one request reads both");
  }
  const auto commands = root.table("commands");
  const auto code = [&](std::string_view key) {
    return static_cast<std::uint16_t>(commands.integer(key, {0.0, 65'535.0}));
  };
  map.valve_command = code("valve");
  map.cancel = code("cancel");
  map.exhaust = code("exhaust");
  const auto flags = root.table("status_bits");
  const auto bits = [&](std::string_view key) {
    std::uint32_t all = 0;
    for (const double bit : flags.numbers(key, {0.0, 31.0})) all |= 1U << static_cast<unsigned>(bit);
    return all;
  };
  map.exhausting_bits = bits("exhausting");
  map.fault_bits = bits("fault");
  const auto known = root.table("known");
  map.known = address(known, "address");
  map.known_min = known.number("min", base::kPositive);
  map.known_max = known.number("max", base::kPositive);
  document.finish();
  return map;
}

RegulatorConfig read_regulator_config(const base::TomlTable& t, const std::filesystem::path& directory) {
  RegulatorConfig c;
  const auto file = t.string("map");
  if (!file.empty()) c.map = read_regulator_map(directory / file);
  auto& line = c.line;
  if (t.choice("transport", {"rtu", "tcp"}) == "tcp") {
    line.host = t.string("host");
    line.port = static_cast<std::uint16_t>(t.integer("port", {1.0, 65535.0}));
  } else {
    line.transport = modbus::ModbusTransport::kRtu;
    line.tty = t.string("tty");
    line.baud = static_cast<int>(t.integer_or("baud", 19'200, {1200.0, 921600.0}));
    const auto parity = t.choice_or("parity", "none", {"none", "even", "odd"});
    line.parity = parity == "even" ? 'E' : parity == "odd" ? 'O' : 'N';
    line.stop_bits = static_cast<int>(t.integer_or("stop_bits", 1, {1.0, 2.0}));
  }
  line.map.unit_id = static_cast<std::uint8_t>(t.integer_or("unit_id", c.map.unit_id, {1.0, 247.0}));
  line.response_timeout_ms = static_cast<int>(t.integer_or("response_timeout_ms", 200, {5.0, 10'000.0}));
  line.connect_timeout_ms = static_cast<int>(t.integer_or("connect_timeout_ms", 500, {5.0, 10'000.0}));
  c.max_psi = t.number("max_psi", base::kPositive);
  c.setpoint_tolerance_psi = t.number_or("setpoint_tolerance_psi", c.setpoint_tolerance_psi, base::kPositive);
  return c;
}

}  // namespace isorig::pressure
