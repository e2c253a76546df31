#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "../system/processes_with.hpp"
#include "../system/terminal.hpp"
#include "page_links.hpp"
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
  const auto page = pieces_test::page_data(dir / "whole/campaign-report.html");
  EXPECT_EQ(pieces_test::links_in(pieces_test::block_of(page, "grid")).size(), 4U);
  EXPECT_THAT(pieces_test::broken_links(dir / "whole/campaign-report.html"), IsEmpty());

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

/// Commands of Slurm that know one array, which runs for ever: what it is called is what sbatch was told.
class ArrayThatRuns {
 public:
  explicit ArrayThatRuns(const fs::path& folder) : before_(std::getenv("PATH")) {
    fs::create_directories(folder);
    const std::string name = (folder / "name").string();
    put(folder / "sbatch",
        "for word; do case $word in --job-name=*) echo \"${word#*=}\" > '" + name + "';; esac; done; echo 77");
    put(folder / "squeue", "case \"$*\" in *--me*) test -e '" + name + "' && echo 77 \"$(cat '" + name +
                               "')\" || true;; *) echo RUNNING None;; esac");
    put(folder / "scontrol", "echo MaxArraySize = 1001");
    ::setenv("PATH", (folder.string() + ":" + before_).c_str(), 1);
  }
  ~ArrayThatRuns() { ::setenv("PATH", before_.c_str(), 1); }
  ArrayThatRuns(const ArrayThatRuns&) = delete;
  ArrayThatRuns& operator=(const ArrayThatRuns&) = delete;

 private:
  static void put(const fs::path& file, const std::string& acts) {
    spit(file, "#!/bin/sh\n" + acts + "\n");
    fs::permissions(file, fs::perms::owner_all);
  }
  std::string before_;
};

/// Nine tenths were there when this call began to wait: they say nothing of how long the last one takes.
TEST(CampaignLocal, AnArrayOfAnEarlierCallPromisesNoTimeLeft) {
  const TempDir dir;
  const ArrayThatRuns slurm(dir / "slurm");
  std::vector<std::string> words{bin("isorig"), "campaign", "--ask", "diagnose",
                                 "--on",        "slurm",    "--out", (dir / "out").string()};
  for (int i = 0; i < 10; ++i) words.push_back((dir / ("r" + std::to_string(i))).string());
  {
    Process first(words, dir / "first.txt");
    ASSERT_TRUE(wait_until(60.0, [&] { return first.output().find("submitted as job array 77") != std::string::npos; }))
        << first.output();
    EXPECT_EQ(first.stop(SIGINT), -SIGINT) << first.output();
  }
  spit(dir / "out/slurm/array-1/task-0.tally", "9 0\n");
  system_test::Terminal second(words, {.columns = 160});
  ASSERT_TRUE(second.shows("of an earlier call is under way")) << second.shown();
  ASSERT_TRUE(second.shows("90.0 %, 6.")) << second.shown();
  ASSERT_TRUE(second.shows("9 of 10, 1 running")) << second.shown();
  EXPECT_THAT(second.shown(), ::testing::Not(HasSubstr(" left")));
  second.signal(SIGINT);
  EXPECT_EQ(second.wait(), -SIGINT) << second.shown();
  EXPECT_THAT(second.shown(), HasSubstr("`scancel 77` ends it"));
}

/// What a runner remembers of a piece is a line of its page, of which there are at most 2000: recording, four numbers,
/// verdict and link as text (300 bytes), as JSON (7 values of 16 bytes, their strings of 32 and what they hold again),
/// twice more while the page is put together, and a cell of the grid with title and link (400 bytes, thrice): some 3
/// kB. A log that is kept, or a process that is not forgotten, is more. The allocator takes memory by the megabyte.
TEST(CampaignLocal, MemoryDoesNotGrowWithThePieces) {
  const TempDir dir;
  constexpr std::size_t kFew = 50, kMany = 500;
  constexpr double kEach_MB = 0.003, kAllocator_MB = 2.0;
  std::string list;
  const auto peak_of = [&](std::size_t count, const std::string& out) {
    while (static_cast<std::size_t>(std::ranges::count(list, '\n')) < count) {
      const fs::path r = dir / ("bad-" + std::to_string(std::ranges::count(list, '\n')));
      fs::create_directories(r);
      spit(r / "recording.toml", "specimen = \"s\"\nnominal_pressure_psi = 10\n");
      spit(r / "frame.csv", "t_s,position_mm,force_N\n0,0,zero\n");
      list += r.string() + "\n";
    }
    spit(dir / "list.txt", list);
    Process process({bin("isorig"), "campaign", "--ask", "diagnose", "--list", (dir / "list.txt").string(), "--out",
                     (dir / out).string(), "-j", "2"},
                    dir / (out + ".txt"));
    EXPECT_EQ(process.wait(500.0), 3) << process.output();
    EXPECT_THAT(process.output(), HasSubstr(std::to_string(count) + " of them unreadable"));
    return process.peak_MB();
  };
  const double few_MB = peak_of(kFew, "few"), many_MB = peak_of(kMany, "many");
  std::printf("%zu pieces: %.1f MB; %zu pieces: %.1f MB\n", kFew, few_MB, kMany, many_MB);
  EXPECT_LT(many_MB - few_MB, kAllocator_MB + kEach_MB * static_cast<double>(kMany - kFew));
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
