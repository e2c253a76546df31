// The daemon and the emulated rig on real lines: what is cut, restarted, killed or not taken is an event, a standstill,
// or a run that goes on where it was.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "messages/recording.hpp"
#include "messages/run_log.hpp"
#include "truth.hpp"
#include "wire_rig.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

class WireEvents : public WireRig {
 protected:
  std::string rig_text() const override { return WireRig::rig_text() + "\n[lcm]\nenabled = false\n"; }

  std::string start_protocol(const std::string& steps) {
    spit(dir_ / "test.toml",
         "format = \"isorig-protocol/1\"\nname = \"test\"\nrecording.policy = \"round_ramps\"\nsteps = [\n" + steps +
             "]\n");
    return started_run(daemon_->call({"start", (dir_ / "test.toml").string(), "--operator", "Ada"}));
  }
  double position_mm() const { return daemon_->status().value("position_mm", 0.0); }
  bool logged(const std::string& words, double seconds = 20.0) {
    return wait_until(seconds, [&] { return daemon_->log().find(words) != std::string::npos; });
  }
  nlohmann::json show(const std::string& run_id) const {
    return isorig(dir_, {"show", run_id, "--json", "--runs", (dir_ / "runs").string()}).json();
  }
};

std::vector<nlohmann::json> events_of(const nlohmann::json& shown, const std::string& code) {
  std::vector<nlohmann::json> found;
  for (const auto& e : shown["events"]) {
    if (e["code"] == code) found.push_back(e);
  }
  return found;
}

