// A stop that fails on the wire, by all the wires there are: the daemon's frame service and the real driver against the
// emulator, over a socket or a pseudo-terminal. What counts is what the plant did.
#include "daemon/rig/config_checks_frame.hpp"
#include "stop_wire_rig.hpp"

namespace isorig::sim {
namespace {

struct Failure {
  const char* name;
  void (*switch_on)(StopWireRig&);
  bool by_itself;  ///< it passes, and the stop is confirmed then, without the frame's own watchdog
};

void PrintTo(const Failure& failure, std::ostream* out) {
  *out << failure.name;
}

const Failure kFailures[] = {
    {"None", [](StopWireRig&) {}, true},
    {"BusyOnce", [](StopWireRig& r) { r.faults().busy = 1; }, true},
    {"Busy8Times", [](StopWireRig& r) { r.faults().busy = 8; }, true},
    {"BusyForGood", [](StopWireRig& r) { r.faults().busy = -1; }, false},
    {"LostOnce", [](StopWireRig& r) { r.faults().lost = 1; }, true},
    {"LostForGood", [](StopWireRig& r) { r.faults().lost = -1; }, false},
    {"CutOnce", [](StopWireRig& r) { r.faults().cut = 1; }, true},
    {"CutForGood", [](StopWireRig& r) { r.faults().cut = -1; }, false},
    {"Silent260ms", [](StopWireRig& r) { r.faults().silent_ms = 260; }, true},
    {"Silent600ms", [](StopWireRig& r) { r.faults().silent_ms = 600; }, true},
    {"Silent1000ms", [](StopWireRig& r) { r.faults().silent_ms = 1000; }, true},
    {"Silent3000ms", [](StopWireRig& r) { r.faults().silent_ms = 3000; }, true},
    {"Late150ms", [](StopWireRig& r) { r.faults().late_ms = 150; }, true},
    {"Late700ms", [](StopWireRig& r) { r.faults().late_ms = 700; }, true},
    {"RunsOn", [](StopWireRig& r) { r.plant_faults().runs_on = true; }, false},
};

/// From the request on: as long as it takes to stand and to be believed, and then some.
void expect_stop(StopWireRig& rig, double within_s, bool by_itself) {
  const Stalls stalls;
  rig.request();
  const int beats = rig.device().heartbeats;
  // In the turn that confirms it beats again.
  int beats_before_confirmation = 0;
  const auto went_on = [&] {
    if (rig.confirmed_ns() < 0) beats_before_confirmation = rig.device().heartbeats - beats;
    return rig.confirmed_ns() >= 0;
  };
  rig.until(within_s, went_on);
  const double limit_s = within_s + 2.0 * stalls.total_s();
  rig.until(0.3, [] { return false; });
  const auto seen = rig.look();
  const double moved_s = 1e-9 * static_cast<double>(seen.moved_ns - rig.request_ns());
  const double confirmed_s =
      rig.confirmed_ns() < 0 ? -1.0 : 1e-9 * static_cast<double>(rig.confirmed_ns() - rig.request_ns());
  std::printf("  stood after %.3f s, confirmed after %.3f s, %d stops, %d connections, stalls %.3f s\n",
              std::max(moved_s, 0.0), confirmed_s, rig.device().stops, rig.device().connects, stalls.total_s());
  EXPECT_LE(moved_s, limit_s) << rig.detail();
  EXPECT_FALSE(seen.moved_after_confirmation)
      << "called stopped after " << confirmed_s << " s, moved until " << moved_s;
  EXPECT_EQ(beats_before_confirmation, 0) << "a frame that was not seen to stand got a heartbeat";
  if (!by_itself) return;
  EXPECT_TRUE(rig.until(20.0, [&] { return rig.confirmed_ns() >= 0; })) << rig.detail();
  EXPECT_FALSE(rig.look().moved_after_confirmation);
}

class StopWire : public testing::TestWithParam<std::tuple<Wire, Failure>> {};

std::vector<std::tuple<Wire, Failure>> every_way() {
  std::vector<std::tuple<Wire, Failure>> ways;
  for (const Wire wire : {Wire::kModbusTcp, Wire::kModbusRtu, Wire::kInstron8800}) {
    for (const Failure& failure : kFailures) {
      // Nothing stops an 8800's ramp that goes on after the amplifier was told to be off.
      if (wire == Wire::kInstron8800 && std::string_view(failure.name) == "RunsOn") continue;
      ways.emplace_back(wire, failure);
    }
  }
  return ways;
}

INSTANTIATE_TEST_SUITE_P(All, StopWire, testing::ValuesIn(every_way()),
                         [](const auto& way) { return name_of(std::get<0>(way.param)) + std::get<1>(way.param).name; });

TEST_P(StopWire, EndsInStandstillWithinTheFramesWatchdog) {
  const auto& [wire, failure] = GetParam();
  const StopWireRig::Times times;
  StopWireRig rig(wire, times);
  ASSERT_TRUE(rig.move_to(11.0F)) << rig.detail();
  failure.switch_on(rig);
  expect_stop(rig, times.watchdog_s + 0.25, failure.by_itself);
}

/// A line on which a round of questions takes longer than a poll. Standing is judged by samples, so they have to come
/// while the stop is repeated. What `isorig check` reckons for it is what it takes, at most, and not twice as much.
struct SlowLine {
  int answer_ms;
  int response_timeout_ms;
};
class StopWireSlowLine : public testing::TestWithParam<SlowLine> {};

INSTANTIATE_TEST_SUITE_P(AnswerAfterMs, StopWireSlowLine,
                         testing::Values(SlowLine{0, 500}, SlowLine{10, 500}, SlowLine{30, 600}), [](const auto& line) {
                           return std::to_string(line.param.answer_ms) + "Of" +
                                  std::to_string(line.param.response_timeout_ms);
                         });

TEST_P(StopWireSlowLine, IsReadyAndAStopIsConfirmedInTheTimeThatIsReckonedForIt) {
  StopWireRig::Times times;
  const frame::Instron8800Config defaults;
  times.gap_us = defaults.gap_us;
  times.answer_ms = GetParam().answer_ms;
  times.response_timeout_ms = GetParam().response_timeout_ms;
  times.off_ms = 3000;
  times.heartbeat_ms = defaults.heartbeat_timeout_ms;  // shorter than the stop, during which none is sent
  times.watchdog_s = 5.0;
  StopWireRig rig(Wire::kInstron8800, times);
  ASSERT_TRUE(rig.until(20.0, [&] { return rig.confirmed_ns() >= 0; })) << "never ready: " << rig.detail();
  const auto line = frame::times_of(rig.config_8800(), 1e-3 * GetParam().answer_ms);
  ASSERT_LE(line.confirms_s, 1e-3 * times.response_timeout_ms) << "such a file is refused";
  const double reckoned_s = daemon::stop_confirmed_s(line);
  double longest_s = 0.0, calm_s = 0.0;
  for (int i = 0; i < 4; ++i) {
    const Stalls stalls;
    ASSERT_TRUE(rig.move_to(i % 2 == 0 ? 11.0F : 9.0F)) << rig.detail();
    expect_stop(rig, reckoned_s, true);
    const double took_s = 1e-9 * static_cast<double>(rig.confirmed_ns() - rig.request_ns());
    EXPECT_LE(took_s, reckoned_s + 2.0 * stalls.total_s());
    longest_s = std::max(longest_s, took_s);
    calm_s = std::max(calm_s, took_s + 2.0 * stalls.total_s());
  }
  std::printf("  reckoned: %.3f s, at most %.3f s\n", reckoned_s, longest_s);
  EXPECT_LT(reckoned_s, 2.0 * calm_s) << "whoever writes that waits too long for a frame that does not stop";
  EXPECT_FALSE(rig.heartbeat_was_lost());
  EXPECT_NE(rig.report().state.motion, frame::Motion::kDisabled) << "the actuator was switched off: " << rig.detail();
}

/// With "actuator off" out of the way.
TEST(StopWireInstron8800, TheWatchdogAloneStopsIt) {
  StopWireRig::Times times;
  times.off_ms = 10'000;
  StopWireRig rig(Wire::kInstron8800, times);
  ASSERT_TRUE(rig.move_to(11.0F)) << rig.detail();
  rig.faults().lost = -1;
  expect_stop(rig, times.watchdog_s + 0.25, false);
}

/// Connecting does not feed it, where it cannot be asked whether it is on.
TEST(StopWireInstron8800, ConnectionsThatBreakDoNotFeedAWatchdogThatCannotBeAsked) {
  StopWireRig::Times times;
  times.off_ms = 10'000;
  times.watchdog_can_be_asked = false;
  StopWireRig rig(Wire::kInstron8800, times);
  ASSERT_TRUE(rig.move_to(11.0F)) << rig.detail();
  rig.faults().cut = -1;
  expect_stop(rig, times.watchdog_s + 0.25, false);
}

}  // namespace
}  // namespace isorig::sim
