#include <gmock/gmock.h>
#include <grp.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "as_user.hpp"
#include "served_rig.hpp"

/// Roles, control and the audit log over the real socket, as users that the kernel vouches for.
namespace isorig::daemon::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr uid_t kAnn = 21'001, kBob = 21'002, kCleo = 21'003;

class ApiAccessTest : public ServedRig {
 protected:
  ApiAccessTest() : ServedRig("access") { config_.core.operating.arming_required = false; }
  void TearDown() override { stop_serving(); }

  void serve_to_all() {
    if (::geteuid() != 0) GTEST_SKIP() << kNeedsRoot;
    std::filesystem::permissions(folder_.path(), std::filesystem::perms(0755));
    socket_mode_ = 0666;  // the groups are what is tested, not the file's mode
    serve();
  }
  static gid_t group(const char* name) {
    const auto* entry = ::getgrnam(name);
    return entry == nullptr ? static_cast<gid_t>(-1) : entry->gr_gid;
  }
  [[nodiscard]] Answer as(uid_t uid, const std::vector<gid_t>& groups, const std::string& line,
                          const nlohmann::json& body = nlohmann::json::object(), bool stops = false) const {
    Answer answer;
    as_user(uid, uid, groups, [&] { answer = call(line, body.dump(), stops); });
    return answer;
  }
  [[nodiscard]] Answer page(const nlohmann::json& who, const std::string& line,
                            const nlohmann::json& body = nlohmann::json::object()) const {
    return call(line, body.dump(), false, "Isorig-For: " + who.dump() + "\r\n");
  }
  [[nodiscard]] nlohmann::json control() const { return call("GET /v1/status").body["control"]; }
  [[nodiscard]] std::vector<nlohmann::json> audit(std::size_t lines) const {
    std::vector<nlohmann::json> all;
    EXPECT_TRUE(wait_until(10.0, [&] {
      try {
        all = read_audit(runs_, 1000);
      } catch (const std::runtime_error&) {  // the first line is not there yet
      }
      return all.size() >= lines;
    }));
    return all;
  }
};

TEST_F(ApiAccessTest, AGroupMaySeeAnotherOperateAThirdConfigureAndAllMayStop) {
  roles_ = Roles({{"users"}, {"games"}, {"adm"}}, 0);
  serve_to_all();
  if (IsSkipped()) return;
  const std::vector<gid_t> nobody, sees{group("users")}, operates{group("games")}, configures{group("adm")};

  const auto blind = as(kAnn, nobody, "GET /v1/status");
  EXPECT_EQ(blind.status, 403);
  EXPECT_THAT(blind.text(), AllOf(HasSubstr("uid 21001 may not see this rig"), HasSubstr("usermod -aG users NAME")));
  EXPECT_EQ(as(kAnn, nobody, "GET /v1/status", nlohmann::json::object(), true).status, 403);
  EXPECT_EQ(as(kAnn, nobody, "POST /v1/abort").status, 200) << "who may open the socket may stop the rig";
  EXPECT_EQ(as(kAnn, nobody, "POST /v1/abort", nlohmann::json::object(), true).status, 200);
  ASSERT_TRUE(reach(RunState::kReady));

  for (const auto* look : {"GET /v1/status", "GET /v1/runs", "GET /v1/events", "GET /v1/plan", "GET /v1/selftest"})
    EXPECT_EQ(as(kAnn, sees, look).status, 200) << look;
  for (const auto* act : {"POST /v1/start", "POST /v1/resume", "POST /v1/reset", "POST /v1/go", "POST /v1/jog",
                          "POST /v1/setup", "POST /v1/seal", "POST /v1/confirm-zero", "POST /v1/notes",
                          "POST /v1/parted", "POST /v1/control", "POST /v1/calibrations", "POST /v1/accept-rig"}) {
    const auto refused = as(kAnn, sees, act);
    EXPECT_EQ(refused.status, 403) << act;
    EXPECT_THAT(refused.text(), HasSubstr("uid 21001 may not")) << act;
  }
  EXPECT_TRUE(control().is_null()) << "who was refused has control";

  const auto started = as(kBob, operates, "POST /v1/start", {{"protocol", kLongProtocol}});
  EXPECT_EQ(started.status, 200) << started.body;
  for (const auto* act : {"POST /v1/calibrations", "POST /v1/accept-rig"}) {
    const auto refused = as(kBob, operates, act);
    EXPECT_EQ(refused.status, 403) << act;
    EXPECT_THAT(refused.text(), HasSubstr("may not configure this rig; who may: members of the group adm")) << act;
  }
  EXPECT_EQ(as(kAnn, sees, "POST /v1/pause").status, 200);
  EXPECT_EQ(as(kAnn, sees, "POST /v1/resume").status, 403);
  EXPECT_EQ(as(kBob, operates, "POST /v1/resume").status, 200);
  // Who may configure may operate, when it is his turn; a wrong record is then what is wrong.
  EXPECT_EQ(as(kCleo, configures, "POST /v1/reset").status, 409);
  EXPECT_EQ(as(kCleo, configures, "POST /v1/control", {{"action", "take-over"}}).status, 200);
  EXPECT_EQ(as(kCleo, configures, "POST /v1/calibrations", {{"record", "x"}}).status, 400);
}

