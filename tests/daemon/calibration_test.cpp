#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <toml++/toml.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "calibration/date.hpp"
#include "calibration/record.hpp"
#include "daemon/export/export.hpp"
#include "daemon/host/host.hpp"
#include "daemon/host/virtual_run.hpp"
#include "daemon/rig/calibrations.hpp"
#include "messages/recording.hpp"
#include "recording_rig.hpp"
#include "rig_fixture.hpp"

/// Calibration of a simulated rig whose errors are known, against the plant's truth, through the host.
namespace isorig::daemon::test {
namespace {

using calibration::Channel;
using calibration::Mode;
using nlohmann::json;
using ::testing::HasSubstr;

StartOptions protocol(const std::string& steps) {
  StartOptions start;
  start.protocol_text = "format = \"isorig-protocol/1\"\nname = \"points\"\nsteps = [\n" + steps + "]\n";
  return start;
}

class CalibratedRig : public ::testing::Test {
 protected:
  CalibratedRig() {
    config_.sim->pressure.offset_psi = 0.18;
    config_.sim->pressure.gain = 1.012;
    config_.sim->frame.force_gain = 0.97;
    config_.sim->frame.force_offset_N = 0.4;
    config_.sim->frame.position_gain = 1.01;
  }

  void open() {
    rig_ = std::make_unique<VirtualRig>(config_);
    Host::Options options;
    options.runs_root = folder_.path() / "runs";
    options.breathe = [this] { tick(); };
    host_ = std::make_unique<Host>(config_, rig_->core(), rig_->streams, options);
    run_until([&] { return rig_->core().state() == RunState::kReady; });
  }
  void tick() {
    rig_->tick();
    if (rig_->now_ns() % 20'000'000 == 0) host_->turn(rig_->now_ns());
  }
  void run_for(double seconds) {
    const auto until = rig_->now_ns() + static_cast<std::int64_t>(seconds * 1e9);
    while (rig_->now_ns() < until) tick();
  }
  template <typename Condition>
  void run_until(Condition condition) {
    const auto until = rig_->now_ns() + 300'000'000'000;
    while (!condition()) {
      ASSERT_LT(rig_->now_ns(), until) << host_->status_json().dump(2);
      tick();
    }
  }

  /// One point: the mean of the last two seconds against the plant's mean in those.
  calibration::Point point(Channel channel) {
    double sum = 0.0;
    const int ticks = 2000;
    for (int i = 0; i < ticks; ++i) {
      tick();
      const auto t = rig_->rig().truth();
      sum += channel == Channel::kPressure ? t.pressure_psi : channel == Channel::kForce ? t.force_N : t.position_mm;
    }
    const auto all = host_->readings_json(2.0);
    const auto& r = all[name_of(channel)];
    EXPECT_GT(r["samples"], 1900);
    return {sum / ticks, r["raw"], r["standard_error"], r["drift"]};
  }

  std::vector<calibration::Point> points_of_a_run(const std::string& steps, std::size_t holds, Channel channel) {
    const auto started = host_->start(protocol(steps));
    EXPECT_TRUE(started.ok) << started.text;
    std::vector<calibration::Point> points;
    for (std::size_t i = 0; i < holds; ++i) {
      run_until([&] {
        const auto s = host_->status_json();
        return s.contains("run") && s["run"]["step"].get<std::size_t>() == 2 * i + 1 && s["state"] == "running";
      });
      EXPECT_TRUE(host_->verb(Request::Verb::kPause).ok);
      run_for(3.0);
      points.push_back(point(channel));
      EXPECT_TRUE(host_->verb(Request::Verb::kResume).ok);
    }
    run_until([&] { return !host_->run_open(); });
    run_until([&] { return rig_->core().state() == RunState::kReady; });
    return points;
  }

