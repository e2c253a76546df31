#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <vector>

#include "cli/rig/acts.hpp"
#include "cli/rig/client.hpp"
#include "cli/rig/watch.hpp"
#include "cli/screen/exit_codes.hpp"
#include "daemon/recording/catalogue.hpp"
#include "protocol/compile.hpp"
#include "served_rig.hpp"

/// Two acts, setup, jog and the sign-off over the real socket, on a rig that ticks in a thread of its own.
namespace isorig::daemon::test {
namespace {

using ::testing::HasSubstr;

class OperatorApiTest : public ServedRig {
 protected:
  OperatorApiTest() : ServedRig("operator") { config_.core.operating.arming_required = true; }
  void TearDown() override { stop_serving(); }

  [[nodiscard]] Answer post(const std::string& path, const nlohmann::json& body = nlohmann::json::object()) const {
    return call("POST " + path, body.dump());
  }
  [[nodiscard]] nlohmann::json status() const { return call("GET /v1/status").body; }
  [[nodiscard]] bool reach(const std::string& wanted) const {
    return wait_until(60.0, [&] { return status().value("state", "") == wanted; });
  }
  [[nodiscard]] nlohmann::json event(const std::string& code) const {
    const auto all = call("GET /v1/events").body;
    for (const auto& e : all["events"]) {
      if (e.value("code", "") == code) return e;
    }
    return {};
  }
  [[nodiscard]] std::vector<RunRow> runs() const { return Catalogue(runs_, Catalogue::Access::kReadOnly).runs(); }
  /// Folders of runs.
  [[nodiscard]] int folders() const {
    int count = 0;
    for (const auto& entry : std::filesystem::directory_iterator(runs_)) {
      const auto name = entry.path().filename().string();
      if (entry.is_directory() && name != "accepted" && name != "audit" && name != "calibration") ++count;
    }
    return count;
  }
};

/// By the credentials of their sockets; the story of `isorig show` reads it from there.
TEST_F(OperatorApiTest, TheTripsStoryNamesWhoResetAndWhoWentOn) {
  config_.core.operating.arming_required = false;
  serve();
  const auto started = post("/v1/start", {{"protocol", kLongProtocol}});
  ASSERT_EQ(started.status, 200) << started.body;
  ASSERT_TRUE(reach("running"));
  rig_->core().set_recorder_fault("the disk takes nothing");
  ASSERT_TRUE(reach("faulted"));
  rig_->core().set_recorder_fault("");
  ASSERT_TRUE(wait_until(10.0, [&] { return post("/v1/reset").status == 200; }));
  ASSERT_TRUE(wait_until(10.0, [&] { return post("/v1/resume").status == 200; }));
  const auto file = runs_ / started.body.value("run", "") / "trip-1.json";
  const auto event_of = [&](const char* code) -> nlohmann::json {
    if (!std::filesystem::exists(file)) return {};
    const auto trip = nlohmann::json::parse(daemon::testing::file_text(file), nullptr, false);
    if (!trip.is_object()) return {};
    for (const auto& e : trip["events"])
      if (e["code"] == code) return e;
    return {};
  };
  ASSERT_TRUE(wait_until(60.0, [&] { return event_of("resume").is_object(); }));
  const auto number = "uid " + std::to_string(::getuid());
  const auto name = user_name(::getuid());
  const auto me = name == number ? number : name + " (" + number + ")";
  EXPECT_EQ(event_of("reset").value("by", ""), me);
  EXPECT_EQ(event_of("resume").value("by", ""), me);
  EXPECT_FALSE(event_of("recorder").contains("by")) << "nobody asked for it";
  EXPECT_THAT(event("reset")["text"].get<std::string>(), ::testing::EndsWith(", by " + me))
      << "the recording has it, too";
}

TEST_F(OperatorApiTest, NothingIsWrittenBeforeTheSecondAct) {
  config_.core.operating.arm_window_s = 2.0;
  serve();
  const auto armed = post("/v1/start", {{"protocol", kLongProtocol}});
  ASSERT_EQ(armed.status, 200) << armed.body;
  EXPECT_THAT(armed.text(), HasSubstr("isorig go within 2 s"));
  EXPECT_EQ(armed.body.value("run", "x"), "");
  EXPECT_EQ(status()["arming"], "required");
  EXPECT_EQ(folders(), 0);
  ASSERT_TRUE(reach("ready"));
  const auto late = post("/v1/go");
  EXPECT_EQ(late.status, 409);
  EXPECT_THAT(late.text(), HasSubstr("armed first"));
  EXPECT_EQ(folders(), 0);
  EXPECT_TRUE(runs().empty());
  ASSERT_TRUE(wait_until(10.0, [&] { return !event("disarmed").is_null(); }));
  EXPECT_EQ(event("disarmed")["text"], "nobody gave the second act (isorig go) in time");
  // A wrong protocol is refused by the first act.
  EXPECT_EQ(post("/v1/start", {{"protocol", "x"}}).status, 400);
  EXPECT_EQ(status()["state"], "ready");
}

TEST_F(OperatorApiTest, TwoActsACountdownAndARun) {
  config_.core.operating.arm_window_s = 60.0;
  serve();
  ASSERT_EQ(post("/v1/start", {{"protocol", kLongProtocol}, {"operator", "somebody"}}).status, 200);
  EXPECT_EQ(post("/v1/start", {{"protocol", kLongProtocol}}).status, 409);
  const auto went = post("/v1/go");
  ASSERT_EQ(went.status, 200) << went.body;
  EXPECT_THAT(went.text(), HasSubstr("keep clear"));
  EXPECT_FALSE(went.body.value("run", "").empty());
  EXPECT_EQ(status()["state"], "countdown");
  EXPECT_GT(status()["operator_left_s"].get<double>(), 0.0);
  ASSERT_TRUE(reach("running"));
  ASSERT_EQ(post("/v1/abort").status, 200);
  ASSERT_TRUE(reach("ready"));
  ASSERT_TRUE(wait_until(10.0, [&] { return !host_->run_open(); }));
  ASSERT_EQ(runs().size(), 1U);
  EXPECT_EQ(runs()[0].state, "aborted");
  EXPECT_EQ(runs()[0].operator_name, "somebody");
}

/// A refusal names the act that comes first in this state.
TEST_F(OperatorApiTest, WhatIsRefusedSaysWhatComesFirst) {
  config_.core.operating.arm_window_s = 60.0;
  serve();
  ASSERT_EQ(post("/v1/start", {{"protocol", kLongProtocol}}).status, 200);
  ASSERT_EQ(post("/v1/go").status, 200);
  ASSERT_TRUE(reach("running"));
  ASSERT_EQ(post("/v1/pause").status, 200);
  ASSERT_TRUE(reach("paused"));
  const auto paused = post("/v1/go");
  EXPECT_EQ(paused.status, 409);
  EXPECT_THAT(paused.text(), HasSubstr("the rig is paused: what goes on has to be armed first (isorig resume)"));
  rig_->core().set_recorder_fault("the disk takes nothing");
  ASSERT_TRUE(reach("faulted"));
  const auto faulted = post("/v1/go");
  EXPECT_EQ(faulted.status, 409);
  EXPECT_THAT(faulted.text(), HasSubstr("the rig is faulted: see to the cause, then isorig reset"));
  const auto another = post("/v1/start", {{"protocol", kLongProtocol}});
  EXPECT_EQ(another.status, 409);
  EXPECT_THAT(another.text(), HasSubstr("the rig is faulted"));
  // A script that waits for this run is told that it is stopped, and does not wait for somebody's resume.
  ::testing::internal::CaptureStderr();
  EXPECT_EQ(cli::watch(cli::Client(socket_), {.interval_s = 0.05, .until_done = true, .json = true, .run = {}}),
            cli::kTripped);
  EXPECT_THAT(::testing::internal::GetCapturedStderr(), HasSubstr("is stopped: isorig status says by what"));
}

/// Who has not confirmed is told that the rig is not armed any more when it has been seen so, and not before.
TEST_F(OperatorApiTest, AStartThatNobodyConfirmedIsTakenBackOrSaidToBeArmed) {
  config_.core.operating.arm_window_s = 3600.0;
  serve();
  const int terminal = ::dup(STDIN_FILENO), nobody = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
  ::dup2(nobody, STDIN_FILENO);
  const cli::Client client(socket_);
  ASSERT_EQ(post("/v1/start", {{"protocol", kLongProtocol}}).status, 200);
  auto answer = cli::second_act(client);
  ASSERT_TRUE(answer);
  EXPECT_FALSE(answer->ok());
  EXPECT_THAT(answer->text(), ::testing::Not(HasSubstr("it is armed")));
  ASSERT_TRUE(reach("ready"));

  ASSERT_EQ(post("/v1/start", {{"protocol", kLongProtocol}}).status, 200);
  loop_waits_ = true;
  answer = cli::second_act(client);
  ASSERT_TRUE(answer);
  EXPECT_FALSE(answer->ok());
  EXPECT_THAT(answer->text(), ::testing::AllOf(HasSubstr("it is armed"), HasSubstr("did not answer within 2 s")));
  loop_waits_ = false;
  ASSERT_TRUE(reach("ready")) << "what stops is done when the loop comes round";
  ::dup2(terminal, STDIN_FILENO);
  ::close(terminal);
  ::close(nobody);
}

TEST_F(OperatorApiTest, ACountdownThatIsTakenBackIsNoRunAndARunThatWasStaysResumable) {
  config_.core.operating.arm_window_s = 60.0;
  config_.core.operating.countdown_s = 3.0;
  serve();
  ASSERT_EQ(post("/v1/start", {{"protocol", kLongProtocol}}).status, 200);
  ASSERT_EQ(post("/v1/go").status, 200);
  ASSERT_EQ(post("/v1/pause").status, 200);
  ASSERT_TRUE(wait_until(20.0, [&] { return !host_->run_open(); }));
  EXPECT_EQ(runs()[0].state, "not started");
  ASSERT_TRUE(reach("ready"));

  ASSERT_EQ(post("/v1/start", {{"protocol", kLongProtocol}}).status, 200);
  ASSERT_EQ(post("/v1/go").status, 200);
  ASSERT_TRUE(reach("running"));
  ASSERT_EQ(post("/v1/abort").status, 200);
  ASSERT_TRUE(wait_until(20.0, [&] { return !host_->run_open(); }));
  const auto id = host_->run_id();
  ASSERT_TRUE(reach("ready"));
  ASSERT_EQ(post("/v1/start", {{"resume_run", id}, {"resume_aborted", true}}).status, 200);
  EXPECT_EQ(status()["state"], "armed");
  ASSERT_EQ(post("/v1/go").status, 200);
  ASSERT_EQ(post("/v1/abort").status, 200);
  ASSERT_TRUE(wait_until(20.0, [&] { return !host_->run_open(); }));
  EXPECT_EQ(Catalogue(runs_, Catalogue::Access::kReadOnly).find_run(id)->state, "interrupted");
}

TEST_F(OperatorApiTest, SetupAndJogAreCalls) {
  serve();
  EXPECT_EQ(post("/v1/jog", {{"to_mm", 1.0}}).status, 409);
  ASSERT_EQ(post("/v1/setup").status, 200);
  EXPECT_EQ(status()["state"], "setup");
  EXPECT_EQ(post("/v1/jog").status, 400);
  EXPECT_EQ(post("/v1/jog", {{"to_mm", 1.0}, {"by_mm", 1.0}}).status, 400);
  EXPECT_EQ(post("/v1/jog", {{"to_mm", "far"}}).status, 400);
  for (const double none : {0.0, -1.0})  // 0 is not "as fast as may be", which is said by no velocity at all
    EXPECT_THAT(post("/v1/jog", {{"to_mm", 1.0}, {"velocity_mm_s", none}}).text(), HasSubstr("has to be above 0"));
  EXPECT_THAT(post("/v1/jog", {{"to", 1.0}}).text(), HasSubstr("unknown key `to`"));
  ASSERT_TRUE(wait_until(10.0, [&] { return post("/v1/jog", {{"by_mm", 0.5}}).status == 200; }));
  ASSERT_TRUE(wait_until(20.0, [&] { return !event("jog.done").is_null(); }));
  EXPECT_NEAR(status()["position_mm"].get<double>(), 0.5, 0.05);
  ASSERT_EQ(post("/v1/setup", {{"off", true}}).status, 200);
  EXPECT_TRUE(reach("ready"));
}

TEST_F(OperatorApiTest, AChangedRigFileIsNamedKeyByKeyAndSignedOff) {
  config_.core.operating.arming_required = false;
  serve();
  EXPECT_EQ(status()["rig_file"]["accepted_by"], "");
  EXPECT_EQ(post("/v1/accept-rig").status, 400);
  EXPECT_EQ(post("/v1/accept-rig", {{"operator", "a\nb"}}).status, 400);
  ASSERT_EQ(post("/v1/accept-rig", {{"operator", "Somebody"}}).status, 200);
  EXPECT_EQ(status()["rig_file"]["accepted"], true);
  EXPECT_EQ(status()["rig_file"]["accepted_uid"], ::getuid());
  stop_serving();

  const auto at = config_.text.find("force_max_N = 120");
  ASSERT_NE(at, std::string::npos);
  config_.text.replace(at, 17, "force_max_N = 150.0  # more");
  config_.core.operating.sign_off_required = true;
  serve();
  const auto file = status()["rig_file"];
  EXPECT_EQ(file["accepted"], false);
  EXPECT_EQ(file["accepted_by"], "Somebody");
  EXPECT_EQ(file["changes"], nlohmann::json::parse(R"([{"key":"limits.force_max_N","before":"120","now":"150"}])"));
  const auto refused = post("/v1/start", {{"protocol", kLongProtocol}});
  EXPECT_EQ(refused.status, 409);
  EXPECT_THAT(refused.text(), HasSubstr("limits.force_max_N: 120 -> 150"));
  EXPECT_EQ(folders(), 0);
  stop_serving();

  config_.core.operating.sign_off_required = false;  // warns, and tells the recording
  serve();
  const auto warned = post("/v1/start", {{"protocol", kLongProtocol}});
  EXPECT_EQ(warned.status, 200);
  EXPECT_THAT(warned.text(), HasSubstr("limits.force_max_N: 120 -> 150"));
  ASSERT_TRUE(wait_until(10.0, [&] { return !event("rig.changed").is_null(); }));
  EXPECT_EQ(event("rig.changed")["text"], "limits.force_max_N: 120 -> 150");
  ASSERT_EQ(post("/v1/accept-rig", {{"operator", "Another"}}).status, 200);
  EXPECT_TRUE(status()["rig_file"]["changes"].empty());
}

TEST_F(OperatorApiTest, ThePlanHasEveryStepWithItsTimes) {
  config_.core.operating.arming_required = false;
  serve();
  const auto none = call("GET /v1/plan");
  ASSERT_EQ(none.status, 200);
  EXPECT_TRUE(none.body["run"].is_null());
  EXPECT_EQ(none.body["limits"]["force_max_N"], config_.limits.force_max_N);
  ASSERT_EQ(call("POST /v1/start", nlohmann::json{{"protocol", kLongProtocol}}.dump()).status, 200);
  const auto plan = call("GET /v1/plan").body;
  EXPECT_EQ(plan["run"], host_->run_id());
  ASSERT_EQ(plan["steps"].size(), 2U);
  EXPECT_EQ(plan["steps"][1]["do"], "hold");
  EXPECT_EQ(plan["steps"][1]["nominal_s"], 1000.0);
  EXPECT_GT(plan["worst_s"], plan["nominal_s"]);  // the pressurize may run into its time-out
}

TEST_F(OperatorApiTest, ACheckSaysWhatIsWrongAndWhereOrWhatWouldBeDone) {
  serve();
  const auto checked = post("/v1/check", {{"protocol", kLongProtocol}, {"protocol_name", "mine.toml"}});
  ASSERT_EQ(checked.status, 200) << checked.body;
  EXPECT_EQ(checked.text(), "mine.toml is well: test");
  const auto& steps = checked.body["steps"];
  EXPECT_EQ(steps["do"], nlohmann::json::parse(R"(["pressurize","hold"])"));
  EXPECT_EQ(steps["nominal_s"][1], 1000.0);
  EXPECT_GT(steps["worst_s"][0], steps["nominal_s"][0]);
  EXPECT_EQ(steps["line"], nlohmann::json::parse("[4,5]"));
  EXPECT_EQ(steps["text"].size(), 2U);
  EXPECT_GT(checked.body["worst_s"], checked.body["nominal_s"]);

  // As `isorig check` says it: every error with its place, in the words of the compiler within this rig's limits.
  std::string wrong = kLongProtocol;
  wrong.replace(wrong.find("1000"), 4, "\"long\"");
  wrong.replace(wrong.find("pressure_psi = 0"), 16, "pressure_psi = 900");
  const auto refused = post("/v1/check", {{"protocol", wrong}, {"protocol_name", "mine.toml"}});
  ASSERT_EQ(refused.status, 400);
  // the limit, the time-out that is too short for it, a word that is no number
  ASSERT_EQ(refused.body["diagnostics"].size(), 3U) << refused.body;
  std::string compiled;
  try {
    (void)protocol::compile(base::TomlDocument::parse_text(wrong, "mine.toml"), config_.limits);
  } catch (const base::ConfigError& e) {
    compiled = e.what();
  }
  EXPECT_EQ(refused.text(), compiled);
  for (const auto& d : refused.body["diagnostics"]) {
    EXPECT_EQ(d["file"], "mine.toml");
    EXPECT_GE(d["line"], 4);
    EXPECT_THAT(compiled, HasSubstr(d["text"].get<std::string>()));
    EXPECT_THAT(d["text"].get<std::string>(), HasSubstr(d["message"].get<std::string>()));
  }
  EXPECT_EQ(folders(), 0);
  EXPECT_EQ(post("/v1/check", {{"protocol_name", "x"}}).status, 400);
}

TEST_F(OperatorApiTest, DiagnosesAmongTheRunsAreListedAndGivenOut) {
  serve();
  std::filesystem::create_directories(runs_ / "one" / "diagnosis");
  std::ofstream(runs_ / "one" / "diagnosis" / "diagnosis.json")
      << R"({"format":"isorig-diagnosis/1","verdict":"consistent","missing":[]})";
  std::ofstream(runs_ / "one" / "diagnosis" / "diagnosis-report.html") << "<p>argues</p>";
  const auto list = call("GET /v1/diagnoses");
  ASSERT_EQ(list.status, 200) << list.body;
  ASSERT_EQ(list.body["diagnoses"].size(), 1U);
  const auto& one = list.body["diagnoses"][0];
  EXPECT_EQ(one["folder"], "one/diagnosis");
  EXPECT_EQ(call("GET /v1/page?path=" + one["pages"][0]["path"].get<std::string>()).body["page"], "<p>argues</p>");
  EXPECT_EQ(call("GET /v1/experiment?id=" + one["id"].get<std::string>()).status, 404);
  EXPECT_EQ(call("GET /v1/page?path=" + (runs_ / "two/diagnosis-report.html").string()).status, 404);
  EXPECT_EQ(call("GET /v1/experiment?id=0123456789abcdef").status, 404);
  EXPECT_EQ(call("GET /v1/report?run=20261127-none").status, 404);
  EXPECT_EQ(call("GET /v1/page").status, 400);
  EXPECT_EQ(call("GET /v1/page?id=x").status, 400);
}

TEST_F(OperatorApiTest, WhatWasDroppedBeforeARunIsNotTheRunsLoss) {
  config_.core.operating.arming_required = false;
  serve();
  ASSERT_EQ(post("/v1/start", {{"protocol", kLongProtocol}}).status, 200);
  ASSERT_TRUE(wait_until(60.0, [&] { return status()["state"] == "running"; }));
  // Nobody takes the records of the run, which is held and goes on being recorded: a queue is full after 16 s.
  recorder_waits_ = true;
  ASSERT_TRUE(wait_until(60.0, [&] { return status().value("records_dropped", 0) > 0; }));
  recorder_waits_ = false;
  ASSERT_EQ(post("/v1/abort").status, 200);
  ASSERT_TRUE(wait_until(60.0, [&] { return status().contains("last_run"); }));
  EXPECT_GT(status()["last_run"]["dropped_records"], 0);

  ASSERT_TRUE(reach("ready"));
  ASSERT_EQ(post("/v1/start", {{"protocol", kLongProtocol}}).status, 200);
  ASSERT_EQ(post("/v1/abort").status, 200);
  ASSERT_TRUE(wait_until(60.0, [&] { return status()["last_run"]["outcome"] == "aborted"; }));
  EXPECT_EQ(status()["last_run"]["dropped_records"], 0);
}

}  // namespace
}  // namespace isorig::daemon::test
