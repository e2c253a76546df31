#include "daemon/host/audit_log.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <thread>

#include "daemon/host/api_requests.hpp"
#include "recording_rig.hpp"

namespace isorig::daemon::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::ThrowsMessage;

class AuditLogTest : public ::testing::Test {
 protected:
  testing::TemporaryDirectory root_{"audit"};
  std::filesystem::path file_ = root_.path() / "audit" / "commands.jsonl";
  std::vector<std::string> trouble_;
  std::atomic<int> troubles_ = 0;  // as many, for a thread that waits for them

  std::unique_ptr<AuditLog> open(const AuditLog::Limits& limits = {}) {
    return std::make_unique<AuditLog>(
        root_.path(),
        [this](const std::string& why) {
          trouble_.push_back(why);
          ++troubles_;
          troubles_.notify_all();
        },
        limits);
  }
  static AuditEntry entry(const std::string& verb, const std::string& outcome = "done") {
    AuditEntry e;
    e.unix_ms = 1'795'422'720'007;
    e.peer = {21'001, 1001, 42, {27, 1001}};
    e.verb = verb;
    e.status = 200;
    e.outcome = outcome;
    return e;
  }
  [[nodiscard]] std::vector<std::string> verbs(std::size_t most = 1000) const {
    std::vector<std::string> out;
    for (const auto& line : read_audit(root_.path(), most)) out.push_back(line.value("verb", "?"));
    return out;
  }
};

TEST_F(AuditLogTest, ALineSaysWhoWhatAndWhatCameOfIt) {
  auto e = entry("start", "run 1 started");
  e.arguments = "operator=Ann";
  e.for_whom = Peer{21'002, 1002, 0, {5}};
  e.for_name = "Ann";
  auto log = open();
  log->add(e);
  log->finish();
  const auto lines = read_audit(root_.path(), 10);
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_EQ(lines[0], nlohmann::json::parse(R"({"number":1,"utc":"2026-11-23T08:32:00.007Z","verb":"start",
      "arguments":"operator=Ann","user":"uid 21001","uid":21001,"gid":1001,"groups":[27,1001],"pid":42,"ok":true,"status":200,
      "outcome":"run 1 started","for":{"uid":21002,"gid":1002,"groups":[5],"user":"uid 21002","name":"Ann"}})"));
  EXPECT_TRUE(trouble_.empty());
}

TEST_F(AuditLogTest, ARestartGoesOnBehindWhatIsThereAndAPowerCutCostsItsOwnLine) {
  open()->add(entry("one"));  // written when it goes
  std::string before;
  {
    std::ifstream in(file_);
    before.assign(std::istreambuf_iterator<char>(in), {});
  }
  std::ofstream(file_, std::ios::app) << R"({"number":2,"verb":"ha)";
  open()->add(entry("three"));
  EXPECT_EQ(verbs(), (std::vector<std::string>{"one", "three"}));
  EXPECT_EQ(read_audit(root_.path(), 1)[0]["number"], 2) << "numbers go on where whole lines end";
  std::ifstream in(file_);
  const std::string after{std::istreambuf_iterator<char>(in), {}};
  EXPECT_TRUE(after.starts_with(before)) << "what was written was changed";
}

TEST_F(AuditLogTest, ALineThatSomebodyElseWroteHasAnyNumber) {
  for (const auto* number : {R"("7")", "null", "-7", "7.5", "[]", "1e400"}) {
    std::filesystem::create_directories(file_.parent_path());
    std::ofstream(file_) << R"({"number":3,"verb":"a"})"
                         << "\n"
                         << R"({"number":)" << number << R"(,"verb":"b"})"
                         << "\n";
    open()->add(entry("c"));
    EXPECT_EQ(read_audit(root_.path(), 1)[0]["number"], 4) << number;
  }
  EXPECT_TRUE(trouble_.empty());
}

TEST_F(AuditLogTest, RefusalsAndStopsThatAreRepeatedAreOneLineWithTheirCount) {
  AuditLog::Limits limits;
  limits.repeats = std::chrono::hours(1);
  auto log = open(limits);
  auto refused = entry("reset", "not now");
  refused.status = 409;
  EXPECT_TRUE(log->add(refused));
  refused.arguments = "other=1";
  EXPECT_FALSE(log->add(refused));
  EXPECT_FALSE(log->add(refused));
  auto bobs = refused;
  bobs.peer.uid = 21'002;
  EXPECT_TRUE(log->add(bobs));
  for (int i = 0; i < 5; ++i) EXPECT_EQ(log->add(entry("abort")), i == 0);
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(log->add(entry("jog"))) << "what moved the rig has a line each time";
  log->finish();
  std::vector<std::string> lines;
  for (const auto& line : read_audit(root_.path(), 100))
    lines.push_back(line["verb"].get<std::string>() + " " + std::to_string(line.value("count", 1)));
  EXPECT_EQ(lines, (std::vector<std::string>{"reset 1", "reset 2", "reset 1", "abort 1", "abort 4", "jog 1", "jog 1"}));
}

TEST_F(AuditLogTest, WhatIsRepeatedIsWrittenWhenItsTimeIsUpThoughNothingElseComes) {
  AuditLog::Limits limits;
  limits.repeats = std::chrono::milliseconds(200);
  auto log = open(limits);
  std::thread writing([&] { log->run(); });
  EXPECT_TRUE(log->add(entry("abort")));
  EXPECT_FALSE(log->add(entry("abort")));
  EXPECT_FALSE(log->add(entry("abort")));
  std::vector<nlohmann::json> lines;
  for (int i = 0; i < 500 && lines.size() < 2; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    if (std::filesystem::exists(file_)) lines = read_audit(root_.path(), 10);
  }
  log->stop();
  writing.join();
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_EQ(lines[1]["count"], 2);
}

TEST_F(AuditLogTest, FullFilesGetANumberAndTheOldestGo) {
  AuditLog::Limits limits;
  limits.file_bytes = 1000;
  limits.files = 3;
  for (int i = 0; i < 60; ++i) {
    auto log = open(limits);  // over restarts, too
    log->add(entry("verb" + std::to_string(i)));
  }
  std::size_t files = 0, bytes = 0;
  for (const auto& f : std::filesystem::directory_iterator(file_.parent_path())) {
    ++files;
    bytes += f.file_size();
  }
  EXPECT_EQ(files, 4U);
  EXPECT_LT(bytes, 4U * 1400U);
  std::vector<double> told;
  const auto kept = read_audit(root_.path(), 1000, [&](double done) { told.push_back(done); });
  EXPECT_EQ(told, (std::vector<double>{0.0, 0.25, 0.5, 0.75}));
  ASSERT_GT(kept.size(), 8U);
  EXPECT_EQ(kept.back()["verb"], "verb59");
  for (std::size_t i = 1; i < kept.size(); ++i) EXPECT_EQ(kept[i]["number"], kept[i - 1]["number"].get<int>() + 1);
  EXPECT_EQ(kept.back()["number"], 60);
  EXPECT_EQ(verbs(2), (std::vector<std::string>{"verb58", "verb59"}));
}

TEST_F(AuditLogTest, WhatTheDiskDoesNotTakeIsKeptAndWhatIsTooMuchIsCounted) {
  AuditLog::Limits limits;
  limits.queued = 3;
  std::ofstream(root_.path() / "audit") << "in the way";
  auto log = open(limits);
  std::thread writing([&] { log->run(); });
  log->add(entry("one"));
  troubles_.wait(0);
  log->stop();
  writing.join();
  ASSERT_EQ(trouble_.size(), 1U) << "once for each cause";
  EXPECT_THAT(trouble_[0], AllOf(HasSubstr("commands.jsonl cannot be made"), HasSubstr("kept in memory")));
  for (const auto* verb : {"two", "three", "four", "five"}) log->add(entry(verb));
  std::filesystem::remove(root_.path() / "audit");
  log->finish();
  log->add(entry("six"));
  log->finish();
  EXPECT_EQ(verbs(), (std::vector<std::string>{"one", "two", "three", "six"}));
  EXPECT_EQ(read_audit(root_.path(), 1)[0]["lost_before"], 2);
}

TEST_F(AuditLogTest, NoLinkIsFollowed) {
  const auto elsewhere = root_.path() / "elsewhere";
  std::filesystem::create_directory(root_.path() / "audit");
  std::ofstream(elsewhere) << "somebody's";
  std::filesystem::create_symlink(elsewhere, file_);
  auto log = open();
  log->add(entry("one"));
  log->finish();
  EXPECT_EQ(std::filesystem::file_size(elsewhere), 10U);
  ASSERT_EQ(trouble_.size(), 1U);
  std::filesystem::remove_all(root_.path() / "audit");
  std::filesystem::create_directory(root_.path() / "dir");
  std::filesystem::create_directory_symlink(root_.path() / "dir", root_.path() / "audit");
  log = open();
  log->add(entry("two"));
  log->finish();
  EXPECT_TRUE(std::filesystem::is_empty(root_.path() / "dir"));
}

TEST_F(AuditLogTest, SaysWhereItLooked) {
  EXPECT_THAT([&] { (void)read_audit(root_.path(), 1); },
              ThrowsMessage<std::runtime_error>(AllOf(HasSubstr("commands.jsonl"), HasSubstr("--runs"))));
}

TEST(ShortArguments, AreALineWithoutTheTexts) {
  EXPECT_EQ(short_arguments("", false), "");
  EXPECT_EQ(short_arguments(R"({"to_mm":-1.5,"velocity_mm_s":2})", false), "to_mm=-1.5, velocity_mm_s=2");
  const std::string text(5000, 'x');
  const auto body = R"({"protocol":")" + text + R"(","operator":"Ann","specimen":"","dry_run":true})";
  EXPECT_EQ(short_arguments(body, false), "(" + std::to_string(body.size()) + " bytes)");
  EXPECT_EQ(short_arguments(body, true), "dry_run=true, operator=Ann, protocol=(5000 bytes)");
  EXPECT_EQ(short_arguments(R"({"a":"x\ny","b":"\u001b[31m"})", false), "a=(3 bytes), b=\\u001b[31m");
  EXPECT_EQ(short_arguments("[1]", false), "(3 bytes, no JSON object)");
  EXPECT_EQ(short_arguments("{", false), "(1 bytes, no JSON object)");
  EXPECT_THAT(short_arguments(std::string(100'000, '['), true), HasSubstr("nested deeper"));
  std::string many = "{\"a\":0";
  for (int i = 0; i < 2000; ++i) many += ",\"key" + std::to_string(i) + "\":1";
  EXPECT_LT(short_arguments(many + "}", true).size(), 4200U);
}

}  // namespace
}  // namespace isorig::daemon::test
