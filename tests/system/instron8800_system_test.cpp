// The daemon with a frame behind an 8800-type controller, over TCP and a pseudo-terminal, against isorig-simrig: what
// is recorded is what the plant did, and a controller that hangs or is gone ends as it should.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "messages/run_log.hpp"
#include "processes.hpp"
#include "truth.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;

class Rig8800 : public testing::Test {
 protected:
  /// The shipped rig, with time limits for a machine that stands still now and then.
  std::string rig_text() const {
    auto text = slurp(source("config/rigs/" + rig_file_));
    text = replaced(text, "\"../", "\"" + source("config/"));
    text = replaced(text, "port = \"/tmp/isorig-sim-teensy\"", "port = \"" + (dir_ / "teensy").string() + "\"");
    for (const auto* age :
         {"frame_age_max_s = 1.0", "pressure_age_max_s = 0.5", "interlock_age_max_s = 1.0", "late_tick_max_s = 0.5"}) {
      text = replaced(text, age, std::string(age).substr(0, std::string(age).find('=')) + "= 2.0");
    }
    text = replaced(text, "late_tick_max_s = 2.0",
                    "late_tick_max_s = 2.0\nsegment_ack_max_s = 2.0\nfollowing_error_max_mm = 2.0");
    text = replaced(text, "heartbeat_timeout_s = 0.5", "heartbeat_timeout_s = 2.0");
    text = replaced(text, "watchdog_s = 0.5", "watchdog_s = 2.0");
    text = replaced(text, "response_timeout_ms = 400", "response_timeout_ms = 400\nheartbeat_timeout_ms = 2000");
    if (text.find("[regulator]") != std::string::npos) {
      text = replaced(text, "/tmp/isorig-sim-regulator", (dir_ / "regulator").string());
      text = replaced(text, "baud = 19200\n", "baud = 19200\nage_max_s = 2.0\nresponse_timeout_ms = 400\n");
    }
    return text + "\n[lcm]\nenabled = false\n";
  }

  void start(bool tcp) {
    auto text = rig_text();
    if (!tcp) {
      text = replaced(text, "transport = \"tcp\"\nhost = \"127.0.0.1\"\nport = 1503",
                      "transport = \"tty\"\nbaud = 115200\ntty = \"" + (dir_ / "frame").string() + "\"");
      // The characters of such a line take their time: `isorig check` asks for 0.31 s.
      text = replaced(text, "[supervisor]\n", "[supervisor]\nstop_confirm_max_s = 0.31\n");
    }
    const auto rig = dir_ / "rig.toml";
    spit(rig, text);
    std::vector<std::string> words{
        bin("isorig-simrig"),       "--rig", rig.string(), "--truth", (dir_ / "truth.csv").string(), "--control",
        (dir_ / "control").string()};
    if (tcp) words.insert(words.end(), {"--port", "0"});
    simrig_.emplace(words, dir_ / "simrig.log");
    ASSERT_TRUE(wait_until(20.0, [&] { return simrig_->output().find("ready") != std::string::npos; }))
        << simrig_->output();
    if (tcp) {
      const auto said = simrig_->output();
      const std::string before = "frame: tcp 127.0.0.1:";
      const auto at = said.find(before);
      ASSERT_NE(at, std::string::npos) << said;
      const auto end = said.find('\n', at);
      spit(rig, replaced(text, "port = 1503", "port = " + said.substr(at + before.size(), end - at - before.size())));
    }
    daemon_.emplace(dir_, rig);
    ASSERT_TRUE(daemon_->reach("ready")) << daemon_->log() << daemon_->status().dump(2);
  }

  std::string say(const std::string& line) const {
    return run(dir_, {bin("isorig-simrig"), "send", (dir_ / "control").string(), line}).text;
  }
  bool vents() {
    return wait_until(30.0, [&] { return daemon_->status().value("pressure_psi", 99.0) < 0.6; });
  }
  /// Of the plant itself, by the truth it writes.
  double velocity_now_mm_s() const {
    const auto last = [&] {
      const auto text = slurp(dir_ / "truth.csv");
      const auto end = text.rfind('\n');
      const auto begin = text.rfind('\n', end - 1);
      long long ns = 0;
      double mm = 0.0;
      std::sscanf(text.c_str() + begin + 1, "%lld,%lf", &ns, &mm);
      return std::pair{ns, mm};
    };
    const auto [t0, x0] = last();
    std::this_thread::sleep_for(std::chrono::seconds(1));
    const auto [t1, x1] = last();
    return t1 > t0 ? (x1 - x0) / (1e-9 * static_cast<double>(t1 - t0)) : 0.0;
  }