TEST_F(ApiAccessTest, OneOperatorHasControlWhateverHeOperatesFrom) {
  serve_to_all();
  if (IsSkipped()) return;
  EXPECT_TRUE(control().is_null());
  EXPECT_EQ(as(kAnn, {}, "POST /v1/start", {{"protocol", "nonsense"}}).status, 400);
  EXPECT_TRUE(control().is_null()) << "by a start that was refused";
  EXPECT_EQ(as(kAnn, {}, "POST /v1/start", {{"protocol", kLongProtocol}, {"dry_run", true}}).status, 200);
  EXPECT_TRUE(control().is_null()) << "by a look";
  ASSERT_EQ(as(kAnn, {}, "POST /v1/start", {{"protocol", kLongProtocol}}).status, 200);
  EXPECT_EQ(control()["uid"], kAnn);
  EXPECT_EQ(control()["text"], "uid 21001 at a terminal");
  ASSERT_TRUE(reach(RunState::kRunning));

  EXPECT_EQ(as(kBob, {}, "POST /v1/pause").status, 200) << "to stop is for everybody";
  const auto refused = as(kBob, {}, "POST /v1/resume");
  EXPECT_EQ(refused.status, 409);
  EXPECT_THAT(refused.text(), AllOf(HasSubstr("uid 21001 has control (at a terminal"), HasSubstr("--take-over")));
  EXPECT_EQ(state(), RunState::kPaused);

  // A page, for which another process speaks.
  const nlohmann::json bobs{{"uid", kBob}, {"name", "Bob"}, {"page", "b1"}};
  EXPECT_EQ(page(bobs, "POST /v1/resume").status, 409);
  EXPECT_EQ(page(bobs, "POST /v1/control", {{"action", "take"}}).status, 409);
  const auto over = page(bobs, "POST /v1/control", {{"action", "take-over"}});
  ASSERT_EQ(over.status, 200);
  EXPECT_EQ(over.body["taken_from"], "uid 21001");
  EXPECT_EQ(over.body["control"], control());
  EXPECT_EQ(over.body["term"], control()["term"]);
  EXPECT_EQ(control()["where"], "page");
  EXPECT_THAT(as(kAnn, {}, "POST /v1/resume").text(), HasSubstr("Bob has control (on the live page"));
  EXPECT_EQ(page(bobs, "POST /v1/resume").status, 200);
  ASSERT_TRUE(reach(RunState::kRunning));
  EXPECT_EQ(page(bobs, "POST /v1/control", {{"action", "keep"}}).status, 200);
  EXPECT_EQ(page(bobs, "POST /v1/control", {{"action", "give-back"}}).status, 200);
  EXPECT_TRUE(control().is_null());
  EXPECT_EQ(page(bobs, "POST /v1/resume").text(), "take control first");
  EXPECT_EQ(page(bobs, "POST /v1/control", {{"action", "seize"}}).status, 400);
}

