#include <algorithm>
#include <string>

#include "drivers/config/register_map.hpp"

namespace isorig::modbus {
namespace {

using base::TomlTable;

constexpr std::array<std::string_view, 7> kMotionNames{"idle",  "moving", "reached", "stopped",
                                                       "limit", "fault",  "disabled"};
constexpr std::array<std::string_view, 6> kFaultNames{"heartbeat_lost", "travel_limit", "force_limit",
                                                      "interlock_open", "drive_fault",  "sample_buffer_overrun"};

struct Defaults {
  WordOrder order = WordOrder::kABCD;
  std::uint8_t read_function = 3;
  std::uint8_t write_function = 16;
  int address_base = 0;
};

WordOrder word_order(const TomlTable& table, WordOrder fallback) {
  if (!table.has("word_order")) return fallback;
  const auto name = table.choice("word_order", {"ABCD", "CDAB", "BADC", "DCBA"});
  if (name == "CDAB") return WordOrder::kCDAB;
  if (name == "BADC") return WordOrder::kBADC;
  if (name == "DCBA") return WordOrder::kDCBA;
  return WordOrder::kABCD;
}

NumberFormat number_format(const TomlTable& table, const Defaults& defaults) {
  NumberFormat format;
  const auto type = table.choice("type", {"uint16", "int16", "int32", "uint32", "float32"});
  format.type = type == "int16"    ? RegisterType::kInt16
                : type == "uint16" ? RegisterType::kUint16
                : type == "int32"  ? RegisterType::kInt32
                : type == "uint32" ? RegisterType::kUint32
                                   : RegisterType::kFloat32;
  format.order = word_order(table, defaults.order);
  format.scale = table.number_or("scale", 1.0);
  format.offset = table.number_or("offset", 0.0);
  if (format.scale == 0.0) {
    table.error("scale", "`scale` = 0 makes every value the same; give the engineering units of one count");
    format.scale = 1.0;
  }
  return format;
}

std::uint8_t function_code(const TomlTable& table, std::string_view key, std::uint8_t fallback, std::int64_t a,
                           std::int64_t b) {
  const auto code = table.integer_or(key, fallback);
  if (code != a && code != b) {
    table.error(key, "`" + std::string(key) + "` = " + std::to_string(code) + "; it has to be " + std::to_string(a) +
                         " or " + std::to_string(b));
    return fallback;
  }
  return static_cast<std::uint8_t>(code);
}

std::uint16_t address(const TomlTable& table, const Defaults& defaults, std::size_t registers) {
  const auto value = table.integer("address", {0.0, 65536.0}) - defaults.address_base;
  if (value < 0 || value + static_cast<std::int64_t>(registers) > 65536) {
    table.error("address", "`address` = " + std::to_string(value + defaults.address_base) +
                               " is outside the 65536 registers, which start at `address_base` = " +
                               std::to_string(defaults.address_base));
    return 0;
  }
  return static_cast<std::uint16_t>(value);
}

Register number_register(const TomlTable& table, Quantity quantity, const Defaults& defaults) {
  Register reg;
  reg.format = number_format(table, defaults);
  reg.address = address(table, defaults, reg.format.registers());
  if (is_written(quantity)) {
    reg.function = function_code(table, "write_function", defaults.write_function, 6, 16);
    if (reg.function == 6 && reg.format.registers() > 1) {
      table.error("type", "function 6 writes one register and `" + std::string(quantity_name(quantity)) +
                              "` takes two; set write_function = 16");
    }
  } else {
    reg.function = function_code(table, "read_function", defaults.read_function, 3, 4);
  }
  return reg;
}

/// Counters, indices, codes and bits are counted, not measured: anything but a plain unsigned number is a
/// mistake in the map. A clock may be scaled (a gateway that counts milliseconds), but not shifted.
void require_counted(const TomlTable& table, const NumberFormat& format, bool may_scale) {
  if (format.type != RegisterType::kUint16 && format.type != RegisterType::kUint32) {
    table.error("type", "this is counted and wraps: its type has to be \"uint16\" or \"uint32\"");
  }
  if (may_scale ? format.scale <= 0.0 : format.scale != 1.0) {
    table.error("scale", may_scale ? "a clock's `scale` (microseconds per count) has to be greater than 0"
                                   : "a counter or code has no `scale`");
  }
  if (format.offset != 0.0) table.error("offset", "a counter, clock or code has no `offset`");
}

void read_registers(const TomlTable& root, RegisterMap& map, const Defaults& defaults) {
  const auto registers = root.table("registers");
  for (std::size_t i = 0; i < kQuantities; ++i) {
    const auto quantity = static_cast<Quantity>(i);
    const auto table = registers.table_if(quantity_name(quantity));
    if (!table) continue;
    map.registers[i] = number_register(*table, quantity, defaults);
    const auto& format = map.registers[i]->format;
    switch (quantity) {
      case Quantity::kDeviceTime_us:
      case Quantity::kNewestSampleTime_us:
        require_counted(*table, format, true);
        break;
      case Quantity::kSampleRate_Hz:
      case Quantity::kTarget_mm:
      case Quantity::kVelocity_mm_s:
      case Quantity::kTargetSetpoint_mm:
      case Quantity::kVelocitySetpoint_mm_s:
        break;
      default:
        require_counted(*table, format, false);
    }
  }
  for (const auto quantity :
       {Quantity::kSampleCounter, Quantity::kDeviceTime_us, Quantity::kState, Quantity::kSegmentId,
        Quantity::kTarget_mm, Quantity::kVelocity_mm_s, Quantity::kSegmentIdSetpoint, Quantity::kTargetSetpoint_mm,
        Quantity::kVelocitySetpoint_mm_s, Quantity::kHeartbeat, Quantity::kCommand}) {
    if (!map.at(quantity)) {
      registers.error({}, "`" + std::string(quantity_name(quantity)) +
                              "` is missing here; the driver cannot run a frame without it");
    }
  }
}

std::optional<TextRegisters> text_registers(const TomlTable& identity, std::string_view key, const Defaults& defaults) {
  const auto table = identity.table_if(key);
  if (!table) return std::nullopt;
  TextRegisters text;
  text.registers = static_cast<std::uint16_t>(table->integer("registers", {1.0, 125.0}));
  text.address = address(*table, defaults, text.registers);
  text.function = function_code(*table, "read_function", defaults.read_function, 3, 4);
  return text;
}

void read_identity(const TomlTable& root, RegisterMap& map, const Defaults& defaults) {
  const auto identity = root.table("identity");
  map.maker = text_registers(identity, "maker", defaults);
  map.model = text_registers(identity, "model", defaults);
  map.serial = text_registers(identity, "serial", defaults);
  map.firmware = text_registers(identity, "firmware", defaults);
  const bool has_word = map.at(Quantity::kIdentityWord).has_value();
  if (has_word) {
    map.expected_identity_word = static_cast<std::uint16_t>(identity.integer("expected_word", {0.0, 65535.0}));
  } else if (!map.model && !map.serial) {
    identity.error({},
                   "nothing tells this gateway from another: map `identity_word` under [registers] (with "
                   "`expected_word` here), or the `model` or `serial` text");
  }
}

SampleRing::Field ring_field(const TomlTable& samples, std::string_view key, std::uint16_t stride,
                             const Defaults& defaults) {
  const auto table = samples.table(key);
  SampleRing::Field field;
  field.at = static_cast<std::uint16_t>(table.integer("slot_register", {0.0, 124.0}));
  field.format = number_format(table, defaults);
  if (field.at + field.format.registers() > stride) {
    table.error("slot_register",
                "the field ends after the slot's " + std::to_string(stride) + " registers (`stride_registers`)");
  }
  return field;
}

void read_samples(const TomlTable& root, RegisterMap& map, const Defaults& defaults) {
  const auto table = root.table("samples");
  auto& ring = map.samples;
  ring.slots = static_cast<std::uint32_t>(table.integer("slots", {4.0, 32768.0}));
  ring.stride_registers = static_cast<std::uint16_t>(table.integer("stride_registers", {1.0, 125.0}));
  ring.address = address(table, defaults, static_cast<std::size_t>(ring.slots) * ring.stride_registers);
  ring.function = function_code(table, "read_function", defaults.read_function, 3, 4);
  if (ring.stride_registers > map.max_read_registers) {
    table.error("stride_registers", "one sample does not fit in a request of `max_read_registers` = " +
                                        std::to_string(map.max_read_registers));
    ring.stride_registers = map.max_read_registers;
  }
  ring.position_mm = ring_field(table, "position_mm", ring.stride_registers, defaults);
  ring.force_N = ring_field(table, "force_N", ring.stride_registers, defaults);
  if (const auto time = table.table_if("time_us")) {
    ring.time_us = ring_field(table, "time_us", ring.stride_registers, defaults);
    require_counted(*time, ring.time_us->format, true);
  } else if (!map.at(Quantity::kNewestSampleTime_us)) {
    table.error({},
                "no sample can be dated: map `time_us` in each slot, or `newest_sample_time_us` under "
                "[registers]");
  }

  const auto slot = table.choice("slot_is", {"counter_modulo_slots", "index_of_newest", "index_of_next"});
  ring.slot = slot == "index_of_newest" ? SampleRing::Slot::kIndexOfNewest
              : slot == "index_of_next" ? SampleRing::Slot::kIndexOfNext
                                        : SampleRing::Slot::kCounterModulo;
  const auto& counter = map.at(Quantity::kSampleCounter);
  if (ring.slot == SampleRing::Slot::kCounterModulo) {
    // At the counter's wrap 2^n mod slots has to be 0, or the ring jumps.
    if ((ring.slots & (ring.slots - 1)) != 0) {
      table.error("slots", "`slots` = " + std::to_string(ring.slots) +
                               " is no power of two, so the slot jumps where the counter wraps; a gateway with "
                               "such a ring has to give a `write_index`");
    }
  } else if (!map.at(Quantity::kWriteIndex)) {
    table.error("slot_is", "`slot_is` = \"" + slot + "\" needs `write_index` under [registers]");
  }
  if (counter && counter->format.type == RegisterType::kUint16 && ring.slots > 16384) {
    table.error("slots", "a 16-bit sample_counter cannot tell apart the turns of a ring of more than 16384 slots");
  }
}

void read_codes(const TomlTable& root, RegisterMap& map) {
  const auto states = root.table("states");
  for (std::size_t i = 0; i < kMotionNames.size(); ++i) {
    const bool needed = i <= static_cast<std::size_t>(frame::Motion::kStopped);
    if (!needed && !states.has(kMotionNames[i])) continue;
    const auto code = static_cast<std::uint16_t>(states.integer(kMotionNames[i], {0.0, 65535.0}));
    if (states.has(kMotionNames[i]) && !map.states.emplace(code, static_cast<frame::Motion>(i)).second) {
      states.error(kMotionNames[i], "two states have the code " + std::to_string(code));
    }
  }
  if (const auto bits = root.table_if("fault_bits")) {
    for (std::size_t i = 0; i < kFaultNames.size(); ++i) {
      if (!bits->has(kFaultNames[i])) continue;
      map.fault_bit_at[i] = static_cast<std::uint8_t>(bits->integer(kFaultNames[i], {0.0, 15.0}));
    }
  }
  const auto commands = root.table("commands");
  map.start_command = static_cast<std::uint16_t>(commands.integer("start", {0.0, 65535.0}));
  map.stop_command = static_cast<std::uint16_t>(commands.integer("stop", {0.0, 65535.0}));
  if (commands.has("stop") && map.start_command == map.stop_command) {
    commands.error("stop", "start and stop are the same command");
  }
}

/// Two quantities of one direction in one register are a typing error. A set-point may lie on its read-back.
void check_overlaps(const TomlTable& root, const RegisterMap& map) {
  const auto registers = root.table("registers");
  for (std::size_t i = 0; i < kQuantities; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const auto &a = map.registers[i], &b = map.registers[j];
      const auto qa = static_cast<Quantity>(i), qb = static_cast<Quantity>(j);
      if (!a || !b || is_written(qa) != is_written(qb)) continue;
      if (!is_written(qa) && a->function != b->function) continue;
      if (a->address < b->address + b->format.registers() && b->address < a->address + a->format.registers()) {
        registers.table(quantity_name(qa))
            .error("address",
                   "`" + std::string(quantity_name(qa)) + "` overlaps `" + std::string(quantity_name(qb)) + "`");
      }
    }
    const auto& reg = map.registers[i];
    const auto& ring = map.samples;
    if (reg && !is_written(static_cast<Quantity>(i)) && reg->function == ring.function && ring.slots > 0 &&
        reg->address + reg->format.registers() > ring.address &&
        reg->address < ring.address + ring.slots * ring.stride_registers) {
      registers.table(quantity_name(static_cast<Quantity>(i))).error("address", "this register lies in [samples]");
    }
  }
}

/// Counter, index and times have to be of one moment, which only one request can give.
void check_header(const TomlTable& root, const RegisterMap& map) {
  if (!map.at(Quantity::kSampleCounter)) return;
  const auto block = map.header_block();
  for (const auto quantity : {Quantity::kDeviceTime_us, Quantity::kNewestSampleTime_us, Quantity::kWriteIndex}) {
    if (map.at(quantity) &&
        std::find(block.quantities.begin(), block.quantities.end(), quantity) == block.quantities.end()) {
      root.table("registers")
          .table(quantity_name(quantity))
          .error("address", "`" + std::string(quantity_name(quantity)) +
                                "` cannot be read in one request with `sample_counter`; both need the same "
                                "read_function, and no gap of more than `bridge_gap_registers` between them");
    }
  }
}

}  // namespace

