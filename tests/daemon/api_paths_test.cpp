#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "daemon/recording/run_directory.hpp"
#include "daemon/rig/specimen.hpp"
#include "served_rig.hpp"

/// Whatever a client names, over the real socket: nothing is read or written outside of the runs' folder, and no link
/// in it is followed.
namespace isorig::daemon::test {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr const char* kSecret = "what nobody asked for";

class ApiPathsTest : public ServedRig {
 protected:
  ApiPathsTest() : ServedRig("paths") {
    config_.core.operating.arming_required = false;
    std::filesystem::create_directories(outside_);
    std::ofstream(outside_ / "report.html") << kSecret;
  }
  void TearDown() override { stop_serving(); }

  [[nodiscard]] Answer post(const std::string& path, const nlohmann::json& body) const {
    return call("POST " + path, body.dump());
  }
  /// A run that was begun and aborted.
  [[nodiscard]] std::string a_run() const {
    const auto started = post("/v1/start", {{"protocol", kLongProtocol}});
    EXPECT_EQ(started.status, 200) << started.body;
    EXPECT_EQ(post("/v1/abort", nlohmann::json::object()).status, 200);
    EXPECT_TRUE(wait_until(60.0, [&] { return !host_->run_open() && state() == RunState::kReady; }));
    return started.body.value("run", "");
  }
  /// Every file below a folder with its bytes.
  static std::map<std::string, std::string> content(const std::filesystem::path& folder) {
    std::map<std::string, std::string> out;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
      if (!entry.is_regular_file()) continue;
      std::ifstream in(entry.path(), std::ios::binary);
      out[entry.path().string()] = {std::istreambuf_iterator<char>(in), {}};
    }
    return out;
  }

  std::filesystem::path outside_ = folder_.path() / "outside";
};

TEST_F(ApiPathsTest, NoNameOfARunLeadsOut) {
  serve();
  const auto run = a_run();
  const auto before = content(outside_);
  for (const std::string& name :
       {std::string("../outside"), run + "/../../outside", "/" + run, "./" + run, outside_.string(), std::string(".."),
        std::string("."), std::string(""), std::string("audit"), run + std::string("\0x", 2)}) {
    SCOPED_TRACE(name);
    const auto answers = {
        call("GET /v1/report?run=" +
             [&] {
               std::string coded;
               for (const unsigned char c : name) {
                 char hex[4];
                 std::snprintf(hex, sizeof hex, "%%%02X", c);
                 coded += hex;
               }
               return coded;
             }()),
        post("/v1/notes", {{"run", name}, {"text", "x"}}),
        post("/v1/start", {{"resume_run", name.empty() ? "no-such" : name}, {"resume_aborted", true}})};
    for (const auto& answer : answers) {
      EXPECT_THAT(answer.status, AnyOf(400, 404, 409)) << answer.body;
      EXPECT_THAT(answer.body.dump(), Not(HasSubstr(kSecret)));
    }
  }
  EXPECT_EQ(content(outside_), before);
  // A name like another, of which there is no run, is not refused but not found (docs/api.md).
  for (const auto& answer : {post("/v1/notes", {{"run", "20200101-000000-none"}, {"text", "x"}}),
                             post("/v1/start", {{"resume_run", "20200101-000000-none"}}),
                             post("/v1/start", {{"resume_run", "20200101-000000-none"}, {"dry_run", true}})}) {
    EXPECT_EQ(answer.status, 404) << answer.body;
    EXPECT_THAT(answer.text(), HasSubstr("no run is called 20200101-000000-none"));
  }
}

TEST_F(ApiPathsTest, NamesOfProtocolsAndSpecimensMakeNoPath) {
  serve();
  auto specimen = load_specimen(config_.specimen).text;
  const auto at = specimen.find("name = ");
  specimen.replace(at, specimen.find('\n', at) - at, "name = \"../../outside/planted\"");
  const auto refused =
      post("/v1/start", {{"protocol", kLongProtocol}, {"specimen", specimen}, {"specimen_name", "../../x.toml"}});
  EXPECT_EQ(refused.status, 400) << refused.body;
  EXPECT_THAT(refused.text(), HasSubstr("since it names files"));
  const auto started =
      post("/v1/start", {{"protocol", kLongProtocol}, {"protocol_name", "../../../outside/../..%2f/x.toml"}});
  ASSERT_EQ(started.status, 200) << started.body;
  const auto run = started.body.value("run", "");
  EXPECT_EQ(run.find_first_of("/\\%"), std::string::npos) << run;
  EXPECT_TRUE(std::filesystem::is_directory(runs_ / run));
  EXPECT_EQ(content(outside_).size(), 1U);
  EXPECT_EQ(post("/v1/abort", nlohmann::json::object()).status, 200);
}