TEST_F(WireEvents, EachCutAndRestartWithinTheAgeLimitIsInTheRecording) {
  ASSERT_NO_FATAL_FAILURE(start(false));
  const auto id =
      start_protocol(R"(  { do = "pressurize", pressure_psi = 0, rate_psi_s = 5, settled_for_s = 0.2, timeout_s = 30 },
  { do = "ramp", to_mm = 0.5, velocity_mm_s = 1 },
  { do = "hold", duration_s = 600 },
)");
  ASSERT_TRUE(wait_until(40.0, [&] { return position_mm() > 0.49; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(500));

  EXPECT_EQ(say("fault frame disconnect on"), "ok\n");
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(say("fault frame disconnect off"), "ok\n");
  EXPECT_TRUE(logged("reconnect.frame")) << daemon_->log();
  EXPECT_EQ(say("fault frame restart on"), "ok\n");
  EXPECT_TRUE(logged("restart.frame")) << daemon_->log();
  EXPECT_TRUE(logged("the frame's clock was set or restarted")) << daemon_->log();
  EXPECT_EQ(say("fault teensy corrupt 200"), "ok\n");
  EXPECT_TRUE(logged("lost.pressure")) << daemon_->log();
  EXPECT_EQ(say("fault teensy corrupt 0"), "ok\n");
  EXPECT_EQ(say("fault teensy hang-up on"), "ok\n");
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(say("fault teensy hang-up off"), "ok\n");
  EXPECT_TRUE(logged("reconnect.pressure")) << daemon_->log();
  EXPECT_EQ(say("fault teensy unplug on"), "ok\n");
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(say("fault teensy unplug off"), "ok\n");
  EXPECT_TRUE(logged("the Teensy's clock was set or restarted")) << daemon_->log();
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));  // losses are told once a second
  EXPECT_EQ(daemon_->state(), "running") << "none of it was longer than an age limit\n" << daemon_->log();
  ASSERT_EQ(daemon_->call({"abort"}).code, 0);
  ASSERT_TRUE(daemon_->reach("ready")) << daemon_->log();
  EXPECT_EQ(daemon_->process().stop(SIGTERM), 0) << daemon_->log();

  const auto shown = show(id);
  EXPECT_GE(events_of(shown, "reconnect.frame").size(), 2U) << shown["events"].dump(1);
  EXPECT_EQ(events_of(shown, "restart.frame").size(), 1U);
  EXPECT_GE(events_of(shown, "reconnect.pressure").size(), 2U);
  EXPECT_GE(events_of(shown, "clock.restarted").size(), 2U);
  // A corrupt frame is lost for its samples as well, and that is told apart from frames that never came.
  bool corrupt = false;
  for (const auto& e : events_of(shown, "lost.pressure")) {
    const auto text = e["text"].get<std::string>();
    EXPECT_THAT(text, HasSubstr("frames came corrupt"));
    corrupt = corrupt || text.find("; 0 frames") == std::string::npos;
  }
  EXPECT_TRUE(corrupt) << shown["events"].dump(1);
  const auto lost = shown["losses"][0]["pressure_missing"].get<int>();
  EXPECT_GT(lost, 0);

  const auto text = isorig(dir_, {"show", id, "--runs", (dir_ / "runs").string()}).text;
  EXPECT_THAT(text, HasSubstr("and " + std::to_string(lost) + " of the pressure sensor"));
  for (const auto* code :
       {"reconnect.frame", "restart.frame", "reconnect.pressure", "clock.restarted", "lost.pressure"}) {
    EXPECT_THAT(text, HasSubstr(code));
  }
  EXPECT_THAT(text, HasSubstr("frame isorig, simulated frame, SIM-FRAME-1, 1.0"));
  EXPECT_THAT(text, HasSubstr("kernel Linux"));
  const auto segment = messages::list_segments(dir_ / "runs" / id).front();
  const auto one = isorig(dir_, {"show", segment.string(), "--events"});
  EXPECT_THAT(one.text, HasSubstr("restart.frame")) << "a segment is a log of its own";

  // And who has only the export.
  (void)isorig(dir_, {"export", id, "--runs", (dir_ / "runs").string(), "--out", (dir_ / "out").string()});
  std::string toml;
  for (const auto& entry : std::filesystem::directory_iterator(dir_ / "out")) {
    toml = messages::read_recording(entry.path()).metadata.further_toml;
  }
  for (const auto* words : {"reconnect.frame", "restart.frame", "reconnect.pressure", "clock.restarted", "'ramp'",
                            "'hold'", "SIM-FRAME-1", "git = ", "lcm = ", "kernel = ", "operator = 'Ada'"}) {
    EXPECT_THAT(toml, HasSubstr(words));
  }
  EXPECT_THAT(toml, HasSubstr("pressure_samples = " + std::to_string(lost)));
}

/// Of the truth: when the crosshead moved last, in a window, at more than `mm_s`.
std::int64_t moved_until_ns(const std::filesystem::path& csv, std::int64_t from_ns, std::int64_t to_ns, double mm_s) {
  std::ifstream in(csv);
  std::string line;
  std::int64_t last_ns = 0, before_ns = 0;
  double before_mm = 0.0;
  while (std::getline(in, line) && !in.eof()) {  // the last line may be half a line: it is being written
    long long ns = 0;
    double mm = 0.0;
    if (std::sscanf(line.c_str(), "%lld,%lf", &ns, &mm) != 2) continue;
    if (before_ns > 0 && ns > from_ns && ns <= to_ns &&
        std::abs(mm - before_mm) > mm_s * 1e-9 * static_cast<double>(ns - before_ns)) {
      last_ns = ns;
    }
    before_ns = ns;
    before_mm = mm;
  }
  return last_ns;
}

