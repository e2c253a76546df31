#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "calibration/date.hpp"
#include "calibration/record.hpp"
#include "cli/selftest/selftest_checks.hpp"
#include "daemon/host/host.hpp"
#include "recording_rig.hpp"
#include "rig_fixture.hpp"

/// Every fault is found by the line that names it. The daemon's own answers, from a simulated rig in virtual time.
namespace isorig::daemon::test {
namespace {

using cli::Line;
using cli::Verdict;
using ::testing::HasSubstr;

TEST(SelfTestOfAnotherVersion, AnAnswerThatLacksAPartIsSaid) {
  const auto nothing = nlohmann::json::object();
  try {
    (void)cli::judge({nothing, nothing, nothing, nothing});
    ADD_FAILURE() << "judged by nothing";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("isorigd's answer has no `"));
  }
}

class SelfTest : public ::testing::Test {
 protected:
  /// `seconds` after the start, with what `arrange` did to the rig.
  std::vector<Line> judge(const std::function<void(VirtualRig&)>& arrange = {}, double seconds = 6.0) {
    rig_ = std::make_unique<VirtualRig>(config_);
    Host::Options options;
    options.runs_root = folder_.path() / "runs";
    options.breathe = [this] { tick(); };
    host_ = std::make_unique<Host>(config_, rig_->core(), rig_->streams, options);
    run_for(3.0);
    if (before_) before_();
    if (arrange) arrange(*rig_);
    run_for(seconds);
    return cli::judge(
        {host_->status_json(), host_->selftest_json(), host_->readings_json(5.0), host_->calibrations_json()});
  }
  void tick() {
    rig_->tick();
    if (rig_->now_ns() % 20'000'000 == 0) host_->turn(rig_->now_ns());
  }
  void run_for(double seconds) {
    const auto until = rig_->now_ns() + static_cast<std::int64_t>(seconds * 1e9);
    while (rig_->now_ns() < until) tick();
  }
  static Line line(const std::vector<Line>& lines, const std::string& check) {
    for (const auto& l : lines) {
      if (l.check == check) return l;
    }
    ADD_FAILURE() << "no line " << check << " in\n" << cli::table_of(lines);
    return {};
  }
  /// `check` fails (or warns), with `found` in what it says and something to do; nothing else fails but `also`.
  void expect(const std::vector<Line>& lines, const std::string& check, Verdict verdict, const std::string& found,
              const std::vector<std::string>& also = {}) {
    const auto l = line(lines, check);
    EXPECT_EQ(l.verdict, verdict) << cli::table_of(lines);
    EXPECT_THAT(l.found, HasSubstr(found));
    EXPECT_FALSE(l.to_do.empty());
    for (const auto& other : lines) {
      if (other.verdict != Verdict::kFail || other.check == check) continue;
      EXPECT_THAT(also, ::testing::Contains(other.check)) << cli::table_of(lines);
    }
  }

