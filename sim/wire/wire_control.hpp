#pragma once
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "sim/wire/wire_rig.hpp"

namespace isorig::sim {

/// The fault switches of an emulated rig by name, for a command line or a socket (docs/wire-frame.md):
///
///     fault frame delay 200        set one: a number, or on | off
///     clear                        all off
///     list                         each with its value and what it does
///     truth pressure               what a reference gauge at the plant would show; also force, position
///
/// One thread.
class WireControl {
 public:
  explicit WireControl(WireRig& rig);

  /// Does what the line says. The answer ends with "ok\n" or is "error: ...\n" with what would be right.
  std::string execute(std::string_view line);

 private:
  struct Switch {
    std::string name;  // "frame delay"
    std::string unit;  // "ms", "answers", "permille", ...; empty: on or off
    std::string what;
    int max = 1;  // the largest number; "on" stands for -1 (without end) where that is allowed, else max
    bool endless = false;
    std::function<int()> get;
    std::function<void(int)> set;
  };

  template <typename Value>
  void add(std::string name, std::atomic<Value>& value, std::string unit, int max, bool endless, std::string what);
  void add_modbus(FrameWireFaults& faults);
  void add_instron8800(Instron8800Faults& faults);
  void add_stops(StopFaults& faults);
  void add_regulator(RegulatorFaults& faults);
  std::string set(const std::vector<std::string>& words);

  Rig& rig_;
  std::vector<Switch> switches_;
};

}  // namespace isorig::sim