TEST_F(ApiAccessTest, WhoForgesAPageOfTheHolderDoesNotGetControlOfIt) {
  serve_to_all();
  if (IsSkipped()) return;
  ASSERT_EQ(as(kAnn, {}, "POST /v1/start", {{"protocol", kLongProtocol}}).status, 200);
  const auto claim = [&](const char* action) {
    Answer answer;
    as_user(kCleo, kCleo, {}, [&] {
      answer = page({{"uid", kAnn}, {"name", "Ann"}, {"page", "a"}}, "POST /v1/control", {{"action", action}});
    });
    return answer;
  };
  EXPECT_EQ(claim("take").status, 409);
  EXPECT_EQ(control()["where"], "terminal");
  const auto over = claim("take-over");
  EXPECT_EQ(over.status, 200);
  EXPECT_EQ(over.body["taken_from"], "uid 21001");
  EXPECT_EQ(as(kAnn, {}, "POST /v1/resume").status, 409);
  // Root, who may speak for her: no taking over.
  ASSERT_EQ(as(kAnn, {}, "POST /v1/control", {{"action", "take-over"}}).status, 200);
  const auto own = page({{"uid", kAnn}, {"name", "Ann"}, {"page", "a"}}, "POST /v1/control", {{"action", "take"}});
  EXPECT_EQ(own.status, 200);
  EXPECT_EQ(own.body["taken_from"], "");
}

TEST_F(ApiAccessTest, WhoRepeatsWhatIsRefusedDoesNotFillTheLog) {
  roles_ = Roles({{"users"}, {}, {}}, 0);
  serve_to_all();
  if (IsSkipped()) return;
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(as(kAnn, {}, "GET /v1/status").status, 403);
    EXPECT_EQ(as(kAnn, {}, "GET /v1/made-up-" + std::to_string(i)).status, 403);
    EXPECT_EQ(as(kBob, {}, "GET /v1/status", nlohmann::json::object(), true).status, 403);
  }
  for (int i = 0; i < 20; ++i) EXPECT_EQ(as(kAnn, {}, "POST /v1/reset").status, 403);
  EXPECT_EQ(as(kAnn, {}, "POST /v1/abort").status, 200);
  const auto of = [](const std::vector<nlohmann::json>& lines, const std::string& verb) {
    return std::count_if(lines.begin(), lines.end(), [&](const auto& line) { return line["verb"] == verb; });
  };
  ASSERT_TRUE(wait_until(10.0, [&] { return of(audit(1), "abort") == 1; }));
  const auto lines = audit(5);
  EXPECT_EQ(of(lines, "GET status"), 2) << "of each user one";
  EXPECT_EQ(of(lines, "GET made-up-0"), 1);
  EXPECT_EQ(lines.size() - static_cast<std::size_t>(of(lines, "reset")), 4U);
  int resets = 0;
  for (const auto& line : lines) resets += line["verb"] == "reset" ? line.value("count", 1) : 0;
  EXPECT_EQ(resets, 20);
  EXPECT_LT(of(lines, "reset"), 10);
}

/// Nobody gains by saying for whom he asks.
TEST_F(ApiAccessTest, WhoSpeaksForAnotherNeedsTheRightOfBoth) {
  roles_ = Roles({{}, {"games"}, {}}, 0);
  serve_to_all();
  if (IsSkipped()) return;
  const auto games = group("games");
  const nlohmann::json root{{"uid", 0}, {"name", "root"}, {"page", "r"}},
      viewer{{"uid", kAnn}, {"gid", kAnn}, {"groups", {5}}, {"name", "Ann"}, {"page", "a"}},
      operates{{"uid", kBob}, {"gid", kBob}, {"groups", {5, games}}, {"name", "Bob"}, {"page", "b"}};
  Answer claimed;
  as_user(kCleo, kCleo, {}, [&] { claimed = page(root, "POST /v1/control", {{"action", "take"}}); });
  EXPECT_EQ(claimed.status, 403);
  EXPECT_THAT(claimed.text(), HasSubstr("uid 21003 may not operate"));
  EXPECT_THAT(page(viewer, "POST /v1/control", {{"action", "take"}}).text(), HasSubstr("uid 21001 may not operate"));
  EXPECT_EQ(page(viewer, "POST /v1/abort").status, 200);
  EXPECT_EQ(page(operates, "POST /v1/control", {{"action", "take"}}).status, 200);
  for (const auto* wrong :
       {"x", "[]", R"({"uid":1})", R"({"uid":-1,"name":"a","page":"b"})", R"({"uid":4294967295,"name":"a","page":"b"})",
        R"({"uid":1,"name":"a","page":"b","more":1})", R"({"uid":1,"name":"\u001b","page":"b"})",
        R"({"uid":"1","name":"a","page":"b"})"}) {
    const auto header = std::string("Isorig-For: ") + wrong + "\r\n";
    const auto refused = call("POST /v1/reset", "", false, header);
    EXPECT_EQ(refused.status, 400) << wrong;
    EXPECT_THAT(refused.text(), HasSubstr("Isorig-For")) << wrong;
    EXPECT_EQ(call("POST /v1/abort", "", false, header).status, 200) << "a stop is a stop";
  }
}