TEST_F(WireEvents, AStopThatIsNotTakenIsASafeStateUntilTheFrameStands) {
  constexpr double kWatchdog_s = 2.0;  // of rig_text()
  ASSERT_NO_FATAL_FAILURE(start(false));
  for (const auto* fault : {"stop-lost", "stop-busy", "stop-cut"}) {
    start_protocol(R"(  { do = "pressurize", pressure_psi = 0, rate_psi_s = 5, settled_for_s = 0.2, timeout_s = 30 },
  { do = "ramp", to_mm = 0, velocity_mm_s = 10 },
  { do = "ramp", to_mm = 4, velocity_mm_s = 0.5 },
)");
    ASSERT_TRUE(wait_until(40.0, [&] {
      const auto s = daemon_->status();
      return s.value("target_mm", 0.0) == 4.0 && s.value("position_mm", 0.0) > 0.05;
    })) << daemon_->log();
    EXPECT_EQ(say("fault frame " + std::string(fault) + " on"), "ok\n");
    const auto request_ns = now_ns();
    (void)daemon_->call({"pause"});
    const auto requested_by_ns = now_ns();  // by then
    ASSERT_TRUE(daemon_->reach("faulted", 20.0)) << fault << daemon_->log();
    EXPECT_THAT(daemon_->status().dump(), HasSubstr("frame.stop")) << fault;
    EXPECT_EQ(daemon_->call({"reset"}).code, 5) << fault << ": nobody has seen it stand";
    EXPECT_FALSE(wait_until(4.0, [&] { return daemon_->state() != "faulted"; })) << fault;
    EXPECT_EQ(say("clear"), "ok\n");
    ASSERT_TRUE(wait_until(30.0, [&] { return daemon_->call({"reset"}).code == 0; }))
        << fault << daemon_->status().dump(2);
    ASSERT_TRUE(daemon_->reach("ready", 30.0)) << fault << daemon_->status().dump(2);
    const auto ready_ns = now_ns();
    const auto moved_ns = moved_until_ns(dir_ / "truth.csv", request_ns, ready_ns, 0.05);
    std::printf("  %s: moved until %.3f s after the request\n", fault,
                1e-9 * static_cast<double>(moved_ns - request_ns));
    EXPECT_LT(1e-9 * static_cast<double>(moved_ns - requested_by_ns), kWatchdog_s + 0.25) << fault << daemon_->log();
    EXPECT_GT(1e-9 * static_cast<double>(moved_ns - request_ns), 0.3) << fault << ": it was not tried";
  }
  EXPECT_EQ(daemon_->process().stop(SIGTERM), 0) << daemon_->log();
}

/// Where each step of one attempt began.
struct Steps : messages::RunVisitor {
  struct Step {
    std::int32_t attempt = 0, session = 0;
    std::int64_t mono_ns = 0;
    std::string kind;
  };
  void header(const isorig_msgs::run_header_t& h) override { attempt = h.attempt; }
  void event(const isorig_msgs::event_t& m) override {
    if (m.code == "step") steps.push_back({attempt, m.session, m.mono_ns, m.text});
    if (m.severity >= isorig_msgs::event_t::PROGRAM_STOP) stops.push_back(m.code + ": " + m.text);
  }
  void session(const isorig_msgs::session_mark_t& m) override {
    if (m.kind == isorig_msgs::session_mark_t::END && m.complete != 0) complete.push_back(m.session.session);
  }
  std::int32_t attempt = 0;
  std::vector<Step> steps;
  std::vector<std::string> stops;
  std::vector<std::int32_t> complete;
};

