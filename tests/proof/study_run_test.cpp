// `isorig-proof run` and `score` as a user calls them, with a script that stands in for isorig.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "../system/processes.hpp"
#include "../system/processes_with.hpp"
#include "tiny_study.hpp"

namespace isorig {
namespace {

namespace fs = std::filesystem;
using proof_test::lines_of;
using system_test::bin;
using system_test::Process;
using system_test::processes_with;
using system_test::slurp;
using system_test::spit;
using system_test::wait_until;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

class StudyRun : public testing::Test {
 protected:
  static constexpr unsigned kCases = 4;
  void SetUp() override {
    proof_test::write_study(study_, kCases);
    proof_test::write_program(program_, "0.95");
  }

  [[nodiscard]] std::vector<std::string> words(const std::string& results, std::vector<std::string> more = {}) const {
    std::vector<std::string> out{bin("isorig-proof"),       "run",      study_.string(),  "--results",
                                 (dir_ / results).string(), "--isorig", program_.string()};
    out.insert(out.end(), more.begin(), more.end());
    return out;
  }
  system_test::Answer run(const std::string& results, std::vector<std::string> more = {}) const {
    return system_test::run(dir_, words(results, std::move(more)));
  }
  [[nodiscard]] system_test::Answer score(const std::string& results) const {
    return system_test::run(dir_, {bin("isorig-proof"), "score", study_.string(), "--results",
                                   (dir_ / results).string(), "--no-baselines"});
  }
  /// How many diagnoses there were since the last call of this.
  std::size_t diagnosed() {
    const std::size_t all = lines_of(dir_ / "diagnosed").size();
    return all - std::exchange(seen_, all);
  }
  [[nodiscard]] fs::path piece(const std::string& results, unsigned number) const {
    return dir_ / results / proof_test::case_name(number);
  }
  /// While this file is there a diagnosis of that case does not end.
  [[nodiscard]] fs::path hold(unsigned number) const { return dir_ / ("hold-" + proof_test::case_name(number)); }
  static constexpr const char* kHolds = R"sh(hold=$(dirname "$0")/hold-$(basename "$(dirname "$recording")")
while [ -e "$hold" ]; do
  touch "$hold-begun"
  sleep 0.02
done)sh";
  /// It has begun, and has told `diagnosed` that it has.
  [[nodiscard]] bool is_held(unsigned number) const { return fs::exists(hold(number).string() + "-begun"); }
  [[nodiscard]] std::vector<pid_t> at_work(unsigned number) const {
    return processes_with("diagnose " + (study_ / proof_test::case_name(number) / "train").string());
  }

  /// All that a study's answers are, without what they took: the merged tables, the files of each case, the score.
  [[nodiscard]] std::map<std::string, std::string> answers(const std::string& results) const {
    std::map<std::string, std::string> out;
    for (const char* file : {"campaign.csv", "campaign.json", "plan.txt", "plan.json", "labels.sha256"})
      out[file] = slurp(dir_ / results / file);
    for (unsigned i = 0; i < kCases; ++i)
      for (const char* file : {"piece.json", "diagnosis.json", "nominal.csv", "model.csv", "log.txt"})
        out[proof_test::case_name(i) + "/" + file] = slurp(piece(results, i) / file);
    const auto scored = score(results);
    EXPECT_EQ(scored.code, 0) << scored.text;
    auto json = nlohmann::json::parse(slurp(dir_ / results / "score.json"));
    for (const char* key : {"wall_s_median", "wall_s_most", "cpu_s_median", "cpu_s_most"}) {
      EXPECT_TRUE(json["methods"][0][key].is_number()) << key;
      json["methods"][0].erase(key);
    }
    out["score.json"] = json.dump();
    return out;
  }