TEST_F(ApiAccessTest, EveryCommandIsWrittenDownWithWhoWhatAndWhatCameOfItOverRestarts) {
  roles_ = Roles({{}, {"games"}, {}}, 0);
  serve_to_all();
  if (IsSkipped()) return;
  const std::vector<gid_t> operates{5, group("games")};
  EXPECT_EQ(as(kAnn, {7}, "POST /v1/jog", {{"to_mm", 3.5}}).status, 403);
  EXPECT_EQ(as(kBob, operates, "POST /v1/start",
               {{"protocol", kLongProtocol}, {"protocol_name", "long.toml"}, {"operator", "Bob B."}})
                .status,
            200);
  EXPECT_EQ(call("GET /v1/status").status, 200);
  EXPECT_EQ(call("POST /v1/check", R"({"protocol":"x"})").status, 400);
  EXPECT_EQ(as(kAnn, {}, "POST /v1/abort", nlohmann::json::object(), true).status, 200);
  const auto lines = audit(3);
  ASSERT_EQ(lines.size(), 3U) << "looks are no commands";
  EXPECT_EQ(lines[0]["verb"], "jog");
  EXPECT_EQ(lines[0]["arguments"], "to_mm=3.5");
  EXPECT_EQ(lines[0]["uid"], kAnn);
  EXPECT_EQ(lines[0]["groups"], nlohmann::json({7}));
  EXPECT_EQ(lines[0]["status"], 403);
  EXPECT_THAT(lines[0]["outcome"].get<std::string>(), HasSubstr("may not operate"));
  EXPECT_EQ(lines[1]["verb"], "start");
  EXPECT_EQ(lines[1]["uid"], kBob);
  EXPECT_EQ(lines[1]["gid"], kBob);
  EXPECT_EQ(lines[1]["pid"], ::getpid());
  EXPECT_EQ(lines[1]["groups"], operates);
  EXPECT_EQ(lines[1]["ok"], true);
  EXPECT_THAT(lines[1]["arguments"].get<std::string>(),
              AllOf(HasSubstr("operator=Bob B."), HasSubstr("protocol_name=long.toml"), HasSubstr(" bytes)"),
                    Not(HasSubstr("pressurize"))));
  EXPECT_THAT(lines[1]["outcome"].get<std::string>(), HasSubstr("started"));
  EXPECT_EQ(lines[2]["verb"], "abort");
  stop_serving();
  serve();
  EXPECT_EQ(call("POST /v1/abort").status, 200);
  const auto after = audit(4);
  ASSERT_EQ(after.size(), 4U);
  EXPECT_EQ(after[3]["number"], 4);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(after[i], lines[i]);
}

TEST_F(ApiAccessTest, WithoutGroupsWhoeverMayOpenTheSocketMayEverything) {
  serve_to_all();
  if (IsSkipped()) return;
  EXPECT_EQ(as(kAnn, {}, "GET /v1/status").status, 200);
  EXPECT_EQ(as(kAnn, {}, "POST /v1/accept-rig", {{"operator", "Ann"}}).status, 200);
  EXPECT_EQ(as(kAnn, {}, "POST /v1/calibrations", {{"record", "x"}}).status, 400);
  EXPECT_EQ(as(kAnn, {}, "POST /v1/start", {{"protocol", kLongProtocol}}).status, 200);
}

}  // namespace
}  // namespace isorig::daemon::test