TEST_F(ApiPathsTest, ARunFolderThatIsALinkIsNeitherReadNorWritten) {
  serve();
  const auto run = a_run();
  std::filesystem::rename(runs_ / run, outside_ / run);
  std::filesystem::create_directory_symlink(outside_ / run, runs_ / run);
  std::ofstream(outside_ / run / "report.html") << kSecret;
  std::ofstream(outside_ / run / "amendments.toml") << "[[amendment]]\nat_utc = \"x\"\ntext = \"" << kSecret << "\"\n";
  const auto before = content(outside_);
  const auto page = call("GET /v1/report?run=" + run);
  EXPECT_EQ(page.status, 409);
  EXPECT_THAT(page.text(), HasSubstr("symbolic link"));
  for (const auto& answer : {post("/v1/notes", {{"run", run}, {"text", "x"}}),
                             post("/v1/start", {{"resume_run", run}, {"resume_aborted", true}}),
                             post("/v1/start", {{"resume_run", run}, {"resume_aborted", true}, {"dry_run", true}})}) {
    EXPECT_EQ(answer.status, 409) << answer.body;
    EXPECT_THAT(answer.text(), HasSubstr("is a symbolic link"));
  }
  const auto list = call("GET /v1/runs");
  ASSERT_EQ(list.status, 200);
  EXPECT_THAT(list.body.dump(), Not(HasSubstr(kSecret)));
  EXPECT_EQ(content(outside_), before);
}

TEST_F(ApiPathsTest, NoLinkInARunFolderIsFollowed) {
  serve();
  const auto run = a_run();
  std::ofstream(outside_ / "theirs.toml") << "[[amendment]]\nat_utc = \"x\"\ntext = \"" << kSecret << "\"\n";
  std::filesystem::remove(runs_ / run / "report.html");
  std::filesystem::create_symlink(outside_ / "report.html", runs_ / run / "report.html");
  std::filesystem::create_symlink(outside_ / "theirs.toml", runs_ / run / "amendments.toml");
  const auto before = content(outside_);
  EXPECT_EQ(call("GET /v1/report?run=" + run).status, 409);
  const auto list = call("GET /v1/runs");
  EXPECT_THAT(list.body.dump(), Not(HasSubstr(kSecret)));
  EXPECT_EQ(list.body["runs"][0]["report"], false);
  EXPECT_THAT(list.body["runs"][0]["notes"].dump(), HasSubstr("symbolic link"));
  EXPECT_EQ(post("/v1/notes", {{"run", run}, {"text", "x"}}).status, 409);
  EXPECT_EQ(content(outside_), before);
  // The lock: a link would have been made, or locked, elsewhere.
  std::filesystem::remove(runs_ / run / ".lock");
  std::filesystem::create_symlink(outside_ / "made-here", runs_ / run / ".lock");
  EXPECT_EQ(post("/v1/start", {{"resume_run", run}, {"resume_aborted", true}}).status, 409);
  EXPECT_FALSE(std::filesystem::exists(outside_ / "made-here"));
}

TEST_F(ApiPathsTest, AFolderElsewhereIsNotTakenForARecordingOfTheseRuns) {
  serve();
  const auto run = a_run();
  stop_serving();
  std::filesystem::rename(runs_ / run, outside_ / run);
  std::ofstream(outside_ / run / kReserveName) << "theirs";
  std::filesystem::remove(runs_ / "catalogue.sqlite");
  std::filesystem::create_directory_symlink(outside_ / run, runs_ / "adopted");
  const auto before = content(outside_);
  serve();
  EXPECT_EQ(call("GET /v1/runs").body["all"], 0);
  EXPECT_EQ(content(outside_), before);
}

TEST_F(ApiPathsTest, ACalibrationIsKeptUnderTheNameOfItsTimeAndChannel) {
  serve();
  for (const char* id : {"../../outside/x", "/tmp/x", "a/b", ""}) {
    const auto refused =
        post("/v1/calibrations", {{"record", std::string("format = \"isorig-calibration/1\"\nid = \"") + id + "\"\n"}});
    EXPECT_EQ(refused.status, 400) << id;
  }
  EXPECT_EQ(content(outside_).size(), 1U);
  EXPECT_FALSE(std::filesystem::exists("/tmp/x.toml"));
}

TEST_F(ApiPathsTest, NoNameOfADiagnosisOrItsPageLeadsOut) {
  serve();
  std::ofstream(outside_ / "report.html") << kSecret;
  std::string out;
  for (const char c : std::filesystem::absolute(outside_ / "report.html").string())
    out += c == '/' ? std::string("%2f") : std::string(1, c);
  const auto runs = std::filesystem::absolute(runs_).string();
  for (const std::string& id : {std::string("..%2f..%2foutside%2freport.html"), std::string("%2fetc%2fpasswd"),
                                std::string(""), std::string("0123456789abcdef"), out, runs + "/../outside/report.html",
                                runs + "%2f..%2foutside%2freport.html"}) {
    for (const char* call_of : {"/v1/page?path=", "/v1/experiment?id="}) {
      const auto answer = call(std::string("GET ") + call_of + id);
      EXPECT_EQ(answer.status, 404) << call_of << id << answer.body;
      EXPECT_THAT(answer.body.dump(), Not(HasSubstr(kSecret)));
    }
  }
}

}  // namespace
}  // namespace isorig::daemon::test