  system_test::TempDir dir_;
  fs::path study_ = dir_ / "study", program_ = dir_ / "isorig";
  std::size_t seen_ = 0;
};

TEST_F(StudyRun, InterruptedAndGoneOnWithGivesTheTablesOfAnUninterruptedRun) {
  proof_test::write_program(program_, "0.95", kHolds);
  const auto whole = run("whole", {"-j", "2"});
  ASSERT_EQ(whole.code, 0) << whole.text;
  EXPECT_THAT(whole.text, HasSubstr("4 of 4 cases answered"));
  EXPECT_EQ(diagnosed(), 4U);
  {
    spit(hold(1), "");
    Process first(words("again", {"-j", "1"}), dir_ / "first.txt");
    ASSERT_TRUE(wait_until(60.0, [&] { return fs::exists(piece("again", 0)) && is_held(1); })) << first.output();
    EXPECT_THAT(run("again").text, HasSubstr("another `isorig-proof` works there"));
    EXPECT_EQ(first.stop(SIGINT), -SIGINT) << first.output();
    EXPECT_THAT(first.output(), HasSubstr("1 of 4 cases answered; 3 not run yet"));
    EXPECT_THAT(first.output(), HasSubstr("the same command goes on"));
    EXPECT_TRUE(wait_until(5.0, [&] { return at_work(1).empty(); })) << "a child outlived it";
    fs::remove(hold(1));
  }
  EXPECT_EQ(diagnosed(), 2U);
  const auto part = score("again");
  EXPECT_THAT(part.text, HasSubstr("3 of 4 cases were not run yet"));
  const auto written = fs::last_write_time(piece("again", 0) / "run.json");
  const auto second = run("again", {"-j", "2", "--threads", "3"});
  ASSERT_EQ(second.code, 0) << second.text;
  EXPECT_EQ(diagnosed(), 3U) << "what was finished was run again";
  EXPECT_EQ(fs::last_write_time(piece("again", 0) / "run.json"), written);
  for (const auto& entry : fs::directory_iterator(dir_ / "again"))
    EXPECT_FALSE(entry.path().filename().string().starts_with(".")) << entry.path() << " was left";
  auto expected = answers("whole"), found = answers("again");
  // Threads change no result, and the plan says how many there are.
  for (auto* one : {&expected, &found}) one->erase("plan.json");
  for (const auto& [file, bytes] : expected) EXPECT_EQ(found[file], bytes) << file;
}

TEST_F(StudyRun, AKilledCaseIsRepeatedAndCostsThatCaseAlone) {
  proof_test::write_program(program_, "0.95", kHolds);
  spit(hold(1), "");
  Process process(words("out", {"-j", "2"}), dir_ / "out.txt");
  ASSERT_TRUE(wait_until(60.0, [&] { return is_held(1); })) << process.output();
  const auto diagnosis = at_work(1);
  const auto victim = processes_with("isorig-proof case " + (study_ / "case-001").string());
  ASSERT_THAT(victim, SizeIs(1));
  ASSERT_THAT(diagnosis, SizeIs(1));
  ::kill(victim.front(), SIGKILL);
  EXPECT_TRUE(wait_until(10.0, [&] { return std::ranges::count(at_work(1), diagnosis.front()) == 0; }))
      << "its diagnosis outlived it";
  fs::remove(hold(1));
  EXPECT_EQ(process.wait(60.0), 0) << process.output();
  EXPECT_THAT(process.output(), HasSubstr("4 of 4 cases answered\n"));
  EXPECT_EQ(diagnosed(), 5U);
  ASSERT_EQ(run("whole").code, 0);
  auto expected = answers("whole"), found = answers("out");
  for (const auto& [file, bytes] : expected) EXPECT_EQ(found[file], bytes) << file;
}

TEST_F(StudyRun, ACaseThatFailsIsRepeatedOnceListedAndCountsInTheScore) {
  proof_test::write_program(program_, "0.95", R"(case $recording in *case-001*) echo no memory; exit 9 ;; esac)");
  const auto first = run("out");
  EXPECT_EQ(first.code, 0) << "what failed is for the score to count: " << first.text;
  EXPECT_EQ(diagnosed(), 5U) << "four cases, and one of them once more";
  EXPECT_THAT(first.text, HasSubstr("3 of 4 cases answered; 1 failed"));
  EXPECT_THAT(first.text, HasSubstr("failed: " + (study_ / "case-001").string() + ": see " +
                                    (dir_ / "out/failed/case-001").string()));
  EXPECT_THAT(slurp(dir_ / "out/failed/case-001/log.txt"), HasSubstr("no memory\ndiagnose ended with exit code 9"));
  EXPECT_EQ(score("out").code, 0);
  const auto json = nlohmann::json::parse(slurp(dir_ / "out/score.json"))["methods"][0];
  EXPECT_EQ(json["failed"]["hits"], 1);
  EXPECT_EQ(json["heldout_worse"]["hits"], 1);
  EXPECT_THAT(score("out").text, HasSubstr("diagnose ended with exit code 9"));
  EXPECT_EQ(run("out", {"--retries", "0"}).code, 0);
  EXPECT_EQ(diagnosed(), 1U) << "a later call tries again what failed, and nothing else";
  proof_test::write_program(program_, "0.95");
  EXPECT_THAT(run("out").text, HasSubstr("4 of 4 cases answered\n"));
  EXPECT_FALSE(fs::exists(dir_ / "out/failed/case-001"));
}

TEST_F(StudyRun, WhatChangedIsRunAgainAndNothingElse) {
  ASSERT_EQ(run("out").code, 0);
  ASSERT_EQ(diagnosed(), 4U);
  EXPECT_THAT(lines_of(dir_ / "diagnosed")[1], HasSubstr("case-001/train slse2"));
  ASSERT_EQ(run("out", {"-j", "3", "--threads", "4", "--retries", "2"}).code, 0);
  EXPECT_EQ(diagnosed(), 0U) << "none of these decides a result";

  // What was not recorded otherwise, at another time and not.
  const fs::path heldout = study_ / "case-002/heldout/frame.csv";
  spit(heldout, slurp(heldout));
  fs::last_write_time(heldout, fs::last_write_time(heldout) + std::chrono::seconds(3));
  ASSERT_EQ(run("out").code, 0);
  EXPECT_EQ(diagnosed(), 0U);
  spit(heldout, slurp(study_ / "case-002/train/frame.csv") + "0.3,3,6\n");
  ASSERT_EQ(run("out").code, 0) << "its prediction has another length, which is for the score";
  EXPECT_EQ(diagnosed(), 1U);

  const auto other = run("out", {"--decide", "cost_nats=6", "most_rows=8"});
  ASSERT_EQ(other.code, 0) << other.text;
  EXPECT_EQ(diagnosed(), 4U) << "other options";
  EXPECT_THAT(lines_of(dir_ / "calls"), testing::Contains(HasSubstr("--decide cost_nats=6 --decide most_rows=8")));
  ASSERT_EQ(run("out", {"--decide", "cost_nats=6", "--decide", "most_rows=8"}).code, 0);
  EXPECT_EQ(diagnosed(), 0U);
  ASSERT_EQ(run("out").code, 0);
  EXPECT_EQ(diagnosed(), 4U) << "the stated numbers again";

  proof_test::write_program(program_, "0.5");
  ASSERT_EQ(run("out").code, 0);
  EXPECT_EQ(diagnosed(), 4U) << "another program";
  EXPECT_THAT(slurp(piece("out", 3) / "diagnosis.json"), HasSubstr("0.5"));
}

/// Results of two programs in one table would be of neither.
TEST_F(StudyRun, ScoreTakesNoAnswerOfAnotherProgram) {
  ASSERT_EQ(run("out").code, 0);
  proof_test::write_program(program_, "0.5", kHolds);
  spit(hold(1), "");
  Process second(words("out", {"-j", "1"}), dir_ / "second.txt");
  ASSERT_TRUE(wait_until(60.0, [&] { return is_held(1); })) << second.output();
  EXPECT_EQ(second.stop(SIGINT), -SIGINT);
  const auto scored = score("out");
  EXPECT_THAT(scored.text, HasSubstr("3 of 4 cases were not run yet, and count as failed"));
  EXPECT_THAT(slurp(dir_ / "out/campaign.csv"), HasSubstr("slack 0.50"));
  EXPECT_THAT(slurp(dir_ / "out/campaign.csv"), Not(HasSubstr("slack 0.95")));
  EXPECT_EQ(nlohmann::json::parse(slurp(dir_ / "out/score.json"))["methods"][0]["failed"]["hits"], 3);
}

/// A program that is installed anew meanwhile ends the run instead of mixing.
TEST_F(StudyRun, AProgramThatIsReplacedMeanwhileEndsTheRun) {
  proof_test::write_program(program_, "0.95", kHolds);
  spit(hold(1), "");
  Process process(words("out", {"-j", "1"}), dir_ / "out.txt");
  ASSERT_TRUE(wait_until(60.0, [&] { return is_held(1); })) << process.output();
  proof_test::write_program(dir_ / "new", "0.5");
  fs::rename(dir_ / "new", program_);
  fs::remove(hold(1));
  EXPECT_EQ(process.wait(60.0), 1) << process.output();
  EXPECT_THAT(process.output(), HasSubstr(program_.string() + ": the program was replaced"));
  EXPECT_THAT(process.output(), HasSubstr("1 of 4 cases answered; 3 not run yet"));
}

/// What `--on slurm` submits is tasks of this program; campaign_slurm_test has a cluster for them.
TEST_F(StudyRun, ATaskOfAnArrayRunsItsShareAndRefusesAnotherProgram) {
  ASSERT_EQ(run("out").code, 0);
  for (const unsigned i : {0U, 1U, 2U}) fs::remove_all(piece("out", i));
  ASSERT_EQ(diagnosed(), 4U);
  const auto task = [&](const char* number) {
    return system_test::run(dir_, {bin("isorig-proof"), "campaign-pieces", (dir_ / "out").string(), "--list",
                                   (dir_ / "out/plan.txt").string(), "--task", number, "--of", "2"});
  };
  const auto even = task("0");
  EXPECT_EQ(even.code, 0) << even.text;
  EXPECT_THAT(lines_of(dir_ / "diagnosed"), SizeIs(6)) << "cases 0 and 2";
  EXPECT_FALSE(fs::exists(piece("out", 1)));
  proof_test::write_program(program_, "0.5");
  const auto other = task("1");
  EXPECT_EQ(other.code, 1);
  EXPECT_THAT(other.text, HasSubstr("install the same on every node"));
  EXPECT_EQ(diagnosed(), 2U);
}

TEST_F(StudyRun, NothingThatIsAskedIsToldWhatWasConcealed) {
  fs::rename(study_ / "sealed", dir_ / "taken-away");
  ASSERT_EQ(run("out").code, 0);
  EXPECT_EQ(diagnosed(), 4U);
  EXPECT_THAT(lines_of(dir_ / "calls"), Each(Not(testing::AnyOf(HasSubstr("sealed"), HasSubstr("labels")))));
  for (const char* file : {"out/plan.json", "out/plan.txt", "out/campaign.json"})
    EXPECT_THAT(slurp(dir_ / file), Not(HasSubstr("sealed"))) << file;
}

TEST_F(StudyRun, ResultsReplaceNoCases) {
  const auto refused = run("study");
  EXPECT_EQ(refused.code, 1);
  EXPECT_THAT(refused.text, HasSubstr("the cases themselves lie there"));
  EXPECT_TRUE(fs::exists(study_ / "case-000/train/frame.csv"));
  EXPECT_EQ(diagnosed(), 0U);
}

TEST_F(StudyRun, PracticeCasesGoOnAsWell) {
  spit(dir_ / "own.toml", "a nominal model of their own\n");
  nlohmann::json labels;
  for (unsigned i = 0; i < kCases; ++i)
    labels[proof_test::case_name(i)] = {
        {"effects", {"slack"}}, {"nominal", i == 0 ? (dir_ / "own.toml").string() : "slse1"}, {"noise_N", 0.01}};
  spit(dir_ / "labels.json", labels.dump());
  const auto practice = [&] {
    return system_test::run(
        dir_, {bin("isorig-proof"), "score-practice", "--cases", study_.string(), "--labels",
               (dir_ / "labels.json").string(), "--out", (dir_ / "out").string(), "--isorig", program_.string()});
  };
  const auto first = practice();
  ASSERT_EQ(first.code, 0) << first.text;
  EXPECT_EQ(diagnosed(), 4U);
  EXPECT_THAT(lines_of(dir_ / "diagnosed")[0], HasSubstr("case-000/train " + (dir_ / "own.toml").string()));
  EXPECT_THAT(slurp(dir_ / "out/cases.json"), Not(HasSubstr("slack")));
  ASSERT_EQ(practice().code, 0);
  EXPECT_EQ(diagnosed(), 0U);
  spit(dir_ / "own.toml", "another one\n");
  ASSERT_EQ(practice().code, 0);
  EXPECT_EQ(diagnosed(), 4U) << "the list of the nominal models is another one";
}

TEST(StudyGenerate, InterruptedAndGoneOnWithGivesTheBytesOfAnUninterruptedCall) {
  const system_test::TempDir dir;
  const auto words = [&](const std::string& out, const std::vector<std::string>& more) {
    std::vector<std::string> all{bin("isorig-proof"),  "generate", "--cases", "2", "--out",
                                 (dir / out).string(), "-j",       "1"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  };
  {
    Process first(words("part", {}), dir / "first.txt");
    ASSERT_TRUE(wait_until(120.0, [&] { return fs::exists(dir / "part/sealed/unfinished/0.json"); })) << first.output();
    first.stop(SIGKILL);
  }
  ASSERT_FALSE(fs::exists(dir / "part/cases.json")) << "it had ended before";
  const auto written = fs::last_write_time(dir / "part/case-000/train/frame.csv");
  const auto second = system_test::run(dir, words("part", {}), 120.0);
  ASSERT_EQ(second.code, 0) << second.text;
  EXPECT_EQ(fs::last_write_time(dir / "part/case-000/train/frame.csv"), written) << "made again";
  EXPECT_FALSE(fs::exists(dir / "part/sealed/unfinished"));

  const auto seed = nlohmann::json::parse(slurp(dir / "part/sealed/labels.json"))["seed"].get<std::uint64_t>();
  ASSERT_EQ(system_test::run(dir, words("whole", {"--seed", std::to_string(seed)}), 120.0).code, 0);
  std::size_t files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(dir / "whole")) {
    if (!entry.is_regular_file()) continue;
    const auto name = entry.path().lexically_relative(dir / "whole");
    EXPECT_EQ(slurp(entry.path()), slurp(dir / "part" / name.string())) << name;
    ++files;
  }
  EXPECT_GE(files, 3U + 2U + 2U * 2U * 2U) << "lists, truth, recordings";
}

/// `score` holds a case's series only while it counts that case. Each noise-free force here is 0.4 MB of numbers: 72
/// cases more would be 28.8 MB more, were they kept; labels and outcomes of 72 cases are some 0.2 MB.
TEST(StudyScore, MemoryDoesNotGrowWithTheSeriesOfTheStudy) {
  constexpr std::size_t kRows = 50'000;
  constexpr unsigned kFew = 8, kMany = 80;
  const system_test::TempDir dir;
  std::string series = "t_s,force_N\n";
  for (std::size_t k = 0; k < kRows; ++k) series += base::formatted("%zu,%zu\n", k, k % 7);
  spit(dir / "series.csv", series);
  const auto peak_MB = [&](unsigned cases) {
    const fs::path study = dir / std::to_string(cases);
    nlohmann::json labels = nlohmann::json::array();
    for (unsigned i = 0; i < cases; ++i) {
      const std::string name = proof_test::case_name(i);
      labels.push_back({{"case", name},
                        {"category", "null"},
                        {"nominal", "slse1"},
                        {"trap", "none"},
                        {"noise_N", 0.01},
                        {"residual_over_noise", 0.0},
                        {"truth_sha256", proof::sha256(series)},
                        {"effects", nlohmann::json::array()}});
      const fs::path results = study / "results" / name;
      proof::write_text(results / "run.json", R"({"exit_code": 0, "wall_s": 1.5, "cpu_s": 2.5})");
      proof::write_text(results / "diagnosis.json", R"({"verdict": "consistent", "missing": []})");
      fs::create_directories(study / "sealed/truth");
      for (const fs::path& file :
           {results / "nominal.csv", results / "model.csv", study / "sealed/truth" / (name + ".csv")})
        fs::create_hard_link(dir / "series.csv", file);
    }
    proof::seal(study / "sealed/labels.json", study / "labels.sha256", nlohmann::json{{"cases", labels}}.dump());
    fs::copy_file(study / "labels.sha256", study / "results/labels.sha256");
    Process scored({bin("isorig-proof"), "score", study.string(), "--no-baselines"}, dir / "score.txt");
    EXPECT_EQ(scored.wait(120.0), 0) << scored.output();
    EXPECT_THAT(scored.output(), HasSubstr(base::formatted("0/%u", cases)));
    return scored.peak_MB();
  };
  const double few_MB = peak_MB(kFew), many_MB = peak_MB(kMany);
  // Half of what keeping them would cost: an allocator keeps some of what it is given back.
  EXPECT_LT(many_MB - few_MB, 0.5 * (kMany - kFew) * 8e-6 * kRows) << few_MB << " MB, " << many_MB << " MB";
}

}  // namespace
}  // namespace isorig