RegisterMap read_register_map(const base::TomlDocument& document) {
  const auto root = document.root();
  RegisterMap map;
  Defaults defaults;
  (void)root.choice_or("format", "isorig-frame-map/1", {"isorig-frame-map/1"});  // files of before have none

  const auto gateway = root.table("gateway");
  map.name = gateway.string("name");
  map.unit_id = static_cast<std::uint8_t>(gateway.integer("unit_id", {0.0, 255.0}));
  defaults.address_base = static_cast<int>(gateway.integer_or("address_base", 0, {0.0, 1.0}));
  defaults.order = word_order(gateway, WordOrder::kABCD);
  defaults.read_function = function_code(gateway, "read_function", 3, 3, 4);
  defaults.write_function = function_code(gateway, "write_function", 16, 6, 16);
  map.max_read_registers = static_cast<std::uint16_t>(gateway.integer_or("max_read_registers", 125, {2.0, 125.0}));
  map.max_write_registers = static_cast<std::uint16_t>(gateway.integer_or("max_write_registers", 123, {2.0, 123.0}));
  map.bridge_gap_registers = static_cast<std::uint16_t>(gateway.integer_or("bridge_gap_registers", 0, {0.0, 100.0}));
  map.sample_rate_Hz = gateway.number_or("sample_rate_Hz", 0.0, base::kPositive);

  read_registers(root, map, defaults);
  read_identity(root, map, defaults);
  read_samples(root, map, defaults);
  read_codes(root, map);
  if (map.sample_rate_Hz == 0.0 && !map.at(Quantity::kSampleRate_Hz)) {
    gateway.error({}, "the frame's sample rate is unknown: give `sample_rate_Hz` here or map it under [registers]");
  }
  check_overlaps(root, map);
  check_header(root, map);
  document.finish();
  return map;
}

RegisterMap read_register_map(const std::filesystem::path& path) {
  return read_register_map(base::TomlDocument::parse_file(path));
}

}  // namespace isorig::modbus
