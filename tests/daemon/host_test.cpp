#include "daemon/host/host.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "daemon/recording/amendments.hpp"
#include "daemon/recording/sqlite.hpp"
#include "daemon/rig/specimen.hpp"
#include "messages/run_log.hpp"
#include "served_rig.hpp"

/// Host and API under many clients at once, on a rig that ticks in a thread of its own.
namespace isorig::daemon::test {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;

const char* const kShort = R"(format = "isorig-protocol/1"
name = "short"
steps = [
  { do = "pressurize", pressure_psi = 0, rate_psi_s = 5, settled_for_s = 0.01, timeout_s = 20 },
  { do = "hold", duration_s = 0.5 } ]
)";

class HostTest : public ServedRig {
 protected:
  HostTest() : ServedRig("host") {}
  void SetUp() override { serve(); }
  void TearDown() override { stop_serving(); }

  std::string aborted_run();
  StartOptions protocol(const char* text = kLongProtocol) {
    StartOptions o;
    o.protocol_text = text;
    return o;
  }
  [[nodiscard]] Answer post(const std::string& path, const std::string& body = {}, bool stops = false) const {
    return call("POST " + path, body, stops);
  }
};

class HostOnADiskThatHangs : public HostTest {
 protected:
  HostOnADiskThatHangs() { config_.core.recorder_age_max_s = 30.0; }
};

TEST_F(HostTest, OfManyStartsAtOnceOneWinsAndGoesOn) {
  const auto body = nlohmann::json{{"protocol", kLongProtocol}}.dump();
  for (const int clients : {2, 4}) {
    std::vector<Answer> answers(static_cast<std::size_t>(clients));
    // Two over the socket, the others as threads of the process would.
    at_once(clients, [&](int i) {
      auto& mine = answers[static_cast<std::size_t>(i)];
      if (i < 2) {
        mine = post("/v1/start", body);
      } else {
        const auto result = host_->start(protocol());
        mine = {result.ok ? 200 : 409, {{"text", result.text}, {"run", result.run}}};
      }
    });
    std::string winner;
    for (const auto& a : answers) {
      if (a.status == 200) {
        EXPECT_EQ(winner, "");
        winner = a.body.value("run", "");
      } else {
        EXPECT_EQ(a.status, 409);
        EXPECT_THAT(a.body.value("text", ""), HasSubstr("a run is under way"));
      }
    }
    ASSERT_NE(winner, "");
    EXPECT_EQ(state(), RunState::kRunning);
    EXPECT_EQ(host_->run_id(), winner);
    const Catalogue catalogue(runs_, Catalogue::Access::kReadOnly);
    EXPECT_EQ(catalogue.find_run("latest")->id, winner);
    EXPECT_EQ(catalogue.find_run("latest")->state, "running");
    EXPECT_EQ(post("/v1/abort", {}, true).status, 200);
    ASSERT_TRUE(wait_until(60.0, [&] { return !host_->run_open(); }));
    EXPECT_EQ(host_->last_outcome(), "aborted");
    ASSERT_TRUE(reach(RunState::kReady));
  }
}

TEST_F(HostTest, IsReadyOnlyWhereARunCouldBeRecorded) {
  disk_is_nearly_full_ = true;
  ASSERT_TRUE(reach(RunState::kIdle));
  EXPECT_STREQ(rig_->core().status().not_ready, "no run could be recorded: 0 MiB free, 1 MiB are kept free");
  const auto refused = host_->start(protocol());
  EXPECT_FALSE(refused.ok);
  EXPECT_THAT(refused.text, HasSubstr("0 MiB free"));
  EXPECT_EQ(rig_->core().status().fault_count, 0U) << "nothing is wrong with the rig";
  disk_is_nearly_full_ = false;
  ASSERT_TRUE(reach(RunState::kReady));
  EXPECT_TRUE(host_->start(protocol()).ok);
}

