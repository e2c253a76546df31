#include "sim/wire_control.hpp"

#include <charconv>
#include <optional>
#include <sstream>
#include <type_traits>

namespace isorig::sim {

WireControl::WireControl(FrameWireFaults& frame, TeensyFaults& teensy, Rig& rig) : rig_(rig) {
  const auto atomic = [this](std::string name, auto& value, std::string unit, int max, bool endless,
                             std::string what) {
    using Value = typename std::remove_reference_t<decltype(value)>::value_type;
    switches_.push_back({std::move(name), std::move(unit), std::move(what), max, endless,
                         [&value] { return static_cast<int>(value.load()); },
                         [&value](int to) { value.store(static_cast<Value>(to)); }});
  };
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
  atomic("frame delay", frame.delay_ms, "ms", 60'000, false, "every answer comes so much later");
  atomic("frame late", frame.late_ms, "ms", 60'000, false, "the next answer alone comes so much later");
  atomic("frame drop", frame.drop, "answers", 1'000'000, true, "so many answers are never sent");
  atomic("frame corrupt", frame.corrupt, "answers", 1'000'000, true, "so many answers are damaged");
  atomic("frame disconnect", frame.disconnect, "", 1, false, "connections are cut and none is taken");
  atomic("frame freeze", frame.freeze, "", 1, false, "the registers stand still, nobody hears writes");
  atomic("frame refuse", frame.refuse, "", 1, false, "start commands get an exception");
  atomic("frame wrong-identity", frame.wrong_identity, "", 1, false, "another frame answers");

  atomic("teensy delay-to-host", teensy.delay_to_host_us, "us", 60'000'000, false, "frames to the host wait");
  atomic("teensy delay-to-device", teensy.delay_to_device_us, "us", 60'000'000, false,
         "frames to the device wait");
  atomic("teensy drop", teensy.drop_permille, "permille", 1000, false, "frames to the host are lost");
  atomic("teensy repeat", teensy.repeat_permille, "permille", 1000, false, "frames to the host come twice");
  atomic("teensy corrupt", teensy.corrupt_permille, "permille", 1000, false, "frames to the host lose a bit");
  atomic("teensy hang-up", teensy.hung_up, "", 1, false, "the port vanishes, the device goes on");
  atomic("teensy unplug", teensy.unplugged, "", 1, false, "port and power are gone");
  atomic("teensy freeze", teensy.frozen, "", 1, false, "the firmware hangs, valves stay");
  atomic("teensy wrong-serial", teensy.wrong_serial, "", 1, false, "another device of the kind answers");
  atomic("teensy stale-sensor", teensy.stale_sensor, "", 1, false, "the sensor converts no more");
  atomic("teensy sensor-fault", teensy.sensor_fault, "", 1, false, "the sensor reports status 11");

  plain("rig estop", rig.interlock().estop_closed, false, "the emergency stop is pressed");
  plain("rig guard", rig.interlock().guard_closed, false, "the guard is open");
  plain("rig supply-empty", rig.pneumatics().supply_empty, true, "no air comes");
  plain("rig drive-fault", rig.frame().faults.drive_fault, true, "the frame's drive trips");
  plain("rig frozen-force", rig.frame().faults.frozen_force, true, "the load cell repeats its last value");
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
