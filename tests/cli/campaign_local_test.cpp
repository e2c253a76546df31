#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "../system/processes_with.hpp"
#include "pieces_of_test.hpp"

/// `isorig campaign --ask` as a user runs it on this machine.
namespace isorig {
namespace {

namespace fs = std::filesystem;
using pieces_test::campaign;
using pieces_test::different_files;
using pieces_test::make_recordings;
using pieces_test::pieces_in;
using system_test::bin;
using system_test::isorig;
using system_test::Process;
using system_test::processes_with;
using system_test::slurp;
using system_test::spit;
using system_test::TempDir;
using system_test::wait_until;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(CampaignLocal, InterruptedAndGoneOnWithGivesTheBytesOfAnUninterruptedRun) {
  const TempDir dir;
  const auto recordings = make_recordings(dir / "recordings", 4);
  const auto whole = isorig(dir, campaign(recordings, dir / "whole", {"-j", "2"}), 240.0);
  ASSERT_EQ(whole.code, 0) << whole.text;
  EXPECT_THAT(whole.text, HasSubstr("4 of 4 recordings answered"));
  EXPECT_EQ(pieces_in(dir / "whole").size(), 4U);
  EXPECT_THAT(slurp(dir / "whole/pooled.json"), HasSubstr("isorig-pooled/1")) << whole.text;
  EXPECT_THAT(slurp(dir / "whole/campaign-report.html"), HasSubstr("What the campaign says"));

  auto words = campaign(recordings, dir / "again", {"-j", "1"});
  words.insert(words.begin(), bin("isorig"));
  {
    Process first(words, dir / "first.txt");
    ASSERT_TRUE(wait_until(120.0, [&] { return !pieces_in(dir / "again").empty(); })) << first.output();
    EXPECT_THAT(isorig(dir, campaign(recordings, dir / "again", {})).text,
                HasSubstr("another `isorig campaign` works there"));
    EXPECT_EQ(first.stop(SIGINT), -SIGINT) << first.output();
    EXPECT_THAT(first.output(), HasSubstr("the same command goes on"));
  }
  EXPECT_THAT(processes_with("diagnose " + recordings.back()), IsEmpty()) << "a child outlived it";
  const auto before = pieces_in(dir / "again");
  ASSERT_LT(before.size(), 4U);
  std::map<fs::path, fs::file_time_type> written;
  for (const auto& piece : before) written[piece] = fs::last_write_time(piece / "piece.json");
  const auto second = isorig(dir, campaign(recordings, dir / "again", {"-j", "2"}), 240.0);
  ASSERT_EQ(second.code, 0) << second.text;
  for (const auto& [piece, time] : written) EXPECT_EQ(fs::last_write_time(piece / "piece.json"), time) << "made again";
  EXPECT_THAT(different_files(dir / "whole", dir / "again"), IsEmpty());
  for (const auto& entry : fs::recursive_directory_iterator(dir / "again/pieces"))
    EXPECT_FALSE(entry.path().filename().string().starts_with(".")) << entry.path() << " was left";
}

TEST(CampaignLocal, AKilledPieceIsRepeatedAndCostsThatPieceAlone) {
  const TempDir dir;
  const auto recordings = make_recordings(dir / "recordings", 2);
  auto words = campaign(recordings, dir / "out", {"-j", "2"});
  words.insert(words.begin(), bin("isorig"));
  Process process(words, dir / "out.txt");
  std::vector<pid_t> victim;
  ASSERT_TRUE(wait_until(60.0, [&] {
    victim = processes_with("diagnose " + recordings[0]);
    return !victim.empty();
  }));
  ::kill(victim.front(), SIGKILL);
  EXPECT_EQ(process.wait(240.0), 0) << process.output();
  EXPECT_EQ(pieces_in(dir / "out").size(), 2U);
  const auto whole = isorig(dir, campaign(recordings, dir / "whole", {}), 240.0);
  EXPECT_THAT(different_files(dir / "whole", dir / "out"), IsEmpty());
}

constexpr const char* kModel = R"(format = "isorig-model/1"
name = "spring and arm"
[[part]]
physics = "spring"
[[part]]
physics = "maxwell"
)";

/// A model that is edited while a campaign runs: no table has pieces of both, and the call says so.
TEST(CampaignLocal, AModelThatIsEditedMeanwhileEndsTheCampaign) {
  const TempDir dir;
  const auto recordings = make_recordings(dir / "recordings", 3);
  const fs::path model = dir / "model.toml";
  spit(model, kModel);
  auto words = campaign(recordings, dir / "out", {"-j", "1", "--model", model.string()});
  words.insert(words.begin(), bin("isorig"));
  {
    Process first(words, dir / "first.txt");
    ASSERT_TRUE(wait_until(120.0, [&] { return !pieces_in(dir / "out").empty(); })) << first.output();
    spit(model, std::string(kModel) + "[[part]]\nphysics = \"constant\"\n");
    EXPECT_EQ(first.wait(120.0), 1) << first.output();
    EXPECT_THAT(first.output(), HasSubstr("model.toml: the model was changed"));
    EXPECT_THAT(first.output(), HasSubstr("0 of 3 recordings answered; 3 not made yet"));
  }
  ASSERT_LT(pieces_in(dir / "out").size(), 3U) << "it had ended before";
  words.erase(words.begin());
  const auto second = isorig(dir, words, 240.0);
  EXPECT_EQ(second.code, 0) << second.text;
  const auto whole = isorig(dir, campaign(recordings, dir / "whole", {"--model", model.string()}), 240.0);
  ASSERT_EQ(whole.code, 0) << whole.text;
  EXPECT_THAT(different_files(dir / "whole", dir / "out"), IsEmpty());
}

/// A task of a job array outlives the call that submitted it: whoever makes pieces here at the same time would make
/// the same ones, and sweep away what the task has begun.
TEST(CampaignLocal, NobodyMakesPiecesBesideATaskOfAnArray) {
  const TempDir dir;
  const auto recordings = make_recordings(dir / "recordings", 2);
  const auto call = campaign(recordings, dir / "out", {"-j", "1"});
  ASSERT_EQ(isorig(dir, call, 240.0).code, 0);
  fs::remove_all(dir / "out/pieces");
  const std::vector<std::string> task{bin("isorig"),
                                      "campaign-pieces",
                                      (dir / "out").string(),
                                      "--list",
                                      (dir / "out/plan.txt").string(),
                                      "--task",
                                      "0",
                                      "--of",
                                      "1"};
  {
    Process array(task, dir / "task.txt");
    ASSERT_TRUE(wait_until(60.0, [&] { return !processes_with("diagnose " + recordings[0]).empty(); }));
    const auto refused = isorig(dir, call, 60.0);
    EXPECT_EQ(refused.code, 2) << refused.text;
    EXPECT_THAT(refused.text, HasSubstr("tasks of a job array make its pieces"));
    EXPECT_EQ(array.wait(240.0), 0) << array.output();
    EXPECT_EQ(pieces_in(dir / "out").size(), 2U) << "one was swept away";
  }
  fs::remove_all(dir / "out/pieces");
  auto words = call;
  words.insert(words.begin(), bin("isorig"));
  Process local(words, dir / "local.txt");
  ASSERT_TRUE(wait_until(60.0, [&] { return !processes_with("diagnose " + recordings[0]).empty(); }));
  Process late(task, dir / "task.txt");
  EXPECT_NE(late.wait(60.0), 0);
  EXPECT_THAT(late.output(), HasSubstr("another `isorig campaign` works there"));
  EXPECT_EQ(local.wait(240.0), 0) << local.output();
}

TEST(CampaignLocal, AListWithWhatIsMissingAndWhatIsBadSaysWhereTheLogsAre) {
  const TempDir dir;
  const auto recordings = make_recordings(dir / "recordings", 2);
  spit(fs::path(recordings[1]) / "frame.csv", "t_s,position_mm,force_N\n0,0,zero\n");
  spit(dir / "list.txt", recordings[0] + "\n" + recordings[1] + "\n" + (dir / "gone").string() + "\n");
  const std::vector<std::string> words{
      "campaign", "--ask", "fv", "--list", (dir / "list.txt").string(), "--out", (dir / "out").string()};
  const auto first = isorig(dir, words, 120.0);
  EXPECT_EQ(first.code, 1) << first.text;
  EXPECT_THAT(first.text, HasSubstr("2 of 3 recordings answered, 1 of them unreadable; 1 failed"));
  EXPECT_THAT(first.text, HasSubstr("failed: " + (dir / "gone").string() + ": see " + (dir / "out/failed").string()));
  fs::create_directories(dir / "gone");
  fs::copy(recordings[0], dir / "gone", fs::copy_options::recursive);
  const auto second = isorig(dir, words, 120.0);
  EXPECT_EQ(second.code, 3) << "one cannot be read: " << second.text;
  const auto json = nlohmann::json::parse(slurp(dir / "out/campaign.json"));
  EXPECT_EQ(json["recordings"][0]["verdict"], "fitted");
  EXPECT_EQ(json["recordings"][1]["verdict"], "bad_recording");
  EXPECT_EQ(json["recordings"][2]["verdict"], "fitted");
  EXPECT_THAT(slurp(dir / "out" / json["recordings"][1]["folder"].get<std::string>() / "log.txt"),
              HasSubstr("frame.csv:2"));
  EXPECT_TRUE(fs::exists(dir / "out" / json["recordings"][0]["page"].get<std::string>()));
}

}  // namespace
}  // namespace isorig