/// Nobody who looks after the rig waits for such a disk: events are told, commands answered, the recorder has its
/// turns.
TEST_F(HostOnADiskThatHangs, IsIdleAndSaysSo) {
  disk_hangs_ = true;
  // A minute of the rig's time, and some of a sanitizer's.
  constexpr double kPatience_s = 200.0;
  ASSERT_TRUE(wait_until(kPatience_s, [&] { return state() == RunState::kIdle; }));
  EXPECT_STREQ(rig_->core().status().not_ready, "no run could be recorded: the disk has not answered for 30 s");
  const auto since_ns = rig_->core().status().control.mono_ns;
  const auto events = host_->events_json(0)["events"].size();
  EXPECT_EQ(post("/v1/abort", {}, true).status, 200);
  EXPECT_TRUE(wait_until(60.0, [&] { return host_->events_json(0)["events"].size() > events; }));
  ASSERT_TRUE(
      wait_until(kPatience_s, [&] { return rig_->core().status().control.mono_ns - since_ns > 40'000'000'000; }));
  EXPECT_EQ(rig_->core().status().fault_count, 0U) << "a recorder without turns is a program stop";
  EXPECT_STREQ(rig_->core().status().not_ready, "no run could be recorded: the disk has not answered for 30 s");
  disk_hangs_ = false;
  ASSERT_TRUE(reach(RunState::kReady));
  EXPECT_TRUE(host_->start(protocol()).ok);
}

TEST_F(HostTest, EveryVerbByManyAtOnce) {
  const auto start = nlohmann::json{{"protocol", kLongProtocol}}.dump();
  for (const int clients : {2, 4}) {
    for (const auto* path : {"/v1/start", "/v1/pause", "/v1/seal", "/v1/resume", "/v1/reset", "/v1/abort"}) {
      std::atomic<int> accepted{0}, answered{0};
      at_once(clients, [&](int i) {
        const std::string body = std::string(path) == "/v1/start" ? start : "";
        const bool stops = i % 2 == 1 && (std::string(path) == "/v1/pause" || std::string(path) == "/v1/abort");
        const auto got = post(path, body, stops);
        EXPECT_THAT(got.status, AnyOf(200, 400, 409)) << path;
        answered += got.body.contains("text") ? 1 : 0;
        accepted += got.status == 200 ? 1 : 0;
        (void)host_->status_json();
        (void)host_->events_json(0);
        (void)host_->readings_json(1.0);
      });
      EXPECT_EQ(answered, clients) << path;
      // Sealing twice is sealing; an abort vents whatever the state.
      EXPECT_LE(accepted, std::string(path) == "/v1/seal" || std::string(path) == "/v1/abort" ? clients : 1) << path;
    }
    ASSERT_TRUE(wait_until(60.0, [&] { return !host_->run_open() && state() == RunState::kReady; }));
  }
}

/// "ready" comes before the recorder's next turn: what it still writes is the finished run.
TEST_F(HostTest, AStartRightAfterReadyLeavesTheFinishedRunItsRecorder) {
  const auto first = host_->start(protocol(kShort));
  ASSERT_TRUE(first.ok) << first.text;
  // The recorder has no turn from here on, until the second start waits for it.
  ASSERT_TRUE(wait_until(60.0, [&] { return state() != RunState::kReady; }));
  recorder_waits_ = true;
  ASSERT_TRUE(wait_until(60.0, [&] { return state() == RunState::kReady && !rig_->core().status().run_loaded; }));
  Host::Result second;
  std::thread other([&] { second = host_->start(protocol()); });
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(host_->run_id(), first.run);
  recorder_waits_ = false;
  other.join();
  ASSERT_TRUE(second.ok) << second.text;
  EXPECT_NE(second.run, first.run);
  const Catalogue catalogue(runs_, Catalogue::Access::kReadOnly);
  const auto row = catalogue.find_run(first.run);
  ASSERT_TRUE(row);
  EXPECT_EQ(row->state, "done");
  EXPECT_EQ(row->sessions_done, row->sessions);
}

TEST_F(HostTest, ACatalogueThatIsLockedStopsTheProgramAndIsWrittenLater) {
  const auto started = host_->start(protocol());
  ASSERT_TRUE(started.ok) << started.text;
  ASSERT_TRUE(wait_until(60.0, [&] { return host_->recorder_status().session >= 0; }));
  sqlite3* other = nullptr;
  ASSERT_EQ(sqlite3_open((runs_ / "catalogue.sqlite").c_str(), &other), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(other, "BEGIN EXCLUSIVE", nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(other);
  const auto began = std::chrono::steady_clock::now();
  EXPECT_TRUE(host_->verb(Request::Verb::kAbort).ok);
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(1));  // nobody waits for the catalogue
  ASSERT_TRUE(reach(RunState::kReady));
  EXPECT_TRUE(host_->run_open());
  ASSERT_EQ(sqlite3_exec(other, "COMMIT", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(other);
  EXPECT_TRUE(wait_until(60.0, [&] { return !host_->run_open(); }));
  EXPECT_EQ(host_->last_outcome(), "aborted");
  const Catalogue catalogue(runs_, Catalogue::Access::kReadOnly);
  EXPECT_EQ(catalogue.find_run(started.run)->state, "aborted");
}

TEST_F(HostTest, ARunFolderThatIsTakenAwayIsAProgramStop) {
  const auto started = host_->start(protocol());
  ASSERT_TRUE(started.ok) << started.text;
  // At once, as by a pulled disk: remove_all() would meet the files that are made meanwhile.
  std::filesystem::rename(runs_ / started.run, runs_ / "taken-away");
  ASSERT_TRUE(reach(RunState::kFaulted));
  EXPECT_THAT(std::string(rig_->core().status().fault), HasSubstr("recorder: the recording cannot be continued"));
  EXPECT_TRUE(host_->verb(Request::Verb::kAbort).ok);
  EXPECT_TRUE(reach(RunState::kReady)) << to_text(rig_->core().state()) << ": " << rig_->core().status().not_ready
                                       << ", " << rig_->core().status().fault;
}

/// To its first session's beginning, then ended by an operator.
std::string HostTest::aborted_run() {
  auto o = protocol();
  o.operator_name = "Ada";
  const auto started = host_->start(o);
  EXPECT_TRUE(started.ok) << started.text;
  EXPECT_TRUE(wait_until(60.0, [&] { return host_->recorder_status().session >= 0; }));
  EXPECT_TRUE(host_->verb(Request::Verb::kAbort).ok);
  EXPECT_TRUE(wait_until(60.0, [&] { return !host_->run_open() && state() == RunState::kReady; }));
  return started.run;
}

TEST_F(HostTest, ARunGoesOnAsItBeganUnlessSomebodySaysOtherwise) {
  const auto id = aborted_run();
  StartOptions o;
  o.resume_run = "latest";
  const auto aborted = host_->start(o);
  EXPECT_FALSE(aborted.ok);
  EXPECT_THAT(aborted.text, HasSubstr("isorig resume " + id + " --aborted"));

  o.resume_aborted = true;
  config_.name = "another";
  EXPECT_THAT(host_->start(o).text, HasSubstr("was recorded on rig \"sim\", and this is \"another\""));
  o.on_another_rig = true;
  config_.specimen = source("config/specimens/ecoflex1.toml");
  EXPECT_THAT(host_->start(o).text, HasSubstr("is of specimen \"Control2\", and \"Ecoflex1\" is mounted"));
  // The one it was begun with, named: nothing is otherwise.
  auto named = o;
  named.specimen_text = load_specimen(source("config/specimens/control2.toml")).text;
  named.specimen_name = "control2.toml";
  EXPECT_EQ(host_->preview(named).value("changed", ""), "went on on rig \"another\", begun on \"sim\"");

  o.another_specimen = true;
  const auto went_on = host_->start(o);
  ASSERT_TRUE(went_on.ok) << went_on.text;
  EXPECT_EQ(went_on.run, id);
  const auto trace = read_amendments(runs_ / id);
  ASSERT_EQ(trace.size(), 1U);
  EXPECT_THAT(trace[0].text, HasSubstr("went on with specimen \"Ecoflex1\", begun with \"Control2\""));
}

/// It would end as done without what was in the segment.
TEST_F(HostTest, ARunWhoseFirstSegmentIsGoneDoesNotGoOn) {
  const auto id = aborted_run();
  StartOptions o;
  o.resume_run = id;
  o.resume_aborted = true;
  const auto first = runs_ / id / messages::segment_name(1), aside = runs_ / "aside";
  ASSERT_TRUE(host_->start(o).ok);  // a further attempt, whose segment shows that there was a first
  ASSERT_TRUE(wait_until(60.0, [&] { return host_->recorder_status().session >= 0; }));
  ASSERT_TRUE(host_->verb(Request::Verb::kAbort).ok);
  ASSERT_TRUE(wait_until(60.0, [&] { return !host_->run_open() && state() == RunState::kReady; }));
  std::filesystem::rename(first, aside);
  const auto refused = host_->start(o);
  EXPECT_FALSE(refused.ok);
  EXPECT_THAT(refused.text, HasSubstr("segment-0001.lcm is missing from "));
  std::filesystem::rename(aside, first);
  EXPECT_TRUE(host_->start(o).ok);
}

TEST_F(HostTest, APartingIsToldOfTheOpenRunAlone) {
  const auto body = [](const std::string& run, const std::string& then) {
    return nlohmann::json{{"run", run}, {"text", "the twin is off by 3 N"}, {"then", then}}.dump();
  };
  EXPECT_EQ(post("/v1/parted", body("20261123-none", "mark")).status, 409);
  EXPECT_EQ(host_->longest_s(), 0.0);
  const auto started = host_->start(protocol());
  ASSERT_TRUE(started.ok) << started.text;
  EXPECT_EQ(host_->longest_s(), 1020.0) << "20 s to fill at most, 1000 s of hold";
  EXPECT_EQ(post("/v1/parted", body(started.run, "pause")).status, 200);
  EXPECT_EQ(post("/v1/parted", body("20261123-none", "pause")).status, 409);
  EXPECT_EQ(post("/v1/parted", body(started.run, "explode")).status, 400);
  EXPECT_EQ(post("/v1/parted", R"({"run":")" + started.run + R"("})").status, 400) << "without words";
  EXPECT_EQ(parted(), std::vector<std::string>{started.run + " pause: the twin is off by 3 N"});
  EXPECT_NE(state(), RunState::kPaused) << "to pause is the client's next call";
}

TEST_F(HostTest, APreviewStartsNothing) {
  auto o = protocol();
  o.operator_name = "Ada";
  const auto seen = host_->preview(o);
  EXPECT_EQ(seen.value("specimen", ""), "Control2");
  EXPECT_EQ(seen.value("operator", ""), "Ada");
  EXPECT_GE(seen.value("worst_s", 0.0), seen.value("nominal_s", 1e9));
  EXPECT_FALSE(host_->run_open());
  EXPECT_TRUE(Catalogue(runs_, Catalogue::Access::kReadOnly).runs().empty());
}

TEST_F(HostTest, ACorrectionLeavesTheRecordingAndATrace) {
  const auto id = aborted_run();
  Correction c;
  c.run = id;
  EXPECT_THROW((void)host_->amend(c), std::runtime_error);
  c.by = "Grace";
  c.operator_name = "Edsger";
  c.specimen_text = load_specimen(source("config/specimens/ecoflex1.toml")).text;
  c.text = "the label was read upside down";
  const auto noted = host_->amend(c);
  ASSERT_TRUE(noted.ok);
  EXPECT_THAT(noted.text, HasSubstr("specimen Ecoflex1 (was Control2)"));
  const auto row = Catalogue(runs_, Catalogue::Access::kReadOnly).find_run(id);
  EXPECT_EQ(row->specimen, "Ecoflex1");
  EXPECT_EQ(row->operator_name, "Edsger");
  const auto trace = read_amendments(row->directory);
  ASSERT_EQ(trace.size(), 1U);
  EXPECT_EQ(trace[0].by, "Grace");
  EXPECT_EQ(trace[0].text, c.text);
  const auto header = messages::read_header(row->directory / messages::segment_name(1));
  ASSERT_TRUE(header);
  EXPECT_EQ(header->specimen, "Control2");
}

/// The run is closed by then; its evidence is not.
TEST_F(HostTest, TheResetOfAFaultThatEndedARunIsKeptWithItsEvidence) {
  ASSERT_TRUE(host_->start(protocol()).ok);
  ASSERT_TRUE(reach(RunState::kRunning));
  rig_->rig().interlock().estop_closed = false;
  ASSERT_TRUE(reach(RunState::kFaulted));
  ASSERT_TRUE(wait_until(60.0, [&] { return !host_->run_open(); }));
  EXPECT_EQ(host_->last_outcome(), "failed");
  const auto file = host_->run_directory() / "trip-1.json";
  const auto resets = [&] {
    int count = 0;
    const auto now = nlohmann::json::parse(testing::file_text(file));
    for (const auto& e : now.at("events")) count += e.at("code") == "reset";
    return count;
  };
  const auto trip = nlohmann::json::parse(testing::file_text(file));
  EXPECT_EQ(trip.at("code"), "interlock.estop");
  EXPECT_THAT(trip.at("step_words").get<std::string>(), AnyOf(HasSubstr("pressurize"), HasSubstr("hold")));
  EXPECT_EQ(resets(), 0);
  rig_->rig().interlock().estop_closed = true;
  ASSERT_TRUE(wait_until(60.0, [&] { return post("/v1/reset").status == 200; }));
  EXPECT_TRUE(wait_until(60.0, [&] { return resets() == 1; }));
  ASSERT_TRUE(reach(RunState::kReady));
}

TEST_F(HostTest, ARecordingSaysWhatItWasMadeWith) {
  const auto id = aborted_run();
  const auto header = messages::read_header(runs_ / id / messages::segment_name(1));
  ASSERT_TRUE(header);
  std::map<std::string, std::string> versions;
  for (const auto& v : header->versions) versions[v.name] = v.text;
  EXPECT_EQ(versions["git"], "0123456789ab");
  EXPECT_EQ(versions["operator"], "Ada");
  EXPECT_THAT(versions["kernel"], HasSubstr("Linux"));
  EXPECT_FALSE(versions["lcm"].empty());
  EXPECT_FALSE(versions["frame"].empty());
  EXPECT_FALSE(versions["pressure"].empty());
}

/// The loop alone: what it sees of its recorder is when that last came round.
class RecorderPaceTest : public RigFixture {};

TEST_F(RecorderPaceTest, ARecorderThatStandsStillIsAProgramStop) {
  start(kHold);
  for (int i = 0; i < 300; ++i) {
    virtual_rig->core().recorder_turn(virtual_rig->now_ns());
    run_for(0.02);
  }
  ASSERT_EQ(virtual_rig->core().state(), RunState::kRunning);
  const auto stopped_ns = virtual_rig->now_ns();
  ASSERT_TRUE(reach(RunState::kFaulted, config.core.recorder_age_max_s + 1.0));
  ASSERT_NE(event("recorder.stalled"), nullptr);
  EXPECT_NEAR(static_cast<double>(virtual_rig->now_ns() - stopped_ns) * 1e-9, config.core.recorder_age_max_s, 0.05);
  EXPECT_FALSE(ask(Request::Verb::kReset).accepted);
  for (int i = 0; i < 25; ++i) {  // and the crosshead has to be seen to stand
    virtual_rig->core().recorder_turn(virtual_rig->now_ns());
    run_for(0.02);
  }
  const auto reset = ask(Request::Verb::kReset);
  EXPECT_TRUE(reset.accepted) << reset.text;
}

TEST_F(RecorderPaceTest, AQueueThatIsHalfFullIsAProgramStopBeforeAnythingIsLost) {
  start(kHold);
  run_for(1.0);
  const auto until = virtual_rig->now_ns() + 60'000'000'000;
  while (virtual_rig->core().state() == RunState::kRunning && virtual_rig->now_ns() < until) {
    virtual_rig->core().recorder_turn(virtual_rig->now_ns());  // it comes round, and takes nothing
    virtual_rig->tick();
  }
  EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  run_for(1.0);
  EXPECT_THAT(std::string(virtual_rig->core().status().fault), HasSubstr("recorder.stalled"));
  EXPECT_EQ(event("lost.record"), nullptr);
}

TEST_F(RecorderPaceTest, AQueueThatOverflowsIsAProgramStop) {
  start(kHold);
  run_for(1.0);
  const auto until = virtual_rig->now_ns() + 60'000'000'000;
  while (virtual_rig->core().state() == RunState::kRunning && virtual_rig->now_ns() < until)
    virtual_rig->tick();  // nobody drains
  EXPECT_EQ(virtual_rig->core().state(), RunState::kFaulted);
  run_for(3.0);
  EXPECT_THAT(std::string(virtual_rig->core().status().fault), HasSubstr("recorder.overflow"));
  EXPECT_LE(std::count_if(events.begin(), events.end(),
                          [](const auto& e) { return std::strcmp(e.code, "lost.record") == 0; }),
            4);
}

}  // namespace
}  // namespace isorig::daemon::test
