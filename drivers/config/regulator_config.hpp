#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "base/toml_reader.hpp"
#include "drivers/config/modbus_config.hpp"
#include "drivers/config/register_codec.hpp"

namespace isorig::pressure {

/// Where a regulator keeps its numbers (config/regulators/*.toml, docs/wire-regulator.md). Addresses are those of the
/// wire, from 0. Numbers are float32, status flags uint32, command and argument neighbours of 16 bit.
struct RegulatorMap {
  std::string name;
  std::uint8_t unit_id = 1;
  modbus::WordOrder order = modbus::WordOrder::kABCD;
  double psi_per_unit = 1.0;
  std::uint16_t setpoint = 0, status = 0, pressure = 0, command = 0;
  std::uint16_t valve_command = 6, cancel = 0, exhaust = 3;
  std::uint32_t exhausting_bits = 0, fault_bits = 0;
  /// A number that is known before anything has pressure, in the regulator's unit: it tells a wrong word order, a base
  /// that is off by one and a wrong unit apart from right ones.
  std::uint16_t known = 0;
  double known_min = 0.0, known_max = 0.0;
};

/// [regulator] of a rig.
struct RegulatorConfig {
  RegulatorMap map;
  modbus::ModbusConfig line;             ///< transport and time-outs; its register map is not used
  double max_psi = 0.0;                  ///< no set-point above it is sent
  double setpoint_tolerance_psi = 0.01;  ///< of what is read back
};

[[nodiscard]] RegulatorMap read_regulator_map(const std::filesystem::path& file);
/// Reads a rig's [regulator] but for what the daemon's own parts read from it.
[[nodiscard]] RegulatorConfig read_regulator_config(const base::TomlTable& table,
                                                    const std::filesystem::path& directory);

}  // namespace isorig::pressure