  calibration::Record record_of(Channel channel, const std::vector<calibration::Point>& points,
                                Mode mode = Mode::kAdjust, const std::string& made_utc = "2026-11-21T07:15:00Z") {
    const auto in_force = host_->calibrations_json()["in_force"][name_of(channel)];
    calibration::Record r;
    r.rig = config_.name;
    r.channel = channel;
    r.mode = mode;
    r.made_utc = made_utc;
    r.id = calibration::record_id(made_utc, channel);
    r.due = "2999-01-01";
    r.operator_name = "R. Boyle";
    r.supersedes = in_force["id"];
    r.reference = {"the plant", "", "2999-01-01", 0.0};
    r.before = {in_force["scale"], in_force["offset"]};
    r.points = points;
    r.result = calibration::calibrate(channel, mode, points, r.before, 0.0);
    return r;
  }
  /// What is in force after it, from the daemon.
  json keep(const calibration::Record& record) {
    const auto kept = host_->add_calibration(to_toml(record));
    EXPECT_TRUE(kept.ok) << kept.text;
    return host_->calibrations_json()["in_force"][name_of(record.channel)];
  }

  testing::TemporaryDirectory folder_{"calibration"};
  RigConfig config_ = load_rig(source("config/rigs/sim.toml"));
  std::unique_ptr<VirtualRig> rig_;
  std::unique_ptr<Host> host_;
};

std::string pressurize(const std::vector<double>& pressures_psi) {
  std::string steps;
  for (const double p : pressures_psi) {
    steps += "{ do = \"pressurize\", pressure_psi = " + std::to_string(p) +
             ", rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 30 },\n" + "{ do = \"hold\", duration_s = 1 },\n";
  }
  return steps;
}

TEST_F(CalibratedRig, PressureIsRecoveredFromPointsUpAndDown) {
  open();
  std::vector<calibration::Point> points = {point(Channel::kPressure)};  // vented
  const auto more = points_of_a_run(pressurize({5, 10, 15, 20, 15, 10, 5}), 7, Channel::kPressure);
  points.insert(points.end(), more.begin(), more.end());
  const auto r = record_of(Channel::kPressure, points);
  // The noise is one count before rounding, so sqrt(1 + 1/12) counts, and 2000 samples make a mean: 0.056 mpsi. A line
  // through 8 points with sum of squares 333 psi^2 about their mean of 10 psi: span to 3e-6, zero to 0.037 mpsi. Four
  // of those, and on top the sensor's rounding, which a mean does not average out wholly: 5 % of a count.
  const double count = 30.0 / 13108.0;
  const double mean_error = count * std::sqrt(1.0 + 1.0 / 12.0) / std::sqrt(2000.0) + 0.05 * count;
  const auto in_force = keep(r);
  EXPECT_NEAR(in_force["scale"], 1.0 / 1.012, 4.0 * mean_error / std::sqrt(333.0));
  EXPECT_NEAR(in_force["offset"], -0.18 / 1.012, 4.0 * mean_error * std::sqrt(1.0 / 8.0 + 100.0 / 333.0));
  EXPECT_FALSE(r.result.found_in_band);  // 0.18 + 1.2 % of 20 psi = 0.42 psi
  EXPECT_LT(*r.result.hysteresis, 8.0 * mean_error);
  EXPECT_LT(r.result.as_left_max, r.result.uncertainty);

  // In force at once: what the daemon shows is the truth; what the sensor sent stays what it was.
  const auto again = point(Channel::kPressure);
  const auto shown = host_->readings_json(2.0)["pressure"];
  EXPECT_NEAR(shown["calibrated"], again.reference, 5.0 * mean_error);
  EXPECT_NEAR(shown["raw"], again.reference * 1.012 + 0.18, 5.0 * mean_error);
}

TEST_F(CalibratedRig, ForceAndPositionAreRecovered) {
  config_.limits.travel_max_mm = config_.core.supervisor.limits.travel_max_mm = 8.0;
  open();
  // The specimen is the weight, and the plant's force what a reference cell would show.
  std::string steps =
      "{ do = \"pressurize\", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.5, timeout_s = 30 },\n{ do = "
      "\"hold\", duration_s = 1 },\n";
  for (const auto* to : {"1", "2", "3", "4"}) {
    steps +=
        std::string("{ do = \"ramp\", to_mm = ") + to + ", velocity_mm_s = 2 },\n{ do = \"hold\", duration_s = 1 },\n";
  }
  const auto started = host_->start(protocol(steps));
  ASSERT_TRUE(started.ok) << started.text;
  std::vector<calibration::Point> force, position;
  for (std::size_t i = 0; i < 5; ++i) {
    run_until([&] {
      const auto s = host_->status_json();
      return s.contains("run") && s["run"]["step"].get<std::size_t>() == 2 * i + 1 && s["state"] == "running";
    });
    ASSERT_TRUE(host_->verb(Request::Verb::kPause).ok);
    run_for(10.0);
    force.push_back(point(Channel::kForce));
    position.push_back(point(Channel::kPosition));
    ASSERT_TRUE(host_->verb(Request::Verb::kResume).ok);
  }
  run_until([&] { return !host_->run_open(); });
  run_until([&] { return rig_->core().state() == RunState::kReady; });
  // Noise 0.01 N, 2000 samples: 0.22 mN; the forces reach over some newtons.
  const auto f = keep(record_of(Channel::kForce, force));
  EXPECT_NEAR(f["scale"], 1.0 / 0.97, 5e-4);
  EXPECT_NEAR(f["offset"], -0.4 / 0.97, 5e-3);
  // Noise 0.2 um: 4.5 nm in a mean, over 4 mm.
  const auto p = keep(record_of(Channel::kPosition, position));
  EXPECT_NEAR(p["scale"], 1.0 / 1.01, 1e-5);
  EXPECT_NEAR(p["offset"].get<double>(), 0.0, 1e-12);
}

TEST_F(CalibratedRig, EveryRecordingSaysWhatCorrectedIt) {
  config_.sim->pressure.gain = 1.0;
  open();
  const auto record = record_of(Channel::kPressure, {point(Channel::kPressure)}, Mode::kZero);
  keep(record);
  const auto started = host_->start(protocol(pressurize({5})));
  ASSERT_TRUE(started.ok) << started.text;
  EXPECT_FALSE(host_->add_calibration(to_toml(record)).ok);  // not under a run
  run_until([&] { return !host_->run_open(); });
  EXPECT_TRUE(std::filesystem::exists(host_->run_directory() / "inputs" / "calibration.toml"));

  ExportOptions options;
  options.run_id = host_->run_id();
  (void)export_run(host_->run_directory(), folder_.path() / "out", options);
  const auto exported = messages::read_recording(folder_.path() / "out" / "rep-1_5-psi");
  const auto further = toml::parse(exported.metadata.further_toml);
  EXPECT_EQ(further["calibration"]["pressure"]["id"].value_or(std::string()), record.id);
  EXPECT_NEAR(further["calibration"]["pressure"]["offset"].value_or(0.0), -0.18, 1e-3);
  EXPECT_EQ(further["calibration"]["pressure"]["operator"].value_or(std::string()), "R. Boyle");
  EXPECT_EQ(further["calibration"]["force"]["id"].value_or(std::string("none")), "");

  // A daemon that starts again has it in force, and so has a run in virtual time.
  host_.reset();
  const auto again = with_calibration(config_, folder_.path() / "runs");
  EXPECT_NEAR(again.core.calibration.pressure_offset_psi, -0.18, 1e-3);
}

/// The Teensy knows the sensor's own pressure: its limit lies half a psi above the calibrated one.
TEST_F(CalibratedRig, TheDevicesOwnLimitFollowsTheRecords) {
  open();
  keep(record_of(Channel::kPressure, points_of_a_run(pressurize({5, 10, 15}), 3, Channel::kPressure)));
  host_.reset();
  const auto again = with_calibration(config_, folder_.path() / "runs");
  const auto& c = again.core.calibration;
  EXPECT_NEAR(c.pressure_scale, 1.0 / 1.012, 1e-3);
  EXPECT_NEAR(again.services.fill_limits.pressure_max_psi * c.pressure_scale + c.pressure_offset_psi,
              config_.limits.pressure_max_psi + 0.5, 1e-6);
}

/// A sensor that reads 4 % more: 15.78 at 15 psi, where the device of an uncorrected rig vents at 15.5.
TEST_F(CalibratedRig, TheDevicesOwnLimitFollowsARecordAtOnce) {
  config_.sim->pressure.gain = 1.04;
  config_.limits.pressure_max_psi = config_.core.supervisor.limits.pressure_max_psi = 15.0;
  config_.services.fill_limits = fill_limits(config_);
  open();
  keep(record_of(Channel::kPressure, points_of_a_run(pressurize({5, 10, 14}), 3, Channel::kPressure)));
  const auto started = host_->start(protocol(pressurize({14.9})));
  ASSERT_TRUE(started.ok) << started.text;
  run_until([&] { return !host_->run_open() || rig_->core().state() == RunState::kFaulted; });
  EXPECT_EQ(host_->last_outcome(), "done") << host_->last_fault();
}

TEST_F(CalibratedRig, ACorrectionThatNoRigFileMayHaveIsNotKept) {
  open();
  const auto force = record_of(Channel::kForce, {{0.0, 5000.0, 0.01, 0.0}}, Mode::kZero);
  const auto refused = host_->add_calibration(to_toml(force));
  EXPECT_FALSE(refused.ok);
  EXPECT_THAT(refused.text, HasSubstr("is not kept: force_offset_N = -5000 N; it has to be from"));
  EXPECT_TRUE(host_->calibrations_json()["records"].empty());
  // One that was put among the records by other means stops a daemon before it corrects with it.
  auto records = open_records(config_, folder_.path() / "runs");
  records.add(force);
  EXPECT_THROW((void)with_calibration(config_, folder_.path() / "runs"), base::ConfigError);
}

/// Somebody enters setup while the record is being written: it is in force before a run's header says so.
TEST_F(CalibratedRig, ARecordThatTheLoopDidNotTakeComesIntoForceWithTheNextRun) {
  open();
  const auto record = record_of(Channel::kPressure, {point(Channel::kPressure)}, Mode::kZero);
  Request setup;
  setup.verb = Request::Verb::kSetup;
  rig_->core().requests.push(setup);
  const auto kept = host_->add_calibration(to_toml(record));
  EXPECT_FALSE(kept.ok);
  EXPECT_THAT(kept.text, HasSubstr("put in force before the next run starts"));
  auto shown = host_->calibrations_json();
  EXPECT_EQ(shown["records"].size(), 1U);
  EXPECT_EQ(shown["in_force"]["pressure"]["id"], "");
  EXPECT_NEAR(host_->readings_json(0.1)["pressure"]["calibrated"], host_->readings_json(0.1)["pressure"]["raw"], 1e-12);

  ASSERT_TRUE(host_->verb(Request::Verb::kLeaveSetup).ok);
  run_until([&] { return rig_->core().state() == RunState::kReady; });
  const auto started = host_->start(protocol(pressurize({5})));
  ASSERT_TRUE(started.ok) << started.text;
  EXPECT_EQ(host_->calibrations_json()["in_force"]["pressure"]["id"], record.id);
  run_until([&] { return !host_->run_open(); });
  ExportOptions options;
  options.run_id = host_->run_id();
  (void)export_run(host_->run_directory(), folder_.path() / "out", options);
  const auto exported = messages::read_recording(folder_.path() / "out" / "rep-1_5-psi");
  EXPECT_EQ(toml::parse(exported.metadata.further_toml)["calibration"]["pressure"]["id"].value_or(std::string()),
            record.id);
  EXPECT_NEAR(host_->readings_json(0.1)["pressure"]["calibrated"].get<double>() -
                  host_->readings_json(0.1)["pressure"]["raw"].get<double>(),
              record.result.correction.offset, 1e-12);
}

/// Whoever calibrates again instead of starting a run: the record that waits comes into force first, and one that was
/// made without having seen it is refused; made anew, it follows.
TEST_F(CalibratedRig, ARecordThatWaitsIsNotInTheWayOfTheNext) {
  open();
  const auto first = record_of(Channel::kPressure, {point(Channel::kPressure)}, Mode::kZero);
  Request setup;
  setup.verb = Request::Verb::kSetup;
  rig_->core().requests.push(setup);
  ASSERT_FALSE(host_->add_calibration(to_toml(first)).ok);
  ASSERT_TRUE(host_->verb(Request::Verb::kLeaveSetup).ok);
  run_until([&] { return rig_->core().state() == RunState::kReady; });
  const std::string later = "2026-11-21T08:15:00Z";
  const auto blind = record_of(Channel::kPressure, {point(Channel::kPressure)}, Mode::kZero, later);
  EXPECT_THROW((void)host_->add_calibration(to_toml(blind)), std::runtime_error);
  EXPECT_EQ(host_->calibrations_json()["in_force"]["pressure"]["id"], first.id);
  const auto again = record_of(Channel::kPressure, {point(Channel::kPressure)}, Mode::kZero, later);
  EXPECT_TRUE(host_->add_calibration(to_toml(again)).ok);
  EXPECT_EQ(host_->calibrations_json()["in_force"]["pressure"]["id"], again.id);
}

TEST_F(CalibratedRig, AnOverdueOneWarnsOrRefuses) {
  open();
  auto record = record_of(Channel::kPressure, {point(Channel::kPressure)}, Mode::kCheck);
  record.due = "2026-11-20";
  keep(record);
  ASSERT_EQ(host_->overdue().size(), 1U);
  const auto start = protocol(pressurize({2}));
  config_.calibration.refuse_overdue = true;
  const auto refused = host_->start(start);
  EXPECT_FALSE(refused.ok);
  EXPECT_THAT(refused.text, HasSubstr("was due on 2026-11-20; calibrate (isorig calibrate)"));
  config_.calibration.refuse_overdue = false;
  const auto warned = host_->start(start);
  EXPECT_TRUE(warned.ok);
  EXPECT_THAT(warned.text, HasSubstr("warning: calibration of pressure"));
}

TEST_F(CalibratedRig, SealedAirStaysUntilTheRunGoesOn) {
  open();
  const auto started = host_->start(protocol(pressurize({10})));
  ASSERT_TRUE(started.ok) << started.text;
  EXPECT_FALSE(host_->verb(Request::Verb::kSeal).ok);  // not while it runs
  run_until([&] { return host_->status_json()["run"]["step"] == 1; });
  ASSERT_TRUE(host_->verb(Request::Verb::kPause).ok);
  ASSERT_TRUE(host_->verb(Request::Verb::kSeal).ok);
  run_for(1.0);
  const double before_psi = rig_->rig().truth().pressure_psi;
  run_for(30.0);
  const auto s = host_->status_json();
  EXPECT_EQ(s["fill_permille"], 0);
  EXPECT_EQ(s["vent_permille"], 0);
  const double lost_psi = before_psi - rig_->rig().truth().pressure_psi;
  EXPECT_GT(lost_psi, 0.02);  // leak_mL_s_bar: 0.27 psi/min at 10 psi
  EXPECT_LT(lost_psi, 0.5);
  ASSERT_TRUE(host_->verb(Request::Verb::kResume).ok);
  run_until([&] { return std::abs(rig_->rig().truth().pressure_psi * 1.012 + 0.18 - 10.0) < 0.05; });
}

}  // namespace
}  // namespace isorig::daemon::test
