#include "sim/frame/frame.hpp"

#include <gmock/gmock.h>

#include <optional>

#include "driver.hpp"
#include "sim/frame/crosshead.hpp"

namespace isorig::sim {
namespace {

using drivers::Fault;
using testing::Driver;
using ::testing::HasSubstr;
using testing::shipped;

std::optional<Fault> refusal(const std::function<void()>& call, std::string* what = nullptr) {
  try {
    call();
  } catch (const drivers::DeviceError& e) {
    if (what != nullptr) *what = e.what();
    return e.fault();
  }
  return std::nullopt;
}

// --- the crosshead against a real Instron at 10 mm/s (docs/simulated-rig.md) ---

struct Ramp {
  std::vector<double> position_mm;
  double dt_s;
  [[nodiscard]] double at(double t_s) const { return position_mm[static_cast<std::size_t>(std::lround(t_s / dt_s))]; }
};

Ramp ramp(double target_mm, double speed_mm_s, double seconds, double dt_s = 1e-3) {
  Crosshead crosshead(FrameParameters{}, dt_s);
  crosshead.move(target_mm, speed_mm_s);
  Ramp out{{0.0}, dt_s};
  for (int i = 0; i < std::lround(seconds / dt_s); ++i) {
    crosshead.step();
    out.position_mm.push_back(crosshead.position_mm());
  }
  return out;
}

TEST(Crosshead, RunsAsARealFrameDidAtTenMillimetresPerSecond) {
  const Ramp r = ramp(80.0, 10.0, 8.0);
  EXPECT_NEAR(r.at(0.1) / 0.1, 8.64, 0.05);                   // mean speed of the first 100 ms
  EXPECT_NEAR((r.at(0.19) - r.at(0.1)) / 0.09, 10.40, 0.05);  // then 4 % fast (10.43 and 10.37 measured)
  EXPECT_NEAR(1.0 - r.at(0.1), 0.136, 0.003);                 // deficit against the ideal ramp
  EXPECT_NEAR(1.9 - r.at(0.19), 0.100, 0.001);
  for (double t = 0.3; t < 7.9; t += 0.1) EXPECT_NEAR(10.0 * t - r.at(t), 0.0977, 0.0004) << t;
  EXPECT_NEAR((r.at(7.5) - r.at(0.5)) / 7.0, 10.0, 1e-3);
}

TEST(Crosshead, OvershootsALittleAndEndsExactlyOnTarget) {
  for (const double speed_mm_s : {2.0, 10.0}) {
    const Ramp r = ramp(2.0, speed_mm_s, 4.0);
    const double peak_mm = *std::max_element(r.position_mm.begin(), r.position_mm.end());
    EXPECT_GT(peak_mm - 2.0, 0.004 * speed_mm_s);
    EXPECT_LT(peak_mm - 2.0, 0.012 * speed_mm_s);
    EXPECT_EQ(r.position_mm.back(), 2.0);
  }
}

TEST(Crosshead, KeepsItsAccelerationLimitAtAReversal) {
  FrameParameters p;
  Crosshead crosshead(p, 1e-3);
  crosshead.move(50.0, 10.0);
  for (int i = 0; i < 1000; ++i) crosshead.step();
  crosshead.move(-50.0, 10.0);
  double worst = 0.0;
  double fastest = 0.0;
  for (int i = 0; i < 1000; ++i) {
    const double before = crosshead.velocity_mm_s();
    crosshead.step();
    worst = std::max(worst, std::abs(crosshead.velocity_mm_s() - before) / 1e-3);
    fastest = std::min(fastest, crosshead.velocity_mm_s());
  }
  EXPECT_LE(worst, p.acceleration_max_mm_s2 * (1.0 + 1e-9));
  EXPECT_GT(worst, 0.9 * p.acceleration_max_mm_s2);
  EXPECT_LT(fastest, -10.2);  // catches up, as the real one did
  EXPECT_GT(fastest, -16.0);
}

TEST(Crosshead, DoesNotDependOnTheStep) {
  const Ramp coarse = ramp(2.0, 10.0, 1.0, 1e-3);
  const Ramp fine = ramp(2.0, 10.0, 1.0, 1e-5);
  for (double t = 0.01; t < 1.0; t += 0.01) EXPECT_NEAR(coarse.at(t), fine.at(t), 1e-9) << t;
}

TEST(Crosshead, BrakeStopsAtItsDeceleration) {
  Crosshead crosshead(FrameParameters{}, 1e-3);
  crosshead.move(50.0, 10.0);
  for (int i = 0; i < 1000; ++i) crosshead.step();
  const double start_mm = crosshead.position_mm();
  crosshead.brake();
  for (int i = 0; i < 100; ++i) crosshead.step();
  EXPECT_NEAR(crosshead.position_mm() - start_mm, 10.0 * 10.0 / (2.0 * 2000.0), 1e-4);
  EXPECT_EQ(crosshead.velocity_mm_s(), 0.0);
}

// --- the device ---

TEST(SimFrame, ReportsASegmentFromStartToTarget) {
  Rig rig(shipped());
  Driver d(rig);
  d.run(0.1);
  d.move(2.0, 10.0);
  d.tick();
  EXPECT_EQ(d.state.motion, frame::Motion::kMoving);
  EXPECT_EQ(d.state.segment_id, 1);
  EXPECT_EQ(d.state.target_mm, 2.0F);
  EXPECT_EQ(d.state.velocity_mm_s, 10.0F);
  d.run(0.18);
  EXPECT_EQ(d.state.motion, frame::Motion::kMoving);
  d.run(1.5);
  EXPECT_EQ(d.state.motion, frame::Motion::kReached);
  EXPECT_EQ(rig.truth().position_mm, 2.0);
  EXPECT_EQ(rig.truth().velocity_mm_s, 0.0);
  EXPECT_EQ(d.state.fault_bits, 0);
}

TEST(SimFrame, StopDeceleratesAndHolds) {
  Rig rig(shipped());
  Driver d(rig);
  d.run(0.1);
  d.move(4.0, 10.0);
  d.run(0.2);
  rig.frame().stop();
  rig.frame().stop();
  const double at_mm = rig.truth().position_mm;
  d.run(1.0);
  EXPECT_EQ(d.state.motion, frame::Motion::kStopped);
  EXPECT_NEAR(rig.truth().position_mm, at_mm + 0.1, 0.05);  // the lag is run out
  EXPECT_EQ(rig.truth().velocity_mm_s, 0.0);
}

TEST(SimFrame, SamplesCarryTheStatedNoiseOnAClockOfTheirOwn) {
  SimConfig config = shipped();
  config.frame.clock.wander_ppm = 0.0;
  Rig rig(config);
  Driver d(rig);
  d.run(200.0);
  const auto& s = d.frame_samples;
  // 200 s less transport: 12 ppm slow is 2.4 samples in 200,000.
  ASSERT_NEAR(static_cast<double>(s.size()), 200'000.0 * (1.0 - 12e-6), 2.0);
  double force = 0.0;
  double force2 = 0.0;
  double position2 = 0.0;
  for (std::size_t i = 0; i < s.size(); ++i) {
    ASSERT_EQ(s[i].sequence, s[0].sequence + i);
    ASSERT_EQ(s[i].device_us, s[0].device_us + static_cast<std::int64_t>(1000 * i));
    force += static_cast<double>(s[i].force_N);
    force2 += static_cast<double>(s[i].force_N) * static_cast<double>(s[i].force_N);
    position2 += static_cast<double>(s[i].position_mm) * static_cast<double>(s[i].position_mm);
    const double counts = static_cast<double>(s[i].force_N) / config.frame.force_quantum_N;
    ASSERT_NEAR(counts, std::round(counts), 1e-3);
  }
  const auto n = static_cast<double>(s.size());
  // Quantisation adds quantum^2 / 12.
  const double expected_N = std::hypot(config.frame.force_noise_N, config.frame.force_quantum_N / std::sqrt(12.0));
  EXPECT_NEAR(force / n, 0.0, 5.0 * expected_N / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(force2 / n), expected_N, 0.01 * expected_N);
  const double expected_mm =
      std::hypot(config.frame.position_noise_mm, config.frame.position_quantum_mm / std::sqrt(12.0));
  EXPECT_NEAR(std::sqrt(position2 / n), expected_mm, 0.01 * expected_mm);
}

TEST(SimFrame, ExchangesBracketTheTruth) {
  const SimConfig config = shipped();
  Rig rig(config);
  Driver d(rig);
  d.run(30.0);
  EXPECT_GT(d.frame_exchanges.size(), 150U);
  EXPECT_LT(d.frame_exchanges.size(), 200U);
  DeviceClock clock(config.frame.clock, Random(config.seed, static_cast<std::uint64_t>(Stream::kFrameClock)), 0);
  double shortest_ns = 1e9;
  double longest_ns = 0.0;
  for (const auto& e : d.frame_exchanges) {
    clock.advance_to(e.host_recv_ns);
    const double device_ns = clock.host_since(0, e.device_rx_us);
    EXPECT_LE(static_cast<double>(e.host_send_ns), device_ns);
    EXPECT_LE(device_ns, static_cast<double>(e.host_recv_ns));
    const auto trip_ns = static_cast<double>(e.host_recv_ns - e.host_send_ns);
    shortest_ns = std::min(shortest_ns, trip_ns);
    longest_ns = std::max(longest_ns, trip_ns);
  }
  EXPECT_GE(shortest_ns, 0.499e6);
  EXPECT_LT(shortest_ns, 0.7e6);
  EXPECT_GT(longest_ns, 1.5e6);
}

TEST(SimFrame, LosesWhatTheRingOverwroteAndSaysSo) {
  const SimConfig config = shipped();
  Rig rig(config);
  Driver d(rig);
  d.run(0.5);
  EXPECT_EQ(d.frame_lost, 0U);
  const std::size_t had = d.frame_samples.size();
  d.polling = false;
  d.run(1.0);
  d.polling = true;
  d.tick();
  EXPECT_NEAR(d.frame_lost, 1000.0 - config.frame.ring_samples, 3.0);
  EXPECT_NE(d.state.fault_bits & frame::kSampleBufferOverrun, 0);
  d.run(0.1);
  EXPECT_EQ(d.state.fault_bits & frame::kSampleBufferOverrun, 0);
  // The counter shows the same gap.
  EXPECT_EQ(d.frame_samples[had].sequence, d.frame_samples[had - 1].sequence + 1 + d.frame_lost);
}

TEST(SimFrame, StopsByItselfWhenTheHeartbeatStops) {
  Rig rig(shipped());
  Driver d(rig);
  d.run(0.2);
  d.move(4.0, 2.0);
  d.run(0.3);
  EXPECT_EQ(d.state.motion, frame::Motion::kMoving);
  d.beating = false;
  d.run(1.5);
  EXPECT_EQ(d.state.motion, frame::Motion::kStopped);
  EXPECT_NE(d.state.fault_bits & frame::kHeartbeatLost, 0);
  EXPECT_LT(rig.truth().position_mm, 2.0);
  EXPECT_EQ(refusal([&] { d.move(0.0, 1.0); }), Fault::kRefused);
  d.beating = true;
  d.run(0.2);
  EXPECT_EQ(d.state.fault_bits, 0);
  EXPECT_EQ(refusal([&] { d.move(0.0, 1.0); }), std::nullopt);
}

TEST(SimFrame, AnUnchangingHeartbeatIsNone) {
  Rig rig(shipped());
  rig.frame().connect();
  std::vector<frame::Sample> buffer(256);
  for (int i = 1; i <= 1000; ++i) {
    rig.advance(i * Rig::kStep_ns);
    rig.frame().heartbeat(1);
  }
  EXPECT_NE(rig.frame().poll(buffer).state.fault_bits & frame::kHeartbeatLost, 0);
}

TEST(SimFrame, RefusesWhatItsCabinetForbids) {
  Rig rig(shipped());
  Driver d(rig);
  std::string what;
  EXPECT_EQ(refusal([&] { d.move(1.0, 1.0); }, &what), Fault::kRefused);  // no heartbeat yet
  EXPECT_THAT(what, HasSubstr("heartbeat"));
  d.run(0.1);
  EXPECT_EQ(refusal([&] { d.move(12.5, 1.0); }, &what), Fault::kRefused);
  EXPECT_THAT(what, HasSubstr("travel"));
  EXPECT_EQ(refusal([&] { d.move(1.0, 10.5); }), Fault::kRefused);
  EXPECT_EQ(refusal([&] { d.move(1.0, 0.0); }), Fault::kRefused);
  EXPECT_EQ(refusal([&] { d.move(std::nan(""), 1.0); }), Fault::kRefused);
  EXPECT_EQ(refusal([&] { d.move(1.0, 10.0); }), std::nullopt);
}

TEST(SimFrame, ForceLimitStopsAndLetsOnlyUnloadingThrough) {
  SimConfig config = shipped();
  config.frame.force_max_N = 8.0;
  Rig rig(config);
  Driver d(rig);
  d.target_psi = 6.0;
  d.run(4.0);
  d.move(6.0, 5.0);
  d.run(2.0);
  EXPECT_EQ(d.state.motion, frame::Motion::kLimit);
  EXPECT_NE(d.state.fault_bits & frame::kForceLimit, 0);
  EXPECT_LT(rig.truth().position_mm, 5.0);
  EXPECT_EQ(refusal([&] { d.move(8.0, 1.0); }), Fault::kRefused);
  EXPECT_EQ(refusal([&] { d.move(0.0, 1.0); }), std::nullopt);
  d.run(0.1);
  EXPECT_EQ(d.state.fault_bits, 0);
}

TEST(SimFrame, AnOpenInterlockDisablesTheDriveUntilANewSegment) {
  Rig rig(shipped());
  Driver d(rig);
  d.run(0.1);
  d.move(4.0, 10.0);
  d.run(0.2);
  const double at_mm = rig.truth().position_mm;
  rig.interlock().guard_closed = false;
  d.run(0.5);
  EXPECT_EQ(d.state.motion, frame::Motion::kDisabled);
  EXPECT_NE(d.state.fault_bits & frame::kInterlockOpen, 0);
  EXPECT_NEAR(rig.truth().position_mm, at_mm, 0.05);
  EXPECT_EQ(refusal([&] { d.move(0.0, 1.0); }), Fault::kRefused);
  rig.interlock().guard_closed = true;
  d.run(0.5);
  EXPECT_EQ(d.state.motion, frame::Motion::kStopped);
  EXPECT_NEAR(rig.truth().position_mm, at_mm, 0.05);  // does not go on by itself
  d.move(0.0, 10.0);
  d.run(2.0);
  EXPECT_EQ(rig.truth().position_mm, 0.0);
}

TEST(SimFrame, FaultSwitchesShowTheirFault) {
  Rig rig(shipped());
  Driver d(rig);
  d.run(0.1);
  std::vector<frame::Sample> buffer(256);
  rig.frame().faults.disconnected = true;
  EXPECT_EQ(refusal([&] { rig.frame().poll(buffer); }), Fault::kDisconnected);
  rig.frame().faults = {.silent = true};
  EXPECT_EQ(refusal([&] { rig.frame().poll(buffer); }), Fault::kTimeout);
  rig.frame().faults = {.frozen_samples = true};
  const auto before = rig.frame().sequence();
  d.run(0.1);
  EXPECT_EQ(rig.frame().sequence(), before);
  rig.frame().faults = {.ignores_segments = true};
  d.move(2.0, 10.0);
  d.run(1.0);
  EXPECT_EQ(rig.truth().position_mm, 0.0);
  EXPECT_EQ(d.state.motion, frame::Motion::kMoving);
  rig.frame().faults = {.drive_fault = true};
  d.run(0.1);
  EXPECT_EQ(d.state.motion, frame::Motion::kFault);
  EXPECT_NE(d.state.fault_bits & frame::kDriveFault, 0);
  rig.frame().faults = {};
  rig.frame().disconnect();
  EXPECT_EQ(refusal([&] { rig.frame().poll(buffer); }), Fault::kDisconnected);
}

}  // namespace
}  // namespace isorig::sim
