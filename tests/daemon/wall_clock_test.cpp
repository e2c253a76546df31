#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "daemon/recording/catalogue.hpp"
#include "messages/run_log.hpp"
#include "served_rig.hpp"

/// A wall clock that is set while runs come and go: their dates, and which of them is the latest.
namespace isorig::daemon::test {
namespace {

using ::testing::ElementsAre;
using ::testing::StartsWith;

constexpr std::int64_t kDayUs = 86'400'000'000;
constexpr std::int64_t kMay2Us = 1'777'723'200'000'000;  // 2026-05-02T12:00:00Z

protocol::Plan one_session() {
  protocol::Plan plan;
  plan.sessions.resize(1);
  plan.sessions[0].label = "repetition 1, 5 psi";
  return plan;
}

RunInfo info_of(const std::string& started_utc) {
  auto info = testing::run_info();
  info.texts = {{"protocol.toml", "# the protocol\n"}, {"specimen.toml", "# the specimen\n"}};
  info.sessions.push_back({0, 1, 5.0});
  info.started_utc = started_utc;
  return info;
}

void enter(Catalogue& catalogue, const std::string& id, const std::string& started_utc) {
  catalogue.open_run(id, info_of(started_utc), one_session(), "p.toml", "Ada");
  catalogue.close_run(id, "done", "");
}

/// A run's folder that no catalogue knows.
void leave_folder(const std::filesystem::path& folder, const std::string& started_utc) {
  Recorder recorder(testing::recorder_options(folder), info_of(started_utc));
  Streams streams;
  testing::run_plan(recorder, streams, {{100, 0, Keep::kFull}}, 50);
  EXPECT_TRUE(recorder.finish(streams, true));
}

std::vector<std::string> newest_first(const Catalogue& catalogue) {
  std::vector<std::string> ids;
  for (const auto& run : catalogue.runs()) ids.push_back(run.id);
  return ids;
}

TEST(OrderOfRuns, TheLatestIsTheOneThatBeganLastWhateverTheClockSaid) {
  const testing::TemporaryDirectory root("order");
  Catalogue catalogue(root.path());
  enter(catalogue, "before", "2026-05-01T12:00:00Z");
  enter(catalogue, "clock-ahead", "2031-01-01T00:00:00Z");
  enter(catalogue, "set-right", "2026-05-02T12:00:00Z");
  EXPECT_THAT(newest_first(catalogue), ElementsAre("set-right", "clock-ahead", "before"));
  EXPECT_EQ(catalogue.find_run("latest")->id, "set-right");
  enter(catalogue, "before", "2026-05-01T12:00:00Z");  // goes on: a further attempt at a run that is there
  EXPECT_EQ(catalogue.find_run("latest")->id, "set-right");
}

TEST(OrderOfRuns, AnAdoptedFolderHasItsPlaceByItsDate) {
  const testing::TemporaryDirectory root("order");
  {
    Catalogue catalogue(root.path());
    enter(catalogue, "first", "2026-05-01T12:00:00Z");
    enter(catalogue, "second", "2026-05-03T12:00:00Z");
    enter(catalogue, "third", "2026-05-05T12:00:00Z");
  }
  leave_folder(root.path() / "copied-b", "2026-05-04T12:00:00Z");
  leave_folder(root.path() / "copied-a", "2026-05-04T12:00:00Z");
  leave_folder(root.path() / "long-ago", "2020-01-01T00:00:00Z");
  leave_folder(root.path() / "killed-before-its-entry", "2026-05-06T12:00:00Z");
  for (int opened = 0; opened < 2; ++opened) {
    Catalogue catalogue(root.path());
    EXPECT_THAT(newest_first(catalogue),
                ElementsAre("killed-before-its-entry", "third", "copied-b", "copied-a", "second", "first", "long-ago"));
    EXPECT_EQ(catalogue.sessions_of("copied-a").size(), 1U);
  }
  Catalogue catalogue(root.path());
  enter(catalogue, "next", "2026-05-02T12:00:00Z");
  EXPECT_EQ(catalogue.find_run("latest")->id, "next");
}

TEST(OrderOfRuns, WithoutACatalogueItIsThatOfTheirDates) {
  const testing::TemporaryDirectory root("order");
  for (const auto* id : {"a-third", "b-first", "c-second"}) {
    const std::string day = std::string(id) == "a-third" ? "03" : std::string(id) == "b-first" ? "01" : "02";
    leave_folder(root.path() / id, "2026-05-" + day + "T12:00:00Z");
  }
  EXPECT_THAT(newest_first(Catalogue(root.path())), ElementsAre("a-third", "c-second", "b-first"));
}

class WallClock : public ServedRig {
 protected:
  WallClock() : ServedRig("wall-clock") {}
  void SetUp() override {
    epoch_unix_us_ = kMay2Us;
    serve();
  }
  void TearDown() override { stop_serving(); }

  std::string aborted_run() {
    StartOptions options;
    options.protocol_text = kLongProtocol;
    const auto started = host_->start(options);
    EXPECT_TRUE(started.ok) << started.text;
    EXPECT_TRUE(wait_until(60.0, [&] { return host_->recorder_status().session >= 0; }));
    EXPECT_TRUE(host_->verb(Request::Verb::kAbort).ok);
    EXPECT_TRUE(wait_until(60.0, [&] { return !host_->run_open() && state() == RunState::kReady; }));
    return started.run;
  }
  [[nodiscard]] std::int64_t recorded_epoch_unix_us(const std::string& run) const {
    const auto header = messages::read_header(runs_ / run / messages::segment_name(1));
    return header ? header->epoch_unix_us : -1;
  }
};

TEST_F(WallClock, SetBackBetweenTwoRunsDatesEachByItselfAndTheSecondIsTheLatest) {
  const auto first = aborted_run();
  epoch_unix_us_ = kMay2Us - kDayUs;
  const auto second = aborted_run();
  EXPECT_THAT(first, StartsWith("20260502-12"));
  EXPECT_THAT(second, StartsWith("20260501-12"));
  EXPECT_EQ(recorded_epoch_unix_us(first), kMay2Us);
  EXPECT_EQ(recorded_epoch_unix_us(second), kMay2Us - kDayUs);
  const Catalogue catalogue(runs_, Catalogue::Access::kReadOnly);
  EXPECT_EQ(catalogue.find_run("latest")->id, second);
  EXPECT_THAT(catalogue.find_run(second)->started_utc, StartsWith("2026-05-01T12:"));
  const auto listed = host_->runs_json();
  ASSERT_EQ(listed.at("runs").size(), 2U) << listed.dump();
  EXPECT_EQ(listed.at("runs")[0].at("id"), second);
}

}  // namespace
}  // namespace isorig::daemon::test
