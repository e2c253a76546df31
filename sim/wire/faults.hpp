#pragma once
#include <atomic>

namespace isorig::sim {

/// One of so many; -1 never runs out.
inline bool take_one(std::atomic<int>& left) noexcept {
  int now = left.load();
  while (now > 0 && !left.compare_exchange_weak(now, now - 1)) {
  }
  return now != 0;
}

/// How a frame on the wire fails to stop. Decided when the stop arrives, so that nobody has to switch in time.
struct StopFaults {
  std::atomic<int> busy{0};  ///< so many are refused (8800: answered by a text); -1: until switched off
  std::atomic<int> lost{0};  ///< so many are taken as if all were well, and not carried out; -1: until switched off
  std::atomic<int> cut{0};   ///< so many end the connection instead (a serial line: are not heard); -1: likewise
  std::atomic<int> silent_ms{0};  ///< from the next on nothing is heard or answered for so long; then 0 again
  std::atomic<int> late_ms{0};  ///< the next is carried out and its answer (8800: the next answer) comes so much later
};

/// Faults of the emulated frame gateway, switched while it runs, from any thread (docs/wire-frame.md).
struct FrameWireFaults {
  std::atomic<int> delay_ms{0};  ///< every answer comes so much later
  std::atomic<int> late_ms{0};   ///< the next answer only; then 0 again. Beyond the client's time-out: a late reply
  std::atomic<int> drop{0};      ///< so many answers are never sent; -1: until switched off
  std::atomic<int> corrupt{0};   ///< so many answers are damaged; -1: until switched off
  std::atomic<bool> disconnect{false};  ///< connections are cut and none is taken, until switched off
  std::atomic<bool> freeze{false};      ///< registers stand still, as when the frame hangs behind a live gateway
  std::atomic<bool> refuse{false};      ///< start commands get an exception
  std::atomic<bool> wrong_identity{false};
  std::atomic<bool> restart{false};  ///< the frame is switched off and on, once: it counts samples and time anew
  StopFaults stop;
};

/// Faults and conditions of the emulated 8800-type controller (docs/wire-8800.md). The last four are also what the
/// controller itself changes: `list` shows how it stands.
struct Instron8800Faults {
  std::atomic<int> delay_ms{0};  ///< every answer comes so much later
  std::atomic<int> late_ms{0};   ///< the next answer only; then 0 again
  std::atomic<int> hang_ms{0};   ///< takes no line for so long, then goes on where it was; then 0 again
  std::atomic<int> drop{0};      ///< so many answers are never sent; -1: until switched off
  std::atomic<int> garbage{0};   ///< so many answers are damaged; -1: until switched off
  std::atomic<int> extra{0};     ///< so many lines are sent that nobody asked for
  std::atomic<int> lose{0};      ///< so many commands (C, P) are lost on their way; -1: until switched off
  /// The code that late, drop, garbage, extra (just before its answer) and lose hit, e.g. 134; 0: all.
  std::atomic<int> at_code{0};
  std::atomic<bool> disconnect{false};   ///< connections are cut and none is taken
  StopFaults stop;                       ///< of C1,0; C23,0 is not touched
  std::atomic<bool> restart{false};      ///< it is switched off and on, once: nothing is set, the panel has control
  std::atomic<bool> clamp{false};        ///< ramp times below 1 s become 1 s
  std::atomic<bool> wrong_scale{false};  ///< the load cell is another one
  std::atomic<bool> limit{false};        ///< its own travel limit has tripped
  std::atomic<bool> panel{true};         ///< the front panel has control
  std::atomic<bool> watchdog_off{true};  ///< the watchdog does not watch
  std::atomic<bool> actuator_off{false};
};

/// Faults of the emulated pressure regulator (docs/wire-regulator.md).
struct RegulatorFaults {
  std::atomic<int> late_ms{0};          ///< the next answer only; then 0 again
  std::atomic<int> drop{0};             ///< so many answers are never sent; -1: until switched off
  std::atomic<bool> disconnect{false};  ///< nobody answers, connections are cut; the regulator goes on regulating
  std::atomic<bool> swap_words{false};  ///< floats with the low word first
  std::atomic<bool> in_kpa{false};      ///< somebody switched its unit at the panel
  std::atomic<bool> clamp{false};       ///< set-points above 2 are taken as 2
  std::atomic<bool> stuck{false};       ///< its valves stay where they are
  std::atomic<bool> sensor_off{false};  ///< its own sensor reads 3 psi too much
};

}  // namespace isorig::sim