// A frame echoes the number of the last segment it was given, whoever gave it: a new daemon must not take that for its
// own, or the approach is skipped and a ramp begins where the crosshead happens to be.
TEST_F(WireEvents, AKilledRunIsResumedWithEachApproachAndSegmentCarriedOut) {
  ASSERT_NO_FATAL_FAILURE(start(false));
  const auto id = start_protocol(R"(  { do = "repeat", unit = "session", for = { repetition = [1, 2, 3] }, steps = [
    { do = "pressurize", pressure_psi = 0, rate_psi_s = 5, settled_for_s = 0.2, timeout_s = 30 },
    { do = "ramp", to_mm = -1, velocity_mm_s = 0.5 },
    { do = "hold", duration_s = 1 },
    { do = "ramp", to_mm = 2, velocity_mm_s = 2 },
    { do = "hold", duration_s = 1 },
    { do = "ramp", to_mm = 0.5, velocity_mm_s = 5 },
  ] },
)");
  constexpr double kTargets_mm[] = {-1.0, 2.0, 0.5};
  const auto kill_and_resume = [&] {
    (void)daemon_->process().stop(SIGKILL);
    start_daemon();
    const auto answer = daemon_->call({"resume", id});
    ASSERT_EQ(answer.code, 0) << answer.text;
  };
  const auto at_start = [&] { return wait_until(40.0, [&] { return position_mm() < -0.99; }); };
  // In the first approach, whose number a new daemon's count begins with; in mid-ramp; standing at a target, when the
  // frame says "reached" with the number of the last segment; at the end of an approach.
  ASSERT_TRUE(wait_until(40.0, [&] { return position_mm() < -0.2; }));
  ASSERT_NO_FATAL_FAILURE(kill_and_resume());
  ASSERT_TRUE(at_start());
  ASSERT_TRUE(wait_until(40.0, [&] { return position_mm() > 0.2 && position_mm() < 1.8; }));
  ASSERT_NO_FATAL_FAILURE(kill_and_resume());
  ASSERT_TRUE(at_start());
  ASSERT_TRUE(wait_until(40.0, [&] { return position_mm() > 1.99; }));
  ASSERT_NO_FATAL_FAILURE(kill_and_resume());
  ASSERT_TRUE(at_start());
  ASSERT_NO_FATAL_FAILURE(kill_and_resume());
  const auto watched = daemon_->call({"watch", "--until-done", "--interval-s", "1"}, 120.0);
  EXPECT_EQ(watched.code, 0) << watched.text << daemon_->log();
  EXPECT_EQ(daemon_->process().stop(SIGTERM), 0) << daemon_->log();
  EXPECT_EQ(simrig_->stop(SIGTERM), 0) << simrig_->output();

  Steps run;
  const auto report = messages::read_run(dir_ / "runs" / id, run);
  EXPECT_TRUE(run.stops.empty()) << testing::PrintToString(run.stops);
  std::sort(run.complete.begin(), run.complete.end());
  EXPECT_EQ(run.complete, (std::vector<std::int32_t>{0, 1, 2})) << testing::PrintToString(report.complaints());

  const auto truth = Truth::read(dir_ / "truth.csv");
  int ramps = 0, seen = 0;
  for (std::size_t i = 0, n = 0; i + 1 < run.steps.size(); ++i) {
    const auto& step = run.steps[i];
    const bool first = i == 0 || run.steps[i - 1].attempt != step.attempt || run.steps[i - 1].session != step.session;
    if (first) n = 0;
    if (step.kind != "ramp") continue;
    ASSERT_LT(n, std::size(kTargets_mm));
    const double target_mm = kTargets_mm[n++];
    // Cut off by a kill: what comes next is another attempt's.
    if (run.steps[i + 1].attempt != step.attempt) continue;
    ++ramps;
    const auto begin = truth.at(step.mono_ns, &PlantState::position_mm);
    const auto end = truth.at(run.steps[i + 1].mono_ns, &PlantState::position_mm);
    if (end) {
      ++seen;
      EXPECT_NEAR(end->value, target_mm, 0.02)
          << "attempt " << step.attempt << ", session " << step.session << ", ramp " << n;
    }
    if (begin && n > 1) {
      EXPECT_NEAR(begin->value, kTargets_mm[n - 2], 0.02)
          << "attempt " << step.attempt << ", session " << step.session << ", ramp " << n;
    }
  }
  std::printf("  %d attempts, %d ramps carried to their end, %d of them seen in the plant's truth\n", run.attempt,
              ramps, seen);
  EXPECT_EQ(run.attempt, 5);
  EXPECT_GE(ramps, 8);  // three times three, without the last of all
  EXPECT_GE(2 * seen, ramps) << "the simulator's host stood still too often";
}

}  // namespace
}  // namespace isorig::system_test
