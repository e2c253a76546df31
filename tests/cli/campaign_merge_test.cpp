#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <atomic>

#include "campaign_of_scripts.hpp"
#include "cli/campaign/local.hpp"
#include "cli/campaign/row.hpp"
#include "cli/campaign/runner.hpp"
#include "page_links.hpp"

/// What a campaign's tables and page say, and when they are written.
namespace isorig::cli::pieces {
namespace {

namespace fs = std::filesystem;
using pieces_test::block_of;
using pieces_test::broken_links;
using pieces_test::links_in;
using pieces_test::page_data;
using system_test::slurp;
using system_test::spit;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

using nlohmann::json;

/// The keys that a pool reads, as `isorig diagnose` writes them; `id`: of the readings.
json diagnosis(const json& recording) {
  json spring{{"part", "spring"}, {"number", "stiffness_N_mm"}, {"value", 2.0}, {"ci95", {1.9, 2.1}}};
  return {{"format", "isorig-diagnosis/1"},
          {"verdict", "consistent"},
          {"cannot_judge", nullptr},
          {"missing", json::array()},
          {"not_modelled", nullptr},
          {"tried", {{{"explanation", "nominal"}, {"weight", 0.9}}}},
          {"discernible", json::array()},
          {"recordings", {recording}},
          {"fit", {{"model", {{"numbers", {spring}}}}, {"nominal", {{"numbers", {spring}}}}}}};
}

class CampaignTables : public Campaign {
 protected:
  /// Answers with the file that lies beside the readings.
  static constexpr const char* kAnswersFromFile =
      R"(cp "$2/answer.json" diagnosis.json || exit 3; echo page > diagnosis-report.html)";

