#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <vector>

#include "daemon/recording/catalogue.hpp"
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
      if (entry.is_directory() && name != "accepted" && name != "calibration") ++count;
    }
    return count;
  }
};

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

}  // namespace
}  // namespace isorig::daemon::test
