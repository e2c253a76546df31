#include "sim/wire/wire_control.hpp"

#include <charconv>
#include <optional>
#include <sstream>
#include <type_traits>
#include <variant>

#include "base/overloaded.hpp"

namespace isorig::sim {

template <typename Value>
void WireControl::add(std::string name, std::atomic<Value>& value, std::string unit, int max, bool endless,
                      std::string what) {
  switches_.push_back({std::move(name), std::move(unit), std::move(what), max, endless,
                       [&value] { return static_cast<int>(value.load()); },
                       [&value](int to) { value.store(static_cast<Value>(to)); }});
}

void WireControl::add_modbus(FrameWireFaults& frame) {
  add("frame delay", frame.delay_ms, "ms", 60'000, false, "every answer comes so much later");
  add("frame late", frame.late_ms, "ms", 60'000, false, "the next answer alone comes so much later");
  add("frame drop", frame.drop, "answers", 1'000'000, true, "so many answers are never sent");
  add("frame corrupt", frame.corrupt, "answers", 1'000'000, true, "so many answers are damaged");
  add("frame disconnect", frame.disconnect, "", 1, false, "connections are cut and none is taken");
  add("frame freeze", frame.freeze, "", 1, false, "the registers stand still, nobody hears writes");
  add("frame refuse", frame.refuse, "", 1, false, "start commands get an exception");
  add("frame wrong-identity", frame.wrong_identity, "", 1, false, "another frame answers");
  add("frame restart", frame.restart, "", 1, false, "the frame is switched off and on, once; then off again");
  add_stops(frame.stop);
}

void WireControl::add_stops(StopFaults& stop) {
  add("frame stop-busy", stop.busy, "stops", 1'000'000, true, "so many stops are refused");
  add("frame stop-lost", stop.lost, "stops", 1'000'000, true, "so many stops are taken and not carried out");
  add("frame stop-cut", stop.cut, "stops", 1'000'000, true, "so many stops end the connection instead");
  add("frame stop-silent", stop.silent_ms, "ms", 60'000, false, "from the next stop on nothing is heard for so long");
  add("frame stop-late", stop.late_ms, "ms", 60'000, false, "the next stop is done, and answered so much later");
}

void WireControl::add_instron8800(Instron8800Faults& frame) {
  add("frame delay", frame.delay_ms, "ms", 60'000, false, "every answer comes so much later");
  add("frame late", frame.late_ms, "ms", 60'000, false, "the next answer alone comes so much later");
  add("frame hang", frame.hang_ms, "ms", 600'000, false, "the controller takes no line for so long");
  add("frame drop", frame.drop, "answers", 1'000'000, true, "so many answers are never sent");
  add("frame garbage", frame.garbage, "answers", 1'000'000, true, "so many answers are damaged");
  add("frame extra", frame.extra, "lines", 1'000, false, "so many lines come that nobody asked for");
  add("frame lose", frame.lose, "commands", 1'000'000, true, "so many commands are lost on their way");
  add("frame at", frame.at_code, "code", 999, false, "late, drop, garbage, extra, lose hit this code alone");
  add("frame disconnect", frame.disconnect, "", 1, false, "connections are cut and none is taken");
  add_stops(frame.stop);
  add("frame clamp", frame.clamp, "", 1, false, "ramp times below 1 s become 1 s");
  add("frame wrong-scale", frame.wrong_scale, "", 1, false, "the load cell is another one");
  add("frame limit", frame.limit, "", 1, false, "the controller's own travel limit has tripped");
  add("frame panel", frame.panel, "", 1, false, "the front panel has control");
  add("frame watchdog-off", frame.watchdog_off, "", 1, false, "the controller's watchdog does not watch");
  add("frame restart", frame.restart, "", 1, false, "the controller is switched off and on, once; then off again");
  add("frame actuator-off", frame.actuator_off, "", 1, false, "the actuator is off");
}

void WireControl::add_regulator(RegulatorFaults& regulator) {
  add("regulator late", regulator.late_ms, "ms", 60'000, false, "the next answer alone comes so much later");
  add("regulator drop", regulator.drop, "answers", 1'000'000, true, "so many answers are never sent");
  add("regulator disconnect", regulator.disconnect, "", 1, false, "nobody answers; it goes on regulating");
  add("regulator swap-words", regulator.swap_words, "", 1, false, "floats have their low word first");
  add("regulator kpa", regulator.in_kpa, "", 1, false, "somebody switched its unit to kPa");
  add("regulator clamp", regulator.clamp, "", 1, false, "set-points above 2 psi are taken as 2");
  add("regulator stuck", regulator.stuck, "", 1, false, "its valves stay where they are");
  add("regulator sensor-off", regulator.sensor_off, "", 1, false, "its own sensor reads 3 psi too much");
}

WireControl::WireControl(WireRig& wire) : rig_(wire.rig()) {
  auto& rig = wire.rig();
  auto& teensy = wire.teensy_faults();
  std::visit(
      base::Overloaded{[this](const std::unique_ptr<WireModbus>& frame) { add_modbus(frame->faults); },
                       [this](const std::unique_ptr<WireInstron8800>& frame) { add_instron8800(frame->faults); }},
      wire.frame());
  if (wire.regulator() != nullptr) add_regulator(wire.regulator_faults());
  // The plant's own switches belong to its lock.
  const auto plain = [this, &rig](std::string name, auto& value, bool when_on, std::string what) {
    switches_.push_back({std::move(name), "", std::move(what), 1, false,
                         [&value, &rig, when_on] {
                           const auto visit = rig.enter();
                           return value == when_on ? 1 : 0;
                         },
                         [&value, &rig, when_on](int to) {
                           const auto visit = rig.enter();
                           value = (to != 0) == when_on;
                         }});
  };

  const auto number = [this, &rig](std::string name, auto& value, std::string unit, int max, std::string what) {
    using Value = std::remove_reference_t<decltype(value)>;
    switches_.push_back({std::move(name), std::move(unit), std::move(what), max, false,
                         [&value, &rig] {
                           const auto visit = rig.enter();
                           return static_cast<int>(value);
                         },
                         [&value, &rig](int to) {
                           const auto visit = rig.enter();
                           value = static_cast<Value>(to);
                         }});
  };

  add("teensy delay-to-host", teensy.delay_to_host_us, "us", 60'000'000, false, "frames to the host wait");
  add("teensy delay-to-device", teensy.delay_to_device_us, "us", 60'000'000, false, "frames to the device wait");
  add("teensy drop", teensy.drop_permille, "permille", 1000, false, "frames to the host are lost");
  add("teensy repeat", teensy.repeat_permille, "permille", 1000, false, "frames to the host come twice");
  add("teensy corrupt", teensy.corrupt_permille, "permille", 1000, false, "frames to the host lose a bit");
  add("teensy hang-up", teensy.hung_up, "", 1, false, "the port vanishes, the device goes on");
  add("teensy unplug", teensy.unplugged, "", 1, false, "port and power are gone");
  add("teensy freeze", teensy.frozen, "", 1, false, "the firmware hangs, valves stay");
  add("teensy wrong-serial", teensy.wrong_serial, "", 1, false, "another device of the kind answers");
  add("teensy stale-sensor", teensy.stale_sensor, "", 1, false, "the sensor converts no more");
  add("teensy sensor-fault", teensy.sensor_fault, "", 1, false, "the sensor reports status 11");

  plain("rig estop", rig.interlock().estop_closed, false, "the emergency stop is pressed");
  plain("rig guard", rig.interlock().guard_closed, false, "the guard is open");
  plain("rig supply-empty", rig.pneumatics().supply_empty, true, "no air comes");
  number("rig supply", rig.pneumatics().supply_psi_now, "psi", 200, "the supply's regulator is set to this");
  number("rig burst", rig.pneumatics().burst_mL_s_bar, "mL/s/bar", 10'000, "a hose has burst");
  plain("rig fill-stuck-open", rig.pneumatics().fill_stuck_open, true, "the fill valve does not close");
  plain("rig vent-stuck-shut", rig.pneumatics().vent_stuck_shut, true, "the vent valve does not open");
  plain("rig dump-stuck-shut", rig.pneumatics().dump_stuck_shut, true, "the dump valve does not open");
  plain("rig valves-ignored", rig.pressure().faults.ignores_commands, true, "the valves stay as they are");
  plain("sensor tube-off", rig.pressure().faults.tube_off, true, "its tube has come off: it reads the room");
  plain("sensor tube-blocked", rig.pressure().faults.tube_blocked, true, "it reads what was locked in its tube");
  number("sensor tube-lag", rig.pressure().faults.tube_lag_ms, "ms", 60'000, "its tube is kinked: it lags");
  number("sensor low", rig.pressure().faults.low_permille, "permille", 1000, "it reads so much too little");
  plain("sensor stuck", rig.pressure().faults.stuck_value, true, "it sends one and the same count");
  plain("rig drive-fault", rig.frame().faults.drive_fault, true, "the frame's drive trips");
  plain("rig frozen-force", rig.frame().faults.frozen_force, true, "the load cell repeats its last value");
  plain("rig runs-on", rig.frame().faults.runs_on, true, "after a stop the frame says \"stopped\" and goes on");
  plain("rig ignores-segments", rig.frame().faults.ignores_segments, true,
        "the frame accepts segments and does not move");
}

std::string WireControl::execute(std::string_view line) {
  std::istringstream in{std::string(line)};
  std::vector<std::string> words;
  for (std::string word; in >> word;) words.push_back(word);
  if (words.size() == 4 && words[0] == "fault") return set(words);
  if (words.size() == 1 && words[0] == "clear") {
    for (const auto& each : switches_) each.set(0);
    return "ok\n";
  }
  if (words.size() == 1 && words[0] == "list") {
    std::ostringstream out;
    for (const auto& each : switches_) {
      const int value = each.get();
      out << each.name << ' ';
      if (value == 0) {
        out << "off";
      } else if (each.unit.empty() || value < 0) {
        out << "on";
      } else {
        out << value;
      }
      out << "    (" << (each.unit.empty() ? "on | off" : each.unit) << ": " << each.what << ")\n";
    }
    return out.str() + "ok\n";
  }
  if (words.size() == 2 && words[0] == "truth") {
    const auto truth = rig_.truth();
    if (words[1] == "pressure") return std::to_string(truth.pressure_psi) + "\nok\n";
    if (words[1] == "force") return std::to_string(truth.force_N) + "\nok\n";
    if (words[1] == "position") return std::to_string(truth.position_mm) + "\nok\n";
  }
  return "error: say `fault DEVICE NAME VALUE`, `clear`, `list`, or `truth pressure | force | position`\n";
}

std::string WireControl::set(const std::vector<std::string>& words) {
  const std::string name = words[1] + " " + words[2];
  for (const auto& each : switches_) {
    if (each.name != name) continue;
    std::optional<int> value;
    int number = 0;
    const auto* end = words[3].data() + words[3].size();
    if (words[3] == "off") {
      value = 0;
    } else if (words[3] == "on" && (each.endless || each.unit.empty())) {
      value = each.endless ? -1 : 1;
    } else if (const auto parsed = std::from_chars(words[3].data(), end, number);
               !each.unit.empty() && parsed.ec == std::errc{} && parsed.ptr == end && number >= 0 &&
               number <= each.max) {
      value = number;
    }
    if (!value) {
      return "error: `" + name + "` is " +
             (each.unit.empty() ? "on or off"
                                : "0 to " + std::to_string(each.max) + " " + each.unit + ", " +
                                      (each.endless ? "on or off" : "or off")) +
             ", not `" + words[3] + "`\n";
    }
    each.set(*value);
    return "ok\n";
  }
  std::string known;
  for (const auto& each : switches_) known += (known.empty() ? "" : ", ") + each.name;
  return "error: no switch `" + name + "`; there are: " + known + "\n";
}

}  // namespace isorig::sim