  /// Control1 at 10 psi, with a diagnosis of its own.
  [[nodiscard]] std::string diagnosed(const std::string& name, int id, const json& named) const {
    const std::string out = recording(name);
    json of = named;
    of["id"] = id;
    spit(fs::path(out) / "answer.json", diagnosis(of).dump());
    return out;
  }
  [[nodiscard]] static json place(const char* specimen, double pressure_psi) {
    return {{"specimen", specimen}, {"nominal_pressure_psi", pressure_psi}};
  }
  [[nodiscard]] std::map<std::string, std::string> results() const {
    std::map<std::string, std::string> out;
    for (const char* file : {"campaign.csv", "campaign.json", "pooled.json", "campaign-report.html"})
      out[file] = slurp(dir_ / "campaign" / file);
    return out;
  }
  [[nodiscard]] json pooled() const { return json::parse(slurp(dir_ / "campaign/pooled.json")); }
  [[nodiscard]] fs::path page() const { return dir_ / "campaign/campaign-report.html"; }
  [[nodiscard]] CampaignCall call(const std::vector<std::string>& recordings, const std::string& acts) const {
    CampaignCall out;
    out.plan = plan();
    out.named = {recordings, ""};
    out.program = script(acts);
    return out;
  }
  const identify::report::Made made_;
};

TEST_F(CampaignTables, AMergeThatIsStoppedLeavesTheTablesAsTheyWere) {
  std::vector<std::string> recordings;
  for (int i = 0; i < 300; ++i) recordings.push_back((dir_ / ("waiting-" + std::to_string(i))).string());
  recordings[7] = diagnosed("rep-1", 1, place("Control1", 10));
  (void)write_plan(plan(), {recordings, ""}, nothing_);
  std::vector<double> told;
  const auto tell = [&](double fraction, const std::string&) { told.push_back(fraction); };
  EXPECT_FALSE(merge(plan(), &made_, {{}, tell}).stopped);
  EXPECT_EQ(told.size(), 5U) << "after every 64 of 300 recordings";
  EXPECT_TRUE(std::ranges::is_sorted(told));
  EXPECT_EQ(told.front(), 0.0);
  EXPECT_GT(told.back(), 0.3);
  EXPECT_LT(told.back(), 0.5) << "half of it is for the pool";
  const auto before = results();

  ASSERT_EQ(make_piece(shop(kAnswersFromFile, plan()), recordings[7]).ended, Ended::kMade);
  int asked = 0;
  const Standing stopped = merge(plan(), &made_, {[&] { return ++asked == 3; }, {}});
  EXPECT_TRUE(stopped.stopped);
  EXPECT_EQ(asked, 3);
  EXPECT_EQ(stopped.recordings, 128U) << "at once";
  EXPECT_EQ(results(), before);
  for (const auto& entry : fs::directory_iterator(dir_ / "campaign"))
    EXPECT_NE(entry.path().extension(), ".part") << entry.path();
  EXPECT_EQ(merge(plan(), &made_).made, 1U);
  EXPECT_NE(results(), before);
}

/// In the pool, too, which takes longer than the table of up to 10,000 diagnoses.
TEST_F(CampaignTables, APoolThatIsStoppedLeavesThePageOfBefore) {
  const std::vector<std::string> recordings{diagnosed("rep-1", 1, place("Control1", 10)),
                                            diagnosed("rep-2", 2, place("Control1", 10)),
                                            diagnosed("rep-3", 3, place("Control1", 20))};
  (void)write_plan(plan(), {recordings, ""}, nothing_);
  const Workshop w = shop(kAnswersFromFile, plan());
  for (std::size_t i : {0U, 1U}) ASSERT_EQ(make_piece(w, recordings[i]).ended, Ended::kMade);
  (void)merge(plan(), &made_);
  const auto before = results();
  ASSERT_EQ(make_piece(w, recordings[2]).ended, Ended::kMade);
  std::atomic<bool> pooling = false;
  const Standing stopped = merge(plan(), &made_,
                                 {[&] { return pooling.load(); },
                                  [&](double fraction, const std::string& doing) {
                                    if (fraction >= 0.5) pooling = doing == "pooling the diagnoses";
                                  }});
  EXPECT_TRUE(stopped.stopped);
  const auto after = results();
  EXPECT_EQ(after.at("pooled.json"), before.at("pooled.json"));
  EXPECT_EQ(after.at("campaign-report.html"), before.at("campaign-report.html"));
}

/// What peeks at a signal leaves it to the loop that ends the pieces.
TEST_F(CampaignTables, ASignalThatComesWhileTablesAreWrittenEndsThePieces) {
  const std::vector<std::string> recordings{recording("rep-1"), recording("rep-2")};
  (void)write_plan(plan(), {recordings, ""}, nothing_);
  const Signals signals;
  EXPECT_FALSE(signals.came());
  int came = 0;
  const Done done =
      make_pieces(shop("exec sleep 60", plan()), recordings_of(plan()), {}, 1, signals, {}, [&](const Done& now) {
        if (now.stopped_by != 0 || came > 0) return;
        ::kill(::getpid(), SIGINT);
        came += signals.came() ? 1 : 0;
      });
  EXPECT_EQ(came, 1);
  EXPECT_EQ(done.stopped_by, SIGINT);
  EXPECT_EQ(done.ended, 0U);
  EXPECT_EQ(calls(), 1U) << "no further piece was begun";
  EXPECT_FALSE(signals.came());
}

/// The last merge takes as long as the pool does.
TEST_F(CampaignTables, ASignalEndsTheLastMerge) {
  const std::vector<std::string> recordings{diagnosed("rep-1", 1, place("Control1", 10)),
                                            diagnosed("rep-2", 2, place("Control1", 10))};
  const CampaignCall all = call(recordings, kAnswersFromFile);
  EXPECT_EQ(run_campaign(all, nothing_).standing.made, 2U);
  fs::remove(dir_ / "campaign/campaign.csv");
  const Signals held;  // else it would end this test
  ::kill(::getpid(), SIGINT);
  const CampaignEnd end = run_campaign(all, nothing_);
  EXPECT_EQ(end.stopped_by, SIGINT);
  EXPECT_TRUE(end.standing.stopped);
  EXPECT_FALSE(fs::exists(dir_ / "campaign/campaign.csv"));
  EXPECT_FALSE(held.came()) << "it would end whoever called";
  EXPECT_FALSE(run_campaign(all, nothing_).standing.stopped);
  EXPECT_TRUE(fs::exists(dir_ / "campaign/campaign.csv"));
}

TEST_F(CampaignTables, ReadingALongListSaysHowFarItIs) {
  std::string list;
  for (int i = 0; i < 1000; ++i) list += "/lab/recording-" + std::to_string(1000 + i) + "\n";
  spit(dir_ / "list.txt", list);
  std::vector<double> told;
  std::string last;
  (void)write_plan(plan(), {{}, (dir_ / "list.txt").string()}, nothing_,
                   [&](double fraction, const std::string& doing) {
                     told.push_back(fraction);
                     last = doing;
                   });
  EXPECT_THAT(told, ElementsAre(0.0, 0.256, 0.512, 0.768)) << "lines of one length, every 256th";
  EXPECT_EQ(last, "reading the list: 768");
}

/// While a campaign runs its table is written anew; the page and what it links to wait for the end.
TEST_F(CampaignTables, AnInterimMergeHasTheTableAndLeavesPageAndPool) {
  const std::vector<std::string> recordings{diagnosed("rep-1", 1, place("Control1", 10)),
                                            diagnosed("rep-2", 2, place("Control1", 10)),
                                            diagnosed("rep-3", 3, place("Control1", 20)), (dir_ / "gone").string()};
  (void)write_plan(plan(), {recordings, ""}, nothing_);
  const Workshop w = shop(kAnswersFromFile, plan());
  for (std::size_t i : {0U, 1U}) ASSERT_EQ(make_piece(w, recordings[i]).ended, Ended::kMade);
  (void)merge(plan(), &made_);
  EXPECT_EQ(pooled()["recordings"].size(), 2U);
  const auto before = results();

  ASSERT_EQ(make_piece(w, recordings[2]).ended, Ended::kMade);
  ASSERT_EQ(make_piece(w, recordings[3]).ended, Ended::kFailed);
  const Standing interim = merge(plan(), nullptr);
  EXPECT_EQ(interim.made, 3U);
  EXPECT_EQ(interim.failed, 1U);
  const auto table = json::parse(slurp(dir_ / "campaign/campaign.json"));
  EXPECT_EQ(table["recordings"][2]["state"], "made");
  EXPECT_EQ(table["recordings"][2]["verdict"], "consistent");
  EXPECT_EQ(table["recordings"][3]["state"], "failed");
  const std::string csv = slurp(dir_ / "campaign/campaign.csv");
  EXPECT_EQ(std::ranges::count(csv, '\n'), 5);
  EXPECT_THAT(csv, HasSubstr(recordings[2] + ",s,15,3,consistent,,made,0,,pieces/"));
  EXPECT_EQ(results().at("pooled.json"), before.at("pooled.json"));
  EXPECT_EQ(results().at("campaign-report.html"), before.at("campaign-report.html"));
  EXPECT_THAT(links_in(page_data(page())), Contains("pooled.json"));
  EXPECT_THAT(broken_links(page()), IsEmpty());

  (void)merge(plan(), &made_);
  EXPECT_EQ(pooled()["recordings"].size(), 3U);
  // Nothing is left to pool: neither file nor link.
  fs::remove_all(dir_ / "campaign/pieces");
  (void)merge(plan(), &made_);
  EXPECT_FALSE(fs::exists(dir_ / "campaign/pooled.json"));
  EXPECT_THAT(links_in(page_data(page())), Not(Contains("pooled.json")));
}

/// A recording without a pressure, or a copy, costs that recording alone.
TEST_F(CampaignTables, WhatCannotBePooledIsLeftOutByName) {
  json nowhere{{"specimen", "Control1"}};
  const std::vector<std::string> recordings{diagnosed("a/rep-1", 1, place("Control1", 10)),
                                            diagnosed("a/rep-2", 2, place("Control1", 20)),
                                            diagnosed("b/nowhere", 3, nowhere),
                                            diagnosed("b/copy", 1, place("Control1", 10)),
                                            diagnosed("c/one", 5, place("Control1", 10)),
                                            diagnosed("c/other", 5, place("Control2", 10))};
  (void)write_plan(plan(), {recordings, ""}, nothing_);
  for (const std::string& r : recordings) ASSERT_EQ(make_piece(shop(kAnswersFromFile, plan()), r).ended, Ended::kMade);
  const Standing s = merge(plan(), &made_);
  const json together = pooled();
  EXPECT_EQ(together["recordings"].size(), 2U);
  std::map<std::string, std::string> why;
  for (const json& one : together["left_out"]) {
    why[one["recording"]] = one["why"];
    EXPECT_TRUE(fs::exists(dir_ / "campaign" / one["folder"].get<std::string>() / "diagnosis.json")) << one;
  }
  ASSERT_EQ(why.size(), 4U) << together["left_out"];
  EXPECT_THAT(why.at("b/nowhere"), HasSubstr("names no pressure; add `nominal_pressure_psi`"));
  EXPECT_THAT(why.at("b/copy"), HasSubstr("is of the same recording as a/rep-1; its numbers would count twice"));
  for (const char* one : {"c/one", "c/other"}) EXPECT_THAT(why.at(one), HasSubstr("which of them is right")) << one;
  EXPECT_THAT(slurp(dir_ / "campaign/pooled.json"), Not(HasSubstr(dir_.path().string()))) << "a path of this place";
  EXPECT_THAT(s.findings, Contains(HasSubstr("In no pool: 4 recordings")));
  const json table = block_of(page_data(page()), "table", "recording that is left out");
  ASSERT_FALSE(table.is_null());
  EXPECT_EQ(table["rows"].size(), 4U);
  EXPECT_THAT(table.dump(), AllOf(HasSubstr("b/nowhere"), HasSubstr("diagnosis-report.html")));
  EXPECT_THAT(broken_links(page()), IsEmpty());
}

/// Marks of the grid by what is said of them.
std::map<std::string, std::string> cells_of(const json& grid) {
  std::map<std::string, std::string> out;
  for (const json& row : grid.at("rows"))
    for (const json& places : row.at("cells"))
      for (const json& cell : places) out[cell.at("title")] = cell.at("text");
  return out;
}

TEST_F(CampaignTables, EveryRecordingHasACellAndItsLinkLeadsToAFile) {
  std::vector<std::string> recordings{
      diagnosed("a/rep-1", 1, place("s", 15)),
      diagnosed("a/rep #2", 2, place("s", 16)),
      recording("a/unreadable"),
      recording("a/failed"),
      recording("a/waiting"),
  };
  spit(fs::path(recordings[3]) / "fails", "");
  (void)write_plan(plan(), {recordings, ""}, nothing_);
  const Workshop w =
      shop("test -e \"$2/fails\" && { echo told; kill -SEGV $$; }\n" + std::string(kAnswersFromFile), plan());
  for (std::size_t i : {0U, 1U, 2U, 3U}) (void)make_piece(w, recordings[i]);
  const auto look = [&](const std::map<std::string, std::string>& others) {
    const json grid = block_of(page_data(page()), "grid");
    ASSERT_FALSE(grid.is_null());
    const auto cells = cells_of(grid);
    EXPECT_EQ(cells.size(), recordings.size()) << grid;
    EXPECT_EQ(cells.at("a/unreadable: bad_recording"), "!");
    EXPECT_EQ(cells.at("a/waiting: waiting"), "…");
    for (const auto& [title, text] : others) EXPECT_EQ(cells.at(title), text) << title;
    // All but the one that waits lead somewhere.
    EXPECT_EQ(links_in(grid).size(), recordings.size() - 1) << grid;
    EXPECT_THAT(broken_links(page()), IsEmpty());
    std::vector<std::string> keys;
    for (const json& one : grid["key"]) keys.push_back(one["text"]);
    for (const auto& [title, text] : cells) EXPECT_THAT(keys, Contains(text)) << "no key of that mark";
  };
  (void)merge(plan(), &made_);
  const std::string failed = "a/failed: failed: ended by signal 11 (Segmentation fault)";
  ASSERT_TRUE(fs::exists(dir_ / "campaign/pooled.json"));
  look({{failed, "×"}, {"s, 15 psi: nothing missing", "·"}});
}

TEST_F(CampaignTables, WithoutAPoolTheGridIsThereToo) {
  const std::vector<std::string> recordings{recording("a/one"), recording("a/waiting")};
  (void)write_plan(plan(), {recordings, ""}, nothing_);
  ASSERT_EQ(
      make_piece(shop(std::string(kAnswers) + "; echo page > diagnosis-report.html", plan()), recordings[0]).ended,
      Ended::kMade);
  (void)merge(plan(), &made_);
  const json grid = block_of(page_data(page()), "grid");
  ASSERT_FALSE(grid.is_null());
  EXPECT_EQ(cells_of(grid),
            (std::map<std::string, std::string>{{"a/one: slack 0.97", "M"}, {"a/waiting: waiting", "…"}}));
  ASSERT_EQ(links_in(grid).size(), 1U);
  EXPECT_THAT(links_in(grid).front(), HasSubstr("/diagnosis-report.html"));
  EXPECT_THAT(broken_links(page()), IsEmpty());
}

}  // namespace
}  // namespace isorig::cli::pieces