  void run_and_compare(const std::string& protocol) {
    const auto id = started_run(daemon_->call({"start", protocol}));
    ASSERT_FALSE(id.empty());
    const auto watched = daemon_->call({"watch", "--until-done", "--interval-s", "1"}, 150.0);
    const auto status = daemon_->status();
    EXPECT_EQ(watched.code, 0) << watched.text << status.dump(2) << daemon_->log();
    std::printf("  loop: %s\n  frame: %s\n", status["loop"].dump().c_str(), status["frame"].dump().c_str());
    EXPECT_EQ(daemon_->process().stop(SIGTERM), 0) << daemon_->log();
    EXPECT_EQ(simrig_->stop(SIGTERM), 0) << simrig_->output();

    const auto truth = Truth::read(dir_ / "truth.csv");
    RunComparison comparison(truth);
    comparison.position.noise = 0.003;  // and what a position between two readings may be off at 600 mm/s^2
    const auto report = messages::read_run(dir_ / "runs" / id, comparison);
    EXPECT_TRUE(report.whole()) << testing::PrintToString(report.complaints());
    comparison.finish();
    comparison.print();
    EXPECT_GT(comparison.position.compared, 300U);
    // Nearly all: the truth may lack a step where its writer waited its turn.
    EXPECT_LE(comparison.position.outside, comparison.position.compared / 200) << comparison.position.worst_excess;
    EXPECT_LE(comparison.force.outside, comparison.force.compared / 200) << comparison.force.worst_excess;
    EXPECT_EQ(comparison.pressure_psi.outside, 0U) << comparison.pressure_psi.worst_excess;
    EXPECT_EQ(comparison.frame_sequence.missing, 0U);
    EXPECT_EQ(comparison.frame_sequence.repeated, 0U);
  }

  /// Pressurized and ramping slowly, for a fault to hit.
  void be_busy() {
    spit(dir_ / "busy.toml", R"(format = "isorig-protocol/1"
name = "busy"
recording.policy = "round_ramps"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 30 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 0.1 },
]
)");
    started_run(daemon_->call({"start", (dir_ / "busy.toml").string()}));
    ASSERT_TRUE(wait_until(40.0, [&] { return daemon_->status().value("position_mm", 0.0) > 0.1; }))
        << daemon_->status().dump(2);
  }

  std::string rig_file_ = "sim-8800.toml";
  TempDir dir_;
  std::optional<Process> simrig_;
  std::optional<DaemonProcess> daemon_;
};

TEST_F(Rig8800, TcpRecordsWhatThePlantDid) {
  ASSERT_NO_FATAL_FAILURE(start(true));
  run_and_compare(source("config/protocols/vma-smoke.toml"));
}

TEST_F(Rig8800, PtyRecordsWhatThePlantDid) {
  ASSERT_NO_FATAL_FAILURE(start(false));
  spit(dir_ / "short.toml", R"(format = "isorig-protocol/1"
name = "short"
recording.policy = "round_ramps"
recording.before_s = 1.0
recording.after_s = 1.0
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 20 },
  { do = "ramp", to_mm = 1, velocity_mm_s = 10 },
  { do = "hold", duration_s = 2 },
  { do = "ramp", to_mm = 0, velocity_mm_s = 0.5 },
]
)");
  run_and_compare((dir_ / "short.toml").string());
}