  testing::TemporaryDirectory folder_{"selftest"};
  RigConfig config_ = load_rig(source("config/rigs/sim.toml"));
  std::unique_ptr<VirtualRig> rig_;
  std::unique_ptr<Host> host_;
  std::function<void()> before_;
};

TEST_F(SelfTest, AHealthyRigHasNoFailure) {
  config_.realtime.enforce = false;
  const auto lines = judge();
  for (const auto& l : lines) {
    EXPECT_NE(l.verdict, Verdict::kFail) << l.check << ": " << l.found;
    if (l.verdict != Verdict::kOk) {
      EXPECT_FALSE(l.to_do.empty()) << l.check;
    }
  }
  EXPECT_EQ(line(lines, "frame.identity").verdict, Verdict::kOk);
  EXPECT_THAT(line(lines, "sensor.rate").found, HasSubstr("of 1000.0 Hz"));
  EXPECT_EQ(line(lines, "calibration.force").found, "never calibrated");
}

TEST_F(SelfTest, Devices) {
  config_.realtime.enforce = false;
  expect(judge([](VirtualRig& r) { r.rig().frame().faults.disconnected = true; }), "frame.link", Verdict::kFail,
         "not connected", {"state"});
  expect(judge([](VirtualRig& r) { r.rig().pressure().faults.disconnected = true; }), "sensor.link", Verdict::kFail,
         "not connected", {"state"});
  expect(judge([](VirtualRig& r) { r.rig().pressure().faults.sensor_stale = true; }), "sensor.rate", Verdict::kFail,
         "no samples", {"state", "sensor.age"});
  expect(judge([](VirtualRig& r) { r.rig().frame().faults.drive_fault = true; }), "state", Verdict::kFail,
         "the frame reports a fault");
}

TEST_F(SelfTest, FrozenChannels) {
  config_.realtime.enforce = false;
  expect(judge([](VirtualRig& r) { r.rig().frame().faults.frozen_force = true; }), "force.frozen", Verdict::kFail,
         "equal values", {"state"});
  expect(judge([](VirtualRig& r) { r.rig().pressure().faults.stuck_value = true; }), "pressure.frozen", Verdict::kFail,
         "equal values", {"state", "sensor.age"});
  expect(judge([](VirtualRig& r) { r.rig().pressure().faults.bus_low = true; }), "pressure.zero", Verdict::kFail,
         "-3.7", {"state", "sensor.age", "pressure.frozen"});
}

TEST_F(SelfTest, NoiseAndZeros) {
  config_.realtime.enforce = false;
  config_.sim->frame.force_noise_N = 0.2;
  config_.sim->pressure.noise_counts = 6.0;
  auto lines = judge();
  expect(lines, "force.noise", Verdict::kWarn, "N rms");
  expect(lines, "pressure.noise", Verdict::kWarn, "psi rms");
  config_ = load_rig(source("config/rigs/sim.toml"));
  config_.realtime.enforce = false;
  config_.sim->pressure.offset_psi = 0.4;
  config_.sim->frame.force_offset_N = 6.0;
  config_.sim->frame.zero_mm = 5.5;
  lines = judge();
  expect(lines, "pressure.zero", Verdict::kWarn, "+0.4", {"force.zero", "position.travel"});
  expect(lines, "force.zero", Verdict::kFail, "+6.0", {"position.travel"});
  expect(lines, "position.travel", Verdict::kFail, "+5.5", {"force.zero"});
}

TEST_F(SelfTest, InterlockAndLimits) {
  config_.realtime.enforce = false;
  expect(judge([](VirtualRig& r) { r.rig().interlock().estop_closed = false; }), "interlock.estop", Verdict::kFail,
         "OPEN", {"state"});
  expect(judge([](VirtualRig& r) { r.rig().interlock().guard_closed = false; }), "interlock.guard", Verdict::kFail,
         "OPEN", {"state"});
  config_.sim->frame.travel_max_mm = 4.0;  // the daemon's is 5
  expect(judge(), "limits.frame", Verdict::kFail, "travel_max_mm 4, rig 5");
  config_ = load_rig(source("config/rigs/sim.toml"));
  config_.realtime.enforce = false;
  config_.limits.pressure_max_psi = 40.0;
  expect(judge(), "limits.pressure", Verdict::kFail, "40.0");
}

TEST_F(SelfTest, TheMachine) {
  const auto plain = judge();  // real time is wanted, and this is a test
  EXPECT_EQ(line(plain, "realtime.fifo").verdict, Verdict::kFail);
  config_.realtime.enforce = false;
  EXPECT_EQ(line(judge(), "realtime.fifo").verdict, Verdict::kWarn);
  const auto late = judge([](VirtualRig& r) {
    r.around_core = [](Core& core, std::int64_t now_ns) {
      core.tick(now_ns, now_ns % 10'000'000 == 0 ? 3'000'000 : 0, 0);
    };
  });
  expect(late, "realtime.lateness", Verdict::kFail, "later than 512 us");
  config_.recording.min_free_bytes = std::uint64_t{1} << 60U;
  expect(judge(), "disk", Verdict::kFail, "MiB free", {"state"});
}

TEST_F(SelfTest, AnOverdueCalibration) {
  config_.realtime.enforce = false;
  before_ = [this] {
    calibration::Record r;
    r.rig = config_.name;
    r.mode = calibration::Mode::kCheck;
    r.made_utc = "2026-01-01T00:00:00Z";
    r.id = calibration::record_id(r.made_utc, r.channel);
    r.due = "2026-06-01";
    r.operator_name = "R. Boyle";
    r.reference = {"gauge", "", "2026-12-31", 0.01};
    r.points = {{0.0, 0.01, 0.0, 0.0}};
    r.result = calibration::calibrate(r.channel, r.mode, r.points, r.before, 0.01);
    const auto kept = host_->add_calibration(to_toml(r));
    EXPECT_TRUE(kept.ok) << kept.text;
  };
  expect(judge(), "calibration.pressure", Verdict::kFail, "OVERDUE");
}

TEST(SelfTestAir, LeakFillAndVent) {
  const auto verdicts = [](const cli::AirTest& t) {
    std::vector<Verdict> v;
    for (const auto& l : cli::judge_air(t)) v.push_back(l.verdict);
    return v;
  };
  using enum Verdict;
  EXPECT_EQ(verdicts({5, 5.02, 5.02, 4.99, 20, 0.1}), (std::vector{kOk, kOk, kOk}));
  EXPECT_EQ(verdicts({5, 5.02, 5.02, 4.72, 20, 0.1}), (std::vector{kOk, kWarn, kOk}));  // 0.9 psi/min
  EXPECT_EQ(verdicts({5, 5.02, 5.02, 2.0, 20, 0.1}), (std::vector{kOk, kFail, kOk}));
  EXPECT_EQ(verdicts({5, 3.0, 3.0, 3.0, 20, 1.5}), (std::vector{kFail, kOk, kFail}));
}

TEST(SelfTestLcm, HeardOrNot) {
  const nlohmann::json on{{"lcm", {{"enabled", true}, {"url", "udpm://"}}}}, off{{"lcm", {{"enabled", false}}}};
  EXPECT_EQ(cli::judge_lcm(on, 200, 2.0).verdict, Verdict::kOk);
  EXPECT_EQ(cli::judge_lcm(on, 0, 2.0).verdict, Verdict::kFail);
  EXPECT_EQ(cli::judge_lcm(on, -1, 2.0).verdict, Verdict::kFail);
  EXPECT_EQ(cli::judge_lcm(off, 0, 2.0).verdict, Verdict::kSkipped);
}

}  // namespace
}  // namespace isorig::daemon::test
