#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "campaign_of_scripts.hpp"
#include "cli/campaign/merge.hpp"
#include "cli/campaign/piece.hpp"
#include "cli/campaign/plan.hpp"

/// Plan and pieces. The program that is called here is a script; campaign_local_test and campaign_slurm_test call
/// isorig itself.
namespace isorig::cli::pieces {
namespace {

namespace fs = std::filesystem;
using system_test::slurp;
using system_test::spit;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;

TEST_F(Campaign, NamesOfPiecesTellRecordingsApartAndAreSafe) {
  const fs::path one = piece_name("/lab/control/rep-1"), other = piece_name("/lab/sheath/rep-1");
  EXPECT_NE(one, other);
  EXPECT_THAT(one.filename().string(), HasSubstr("rep-1-"));
  EXPECT_EQ(one.parent_path().string().size(), 3U) << "a shard of three hexadecimal digits";
  EXPECT_EQ(one, piece_name("/lab/control/rep-1"));
  for (const auto& name :
       std::vector<std::string>{"/lab/a b;$(c)'\"", "/lab/..x", "/lab/-x", "/lab/" + std::string(255, 'x'), "/"}) {
    const std::string safe = piece_name(name).filename().string();
    EXPECT_EQ(safe.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_."),
              std::string::npos)
        << safe;
    EXPECT_NE(safe.front(), '.');
    EXPECT_NE(safe.front(), '-');
    EXPECT_LE(safe.size(), 100U) << "room for what stands before and behind it while it is made";
  }
}

TEST_F(Campaign, ShardsAreEven) {
  std::map<std::string, int> shards;
  for (int i = 0; i < 100000; ++i) ++shards[piece_name("/lab/actuator-" + std::to_string(i)).parent_path().string()];
  int most = 0;
  for (const auto& [shard, count] : shards) most = std::max(most, count);
  // Poisson with mean 100000/4096 = 24.4: the greatest of 4096 stays below mean + 7 standard deviations.
  EXPECT_GT(shards.size(), 4000U);
  EXPECT_LE(most, 60);
}

TEST_F(Campaign, PlanTakesAListAndRefusesWhatItCannotRun) {
  std::istringstream list("/lab/a b\n\n/lab/c/../d/\r\n");
  EXPECT_EQ(write_plan(plan(), {{"/lab/x"}, "-"}, list), 3U);
  EXPECT_EQ(slurp(dir_ / "campaign/plan.txt"), "/lab/x\n/lab/a b\n/lab/d\n");
  EXPECT_EQ(read_plan(dir_ / "campaign").ask, Ask{});
  std::istringstream twice("/lab/a\n/lab/b\n/lab/./a\n");
  EXPECT_THAT(
      [&] {
        (void)write_plan(plan(), {{}, "-"}, twice);
      },
      ThrowsMessage<PlanError>(HasSubstr("/lab/a: named twice")));
  EXPECT_EQ(slurp(dir_ / "campaign/plan.txt"), "/lab/x\n/lab/a b\n/lab/d\n") << "what was there stays";
  std::istringstream odd("/lab/a\n/lab/\x1b[2J\n");
  EXPECT_THAT(
      [&] {
        (void)write_plan(plan(), {{}, "-"}, odd);
      },
      ThrowsMessage<PlanError>(HasSubstr("standard input:2: ")));
  EXPECT_THAT(
      [&] {
        (void)write_plan(plan(), {{}, "/no/such/list"}, nothing_);
      },
      ThrowsMessage<PlanError>(HasSubstr("/no/such/list: cannot be read")));
  EXPECT_THAT(
      [&] {
        (void)write_plan(plan(), {{}, ""}, nothing_);
      },
      ThrowsMessage<PlanError>(HasSubstr("no recording")));
}

TEST_F(Campaign, AnotherCampaignInTheFolderIsRefusedAndSaysWhatDiffers) {
  (void)write_plan(plan(), {{"/lab/x"}, ""}, nothing_);
  EXPECT_THAT(
      [&] {
        (void)write_plan(plan({"diagnose", "slse2", 1}), {{"/lab/x"}, ""}, nothing_);
      },
      ThrowsMessage<PlanError>(HasSubstr("--model: slse1 there, slse2 here")));
  EXPECT_EQ(write_plan(plan({"diagnose", "slse1", 2}, "isorig 2"), {{"/lab/x"}, ""}, nothing_), 1U)
      << "threads and the program's version are no other campaign";
  fs::remove(dir_ / "campaign/plan.json");
  spit(dir_ / "campaign/campaign.json", "{}");
  EXPECT_THAT(
      [&] {
        (void)write_plan(plan(), {{"/lab/x"}, ""}, nothing_);
      },
      ThrowsMessage<PlanError>(HasSubstr("the paper's figures")));
  const FolderLock lock(dir_ / "campaign");
  EXPECT_THAT([&] { const FolderLock second(dir_ / "campaign"); },
              ThrowsMessage<PlanError>(HasSubstr("(process " + std::to_string(::getpid()) + " on ")));
}

TEST_F(Campaign, ARecordingByTwoPathsIsNamedTwice) {
  const std::string r = recording("lab/rep-1"), other = recording("lab/rep-2");
  fs::create_directory_symlink(r, dir_ / "link");
  const auto refused = [&](const std::string& by) {
    EXPECT_THAT(
        [&] {
          (void)write_plan(plan(), {{other, r, by}, ""}, nothing_);
        },
        ThrowsMessage<PlanError>(HasSubstr(by + ": the same recording as " + r)));
    EXPECT_FALSE(fs::exists(dir_ / "campaign/plan.json"));
    EXPECT_FALSE(fs::exists(dir_ / "campaign/plan.txt.part"));
  };
  refused((dir_ / "link").string());
  fs::create_directories(dir_ / "linked");
  fs::create_directory_symlink(dir_ / "lab", dir_ / "linked/lab");
  refused((dir_ / "linked/lab/rep-1").string());
  // The readings, beside a recording.toml of their own.
  const std::string hard = recording("hard");
  fs::remove(fs::path(hard) / "frame.csv");
  fs::create_hard_link(fs::path(r) / "frame.csv", fs::path(hard) / "frame.csv");
  refused(hard);
  EXPECT_EQ(write_plan(plan(), {{r, other, (dir_ / "gone").string(), (dir_ / "gone too").string()}, ""}, nothing_), 4U)
      << "what is not there is no recording twice";
}

TEST_F(Campaign, WhatOthersWroteThereIsLeftAlone) {
  spit(dir_ / "campaign/pooled.json", "{}");
  const auto make = [&] { return write_plan(plan(), {{"/lab/x"}, ""}, nothing_); };
  EXPECT_THAT([&] { (void)make(); }, ThrowsMessage<PlanError>(HasSubstr("holds what `isorig pool` wrote")));
  fs::remove(dir_ / "campaign/pooled.json");
  // A plan that was damaged and removed, as its message says: what is done stays.
  const std::string r = recording("rep-1");
  ASSERT_EQ(make_piece(shop(kAnswers, plan()), r).ended, Ended::kMade);
  (void)write_plan(plan(), {{r}, ""}, nothing_);
  EXPECT_EQ(merge(plan(), nullptr).made, 1U);
  fs::remove(dir_ / "campaign/plan.json");
  spit(dir_ / "campaign/pooled.json", "{}");
  EXPECT_EQ(write_plan(plan(), {{r}, ""}, nothing_), 1U);
  EXPECT_EQ(merge(plan(), nullptr).made, 1U);
}

TEST_F(Campaign, TasksShareAFolderWithEachOtherAndWithNobodyElse) {
  using Of = FolderLock::Of;
  const fs::path folder = dir_ / "campaign";
  {
    const FolderLock one(folder, Of::kTask), two(folder, Of::kTask), waiting(folder, Of::kCampaign);
    EXPECT_THAT([&] { const FolderLock maker(folder, Of::kMaker); },
                ThrowsMessage<PlanError>(HasSubstr("tasks of a job array make its pieces (process ")));
  }
  const FolderLock maker(folder, Of::kMaker);
  EXPECT_THAT([&] { const FolderLock task(folder, Of::kTask); },
              ThrowsMessage<PlanError>(HasSubstr("another `isorig campaign` works there")));
}

/// `acts` is done while a piece is made of `model`; nothing of the piece is left.
TEST_F(Campaign, APieceWhoseModelChangesMeanwhileIsNone) {
  const std::string r = recording("rep-1"), model = (dir_ / "model.toml").string();
  spit(model, "a");
  const Plan of = plan({"diagnose", model, 1});
  const auto refused = [&](const Workshop& w, const char* why) {
    EXPECT_THAT([&] { (void)make_piece(w, r); }, ThrowsMessage<InputsChanged>(HasSubstr(why)));
    EXPECT_TRUE(pieces_test::pieces_in(dir_ / "campaign").empty());
    EXPECT_EQ(failures_of(of, r), 0U) << "the recording has done nothing wrong";
  };
  refused(shop("printf b > '" + model + "'\n" + kAnswers, of), "the model was changed after pieces were begun");
  refused(shop("rm '" + model + "'; exit 1", of), "put the model back");
  spit(model, "a");
  refused(shop("printf b > '" + model + "'; printf a > '" + model + "'\n" + kAnswers, of),
          "was written to while pieces were made of it");
  const Workshop before = shop(kAnswers, of);
  const std::size_t called = calls();
  spit(model, "b");
  refused(before, "the model was changed after pieces were begun");
  EXPECT_EQ(calls(), called) << "it is seen before the work";
  // The tasks of an array begin when they are let: each looks whether it is still the model of the plan.
  (void)write_plan(of, {{r}, ""}, nothing_);
  const Plan planned = read_plan(of.folder);
  EXPECT_EQ(planned.model_sha256, sha256_of_file(model));
  EXPECT_EQ(make_piece(workshop_of(planned, script(kAnswers)), r).ended, Ended::kMade);
  spit(model, "c");
  EXPECT_THAT([&] { (void)workshop_of(planned, script(kAnswers)); },
              ThrowsMessage<PlanError>(HasSubstr("is another model than when the campaign in ")));
}

TEST_F(Campaign, AProgramThatIsReplacedMakesNoPiece) {
  const std::string r = recording("rep-1");
  const Workshop w = workshop_of(plan(), script(kAnswers));
  ASSERT_EQ(make_piece(w, r).ended, Ended::kMade);
  (void)script(std::string(kAnswers) + "\n# of the next version\n");
  EXPECT_THAT([&] { (void)make_piece(w, recording("rep-2")); },
              ThrowsMessage<InputsChanged>(HasSubstr("the program was replaced")));
}

/// As backups, package managers and profilers make them.
TEST_F(Campaign, AHardLinkToTheProgramReplacesNothing) {
  const Workshop w = workshop_of(plan(), script(kAnswers));
  std::filesystem::create_hard_link(w.program, dir_ / "linked");
  EXPECT_EQ(make_piece(w, recording("rep-1")).ended, Ended::kMade);
}

TEST_F(Campaign, PieceIsMadeOnceAndAgainWhenAnythingOfItChanges) {
  const std::string r = recording("lab/rep 1");
  const auto made = [&](const Workshop& w) { return make_piece(w, r).ended == Ended::kMade; };
  const Workshop w = shop(kAnswers, plan());
  EXPECT_TRUE(made(w));
  EXPECT_EQ(make_piece(w, r).ended, Ended::kDoneBefore);
  EXPECT_EQ(calls(), 1U);
  const auto piece = nlohmann::json::parse(slurp(piece_folder(w.plan, r) / "piece.json"));
  EXPECT_EQ(piece["row"]["verdict"], "missing_physics");
  EXPECT_EQ(piece["row"]["pressure_psi"], 15.0);
  EXPECT_EQ(piece["row"]["repetition"], 3);
  EXPECT_EQ(piece["stamp"]["files"][1]["sha256"], sha256_of_file(fs::path(r) / "frame.csv"));

  spit(fs::path(r) / "frame.csv", "t_s,position_mm,force_N\n0,0,1\n");  // as long as before
  EXPECT_TRUE(made(w)) << "a recording that was changed";
  fs::last_write_time(fs::path(r) / "frame.csv", fs::file_time_type::clock::now() + std::chrono::hours(1));
  EXPECT_FALSE(made(w)) << "a file that was copied again with the same bytes";
  spit(fs::path(r) / "pressure.csv", "t_s,pressure_psi\n0,0\n");
  EXPECT_TRUE(made(w)) << "a file more";
  EXPECT_TRUE(made(shop(kAnswers, plan({"diagnose", "slse2", 1})))) << "another model";
  EXPECT_FALSE(made(shop(kAnswers, plan({"diagnose", "slse2", 4})))) << "threads change no result";
  EXPECT_TRUE(made(shop(kAnswers, plan({"diagnose", "slse2", 1}, "isorig 2")))) << "another version";
  const fs::path model = dir_ / "model.toml";
  spit(model, "a");
  EXPECT_TRUE(made(shop(kAnswers, plan({"diagnose", model.string(), 1}))));
  spit(model, "b");
  EXPECT_TRUE(made(shop(kAnswers, plan({"diagnose", model.string(), 1})))) << "a model file that was changed";
  spit(piece_folder(w.plan, r) / "piece.json", "{");
  EXPECT_TRUE(made(shop(kAnswers, plan({"diagnose", model.string(), 1})))) << "a damaged piece";
}

TEST_F(Campaign, WhatWasMadeOfAnEarlierRecordingIsNotLeftWhenTheNewOneFails) {
  const std::string r = recording("rep-1");
  ASSERT_EQ(make_piece(shop(kAnswers, plan()), r).ended, Ended::kMade);
  spit(fs::path(r) / "frame.csv", "other\n");
  const Workshop bad = shop("echo told; echo half > diagnosis.json; kill -SEGV $$", plan());
  const Attempt attempt = make_piece(bad, r);
  EXPECT_EQ(attempt.ended, Ended::kFailed);
  EXPECT_THAT(attempt.words, HasSubstr("signal 11"));
  EXPECT_FALSE(fs::exists(piece_folder(bad.plan, r)));
  EXPECT_EQ(slurp(failed_folder(bad.plan, r) / "log.txt"), "told\n");
  EXPECT_FALSE(fs::exists(failed_folder(bad.plan, r) / "diagnosis.json"));
  EXPECT_EQ(failures_of(bad.plan, r), 1U);
  (void)make_piece(bad, r);
  EXPECT_EQ(failures_of(bad.plan, r), 2U);
  ASSERT_EQ(make_piece(shop(kAnswers, plan()), r).ended, Ended::kMade);
  EXPECT_EQ(failures_of(bad.plan, r), 0U);
  sweep(bad.plan);
  EXPECT_EQ(pieces_test::pieces_in(dir_ / "campaign").size(), 1U);
}

TEST_F(Campaign, ARecordingThatVanishesOrIsWrittenToFails) {
  const Attempt vanished = make_piece(shop(kAnswers, plan()), (dir_ / "gone").string());
  EXPECT_EQ(vanished.ended, Ended::kFailed);
  EXPECT_THAT(vanished.words, HasSubstr("no recording there"));
  EXPECT_EQ(failures_of(plan(), (dir_ / "gone").string()), 1U);
  const std::string r = recording("growing");
  const Attempt grown = make_piece(shop("echo 1,1,1 >> \"$2/frame.csv\"\n" + std::string(kAnswers), plan()), r);
  EXPECT_THAT(grown.words, HasSubstr("written to while it was read"));
  // As long as before, and with the time that it had (`cp -p`, rsync).
  const std::string put = recording("put");
  const Attempt replaced =
      make_piece(shop("touch -r \"$2/frame.csv\" then; printf 't_s,position_mm,force_N\\n0,0,1\\n' > \"$2/frame.csv\"; "
                      "touch -r then \"$2/frame.csv\"\n" +
                          std::string(kAnswers),
                      plan()),
                 put);
  EXPECT_THAT(replaced.words, HasSubstr("written to while it was read"));
}

TEST_F(Campaign, WhatWasMadeIsNoAnswerForARecordingThatIsGoneOrForAnotherModel) {
  const fs::path model = dir_ / "model.toml";
  spit(model, "a");
  const Plan of = plan({"diagnose", model.string(), 1});
  const std::string kept = recording("kept"), moved = recording("moved");
  for (const std::string& r : {kept, moved}) ASSERT_EQ(make_piece(shop(kAnswers, of), r).ended, Ended::kMade);
  (void)write_plan(of, {{kept, moved}, ""}, nothing_);
  EXPECT_EQ(merge(of, nullptr).made, 2U);
  fs::remove_all(moved);
  EXPECT_EQ(make_piece(shop(kAnswers, of), moved).ended, Ended::kFailed);
  const Standing without = merge(of, nullptr);
  EXPECT_EQ(without.made, 1U);
  EXPECT_EQ(without.failed, 1U);
  spit(model, "b");
  const Standing changed = merge(of, nullptr);
  EXPECT_EQ(changed.made, 0U);
  EXPECT_EQ(changed.waiting(), 1U);
}

TEST_F(Campaign, ABadRecordingIsAnAnswerAndNotRepeated) {
  const std::string r = recording("bad, \"quoted\"");
  const Workshop w = shop("echo frame.csv:2: not a number; exit 3", plan());
  EXPECT_EQ(make_piece(w, r).ended, Ended::kMade);
  EXPECT_EQ(make_piece(w, r).ended, Ended::kDoneBefore);
  (void)write_plan(plan(), {{r, (dir_ / "waiting").string()}, ""}, nothing_);
  const Standing s = merge(plan(), nullptr);
  EXPECT_EQ(s.recordings, 2U);
  EXPECT_EQ(s.made, 1U);
  EXPECT_EQ(s.bad, 1U);
  EXPECT_EQ(s.waiting(), 1U);
  const std::string csv = slurp(dir_ / "campaign/campaign.csv");
  EXPECT_THAT(csv, HasSubstr("/bad, \"\"quoted\"\"\",s,15,3,bad_recording,,bad_recording,3,,pieces/"));
  const auto json = nlohmann::json::parse(slurp(dir_ / "campaign/campaign.json"));
  EXPECT_EQ(json["recordings"].size(), 2U);
  EXPECT_EQ(json["recordings"][1]["state"], "waiting");
}

TEST_F(Campaign, TheTablesPageLeadsToEachPiecesPage) {
  const std::string r = recording("rep#1");
  const Workshop w = shop(std::string(kAnswers) + "; echo page > diagnosis-report.html", plan());
  ASSERT_EQ(make_piece(w, r).ended, Ended::kMade);
  (void)write_plan(plan(), {{r}, ""}, nothing_);
  const identify::report::Made made;
  EXPECT_EQ(merge(plan(), &made).verdicts.at("missing_physics"), 1U);
  const std::string page = slurp(dir_ / "campaign/campaign-report.html");
  const std::string href =
      piece_folder(w.plan, r).lexically_relative(dir_ / "campaign").string() + "/diagnosis-report.html";
  EXPECT_THAT(page, HasSubstr("\"hrefs\":[[\"" + href + "\"]]"));
  EXPECT_THAT(page, HasSubstr("slack 0.97"));
}

/// What failed before its command began has no log to lead to.
TEST_F(Campaign, ThePageOfARecordingThatIsGoneLeadsToWhatIsThere) {
  const std::string gone = (dir_ / "gone").string();
  ASSERT_EQ(make_piece(shop(kAnswers, plan()), gone).ended, Ended::kFailed);
  (void)write_plan(plan(), {{gone}, ""}, nothing_);
  const identify::report::Made made;
  EXPECT_EQ(merge(plan(), &made).failed, 1U);
  const std::string page = slurp(dir_ / "campaign/campaign-report.html");
  const std::string folder = failed_folder(plan(), gone).lexically_relative(dir_ / "campaign").string();
  EXPECT_THAT(page, HasSubstr("\"hrefs\":[[\"" + folder + "/failure.json\"]]"));
}

}  // namespace
}  // namespace isorig::cli::pieces