TEST_F(Rig8800, AShortHangIsWaitedForAndALongOneIsASafeState) {
  ASSERT_NO_FATAL_FAILURE(start(true));
  ASSERT_NO_FATAL_FAILURE(be_busy());
  const auto errors = daemon_->status()["frame"].value("errors", 0);
  EXPECT_EQ(say("fault frame hang 800"), "ok\n");
  EXPECT_TRUE(wait_until(10.0, [&] { return daemon_->status()["frame"].value("errors", 0) > errors; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  EXPECT_EQ(daemon_->state(), "running") << daemon_->status().dump(2);
  EXPECT_EQ(daemon_->status()["frame"].value("reconnects", 0), 0);
  EXPECT_NEAR(velocity_now_mm_s(), 0.1, 0.02);

  EXPECT_EQ(say("fault frame hang 6000"), "ok\n");
  ASSERT_TRUE(daemon_->reach("faulted", 20.0)) << daemon_->status().dump(2);
  EXPECT_THAT(daemon_->status().value("fault", ""), HasSubstr("stale.frame"));
  EXPECT_TRUE(vents());
  // The controller took no stop while it hung; its watchdog did what it is for.
  EXPECT_TRUE(wait_until(20.0, [&] { return say("list").find("frame actuator-off on") != std::string::npos; }))
      << say("list");
  EXPECT_NEAR(velocity_now_mm_s(), 0.0, 0.005);
  EXPECT_EQ(daemon_->call({"reset"}).code, 5);  // the actuator is off: somebody has to go there
  // And when the controller has come back: a command from before, without control by now, would trip it again.
  EXPECT_TRUE(wait_until(30.0, [&] { return say("list").find("frame panel off") != std::string::npos; }))
      << say("list");
  EXPECT_EQ(say("fault frame actuator-off off"), "ok\n");
  EXPECT_TRUE(wait_until(30.0, [&] { return daemon_->call({"reset"}).code == 0; })) << daemon_->status().dump(2);
  EXPECT_TRUE(daemon_->reach("ready", 20.0)) << daemon_->status().dump(2);
}

TEST_F(Rig8800, ADisconnectionMidRampIsASafeState) {
  ASSERT_NO_FATAL_FAILURE(start(true));
  ASSERT_NO_FATAL_FAILURE(be_busy());
  EXPECT_EQ(say("fault frame disconnect on"), "ok\n");
  ASSERT_TRUE(daemon_->reach("faulted", 20.0)) << daemon_->status().dump(2);
  EXPECT_THAT(daemon_->status().value("fault", ""), HasSubstr("frame"));
  EXPECT_TRUE(vents());
  EXPECT_TRUE(wait_until(20.0, [&] { return say("list").find("frame actuator-off on") != std::string::npos; }))
      << say("list");
  EXPECT_NEAR(velocity_now_mm_s(), 0.0, 0.005);
  EXPECT_EQ(say("fault frame disconnect off"), "ok\n");
  EXPECT_EQ(say("fault frame actuator-off off"), "ok\n");
  EXPECT_TRUE(wait_until(30.0, [&] { return daemon_->call({"reset"}).code == 0; })) << daemon_->status().dump(2);
  EXPECT_TRUE(daemon_->reach("ready", 20.0)) << daemon_->status().dump(2);
  EXPECT_GT(daemon_->status()["frame"]["reconnects"].get<int>(), 0);
}

class RigRegulator : public Rig8800 {
 protected:
  RigRegulator() { rig_file_ = "sim-8800-regulator.toml"; }
};

TEST_F(RigRegulator, SetsThePressureThatTheElvhMeasures) {
  ASSERT_NO_FATAL_FAILURE(start(true));
  EXPECT_TRUE(daemon_->status()["regulator"].value("connected", false));
  run_and_compare(source("config/protocols/vma-smoke.toml"));
  const auto truth = Truth::read(dir_ / "truth.csv");
  EXPECT_GT(truth.size(), 10'000U);
}

TEST_F(RigRegulator, IsASafeStateWhenItIsGone) {
  ASSERT_NO_FATAL_FAILURE(start(true));
  ASSERT_NO_FATAL_FAILURE(be_busy());
  EXPECT_EQ(say("fault regulator disconnect on"), "ok\n");  // it goes on regulating; nobody can tell it to stop
  ASSERT_TRUE(daemon_->reach("faulted", 20.0)) << daemon_->status().dump(2);
  EXPECT_THAT(daemon_->status().value("fault", ""), HasSubstr("stale.regulator"));
  EXPECT_TRUE(vents());  // supply and vent valve are the Teensy's
  EXPECT_NEAR(velocity_now_mm_s(), 0.0, 0.005);
  EXPECT_EQ(daemon_->call({"reset"}).code, 5);
  EXPECT_EQ(say("fault regulator disconnect off"), "ok\n");
  EXPECT_TRUE(wait_until(30.0, [&] { return daemon_->call({"reset"}).code == 0; })) << daemon_->status().dump(2);
  EXPECT_TRUE(daemon_->reach("ready", 20.0)) << daemon_->status().dump(2);
}

TEST_F(RigRegulator, IsASafeStateWhenItReadsAnotherPressure) {
  ASSERT_NO_FATAL_FAILURE(start(true));
  ASSERT_NO_FATAL_FAILURE(be_busy());
  EXPECT_EQ(say("fault regulator sensor-off on"), "ok\n");
  ASSERT_TRUE(daemon_->reach("faulted", 20.0)) << daemon_->status().dump(2);
  EXPECT_THAT(daemon_->status().value("fault", ""), HasSubstr("regulator.disagrees"));
  EXPECT_TRUE(vents());
}

struct RegulatorFault {
  const char* name;
  const char* on;
  const char* off;
  const char* keeps_from_ready;  ///< empty: between runs nothing is asked of the regulator that would show it
  const char* code;              ///< the beginning of what a run ends with
};

void PrintTo(const RegulatorFault& fault, std::ostream* out) {
  *out << fault.name;
}

class RigRegulatorFault : public RigRegulator, public testing::WithParamInterface<RegulatorFault> {
 protected:
  void hold_5_psi() {
    spit(dir_ / "hold.toml", R"(format = "isorig-protocol/1"
name = "hold"
recording.policy = "round_ramps"
steps = [
  { do = "pressurize", pressure_psi = 5, rate_psi_s = 5, settled_for_s = 0.3, timeout_s = 30 },
  { do = "hold", duration_s = 300 },
]
)");
    started_run(daemon_->call({"start", (dir_ / "hold.toml").string()}));
    const auto holds = [&] {
      const auto status = daemon_->status();
      return status.contains("run") && status["run"].is_object() && status["run"].value("step", 0) == 1;
    };
    ASSERT_TRUE(wait_until(40.0, holds)) << daemon_->status().dump(2);
  }

  void is_a_safe_state_until_it_is_repaired() {
    const auto& f = GetParam();
    EXPECT_EQ(say(f.on), "ok\n");
    ASSERT_TRUE(daemon_->reach("faulted", 20.0)) << daemon_->status().dump(2);
    EXPECT_THAT(daemon_->status().value("fault", ""), HasSubstr(f.code));
    EXPECT_TRUE(vents());
    EXPECT_NEAR(velocity_now_mm_s(), 0.0, 0.005);
    EXPECT_EQ(say(f.off), "ok\n");
    EXPECT_TRUE(wait_until(30.0, [&] { return daemon_->call({"reset"}).code == 0; })) << daemon_->status().dump(2);
    ASSERT_TRUE(daemon_->reach("ready", 20.0)) << daemon_->status().dump(2);
  }
};

TEST_P(RigRegulatorFault, KeepsFromReadyAndIsASafeStateInHoldAndRamp) {
  const auto& f = GetParam();
  ASSERT_NO_FATAL_FAILURE(start(true));
  if (*f.keeps_from_ready != '\0') {
    EXPECT_EQ(say(f.on), "ok\n");
    EXPECT_TRUE(daemon_->reach("idle", 20.0)) << daemon_->status().dump(2);
    EXPECT_THAT(daemon_->status().value("not_ready", ""), HasSubstr(f.keeps_from_ready));
    EXPECT_EQ(say(f.off), "ok\n");
    ASSERT_TRUE(daemon_->reach("ready", 30.0)) << daemon_->status().dump(2);
  }
  ASSERT_NO_FATAL_FAILURE(hold_5_psi());
  ASSERT_NO_FATAL_FAILURE(is_a_safe_state_until_it_is_repaired());
  ASSERT_NO_FATAL_FAILURE(be_busy());
  ASSERT_NO_FATAL_FAILURE(is_a_safe_state_until_it_is_repaired());
}

// What a float with its words the wrong way round reads as is no reading at one pressure, and near 0 at another: the
// set-point that is not the one sent is found first, or five readings that are none.
INSTANTIATE_TEST_SUITE_P(All, RigRegulatorFault,
                         testing::Values(RegulatorFault{"Silent", "fault regulator drop 1000000",
                                                        "fault regulator drop 0", "does not answer", "stale.regulator"},
                                         RegulatorFault{"Nonsense", "fault regulator swap-words on",
                                                        "fault regulator swap-words off", "", "regulator"},
                                         RegulatorFault{"AnotherPressure", "fault regulator sensor-off on",
                                                        "fault regulator sensor-off off", "", "regulator.disagrees"}),
                         [](const auto& row) { return std::string(row.param.name); });

}  // namespace
}  // namespace isorig::system_test
