#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "identify/report/long_signal.hpp"
#include "identify/report/neighbours.hpp"
#include "identify/report/page.hpp"

namespace isorig::identify::report {
namespace {

std::string read(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

struct Folder {
  std::filesystem::path path =
      std::filesystem::path(::testing::TempDir()) /
      ("report-" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
  Folder() { std::filesystem::remove_all(path); }
  ~Folder() { std::filesystem::remove_all(path); }
};

Figure example() {
  Series line{{0, 1, 2, 3}, {1, 4, std::nan(""), 16}, "a \"quoted\" <label>"};
  Series points{{0, 1, 2}, {1, 2, 3}, "with errors", Mark::kLinePoints, {0.1, 0.2, 0.3}};
  Series band{{0, 3}, {0, 1}, "band", Mark::kBand, {}, {2, 3}};
  Panel first{"Title", "strain rate (1/s)", "F/F0", {line, points}};
  first.verticals = {{1.5, "here"}};
  Panel second{"", "x", "y", {band, {{1, 10}, {1, 100}, "log"}}};
  second.log_x = true;
  second.x_range = {{0.5, 20.0}};
  return {"example_1", "A & B", {first, second}, 2};
}

/// The data that the page of `html` is drawn from.
nlohmann::json data_of(const std::string& html) {
  const std::string begin = R"(<script type="application/json" id="data">)";
  const auto from = html.find(begin) + begin.size();
  return nlohmann::json::parse(html.substr(from, html.find("</script>", from) - from));
}

TEST(Report, IsOneFileThatNeedsNoOther) {
  const Folder folder;
  Page page("Test", "Title with <tags> & more");
  page.made(
      {"isorig fv 'a b'", "isorig 1", "2026-01-02 03:04 UTC", {{"Recording", "r</script>"}}, {{"fv", "fv.html"}}});
  page.lead(Mood::kWarning, "half", "Half of it.");
  page.heading("Section");
  page.paragraph("1 < 2 </script> <!--");
  page.table({"name", "value", "both"}, {{"a", "1.5", "1"}, {"<b>", "-", "none"}}, "caption");
  page.list({"one", "two"});
  page.note("note", Mood::kBad);
  page.begin_more("more");
  page.figure(example());
  page.end_more();
  page.write(folder.path, "report.html");
  const std::string html = read(folder.path / "report.html");
  EXPECT_THAT(html, ::testing::HasSubstr("<title>Title with &lt;tags&gt; &amp; more</title>"));
  const auto data = data_of(html);
  EXPECT_EQ(data["format"], "isorig-report-data/1");
  EXPECT_EQ(data["title"], "Title with <tags> & more");
  EXPECT_EQ(data["made"]["inputs"][0]["what"], "r</script>");
  EXPECT_EQ(data["links"][0]["href"], "fv.html");
  EXPECT_EQ(data["blocks"][1]["text"], "1 < 2 </script> <!--");
  const auto& columns = data["blocks"][2]["columns"];
  EXPECT_FALSE(columns[0].contains("numeric"));
  EXPECT_TRUE(columns[1].contains("numeric")) << "numbers and a dash for none";
  EXPECT_FALSE(columns[2].contains("numeric")) << "one cell is a word";
  EXPECT_EQ(data["blocks"][5]["blocks"][0]["figure"]["name"], "example_1");
  // Nothing is fetched: no reference to a script, a style or a picture of another file, and a policy that forbids them.
  for (const char* reference : {"<script src", "<link", "@import", "url(http", "src=\"http"})
    EXPECT_THAT(html, ::testing::Not(::testing::HasSubstr(reference)));
  EXPECT_THAT(html, ::testing::HasSubstr("default-src 'none'"));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path), std::filesystem::directory_iterator()), 1);
}

TEST(Report, RefusesFiguresThatCannotBeDrawn) {
  auto figure = example();
  figure.panels[0].series[0].y.pop_back();
  EXPECT_THROW((void)figure_json(figure), std::invalid_argument);
  figure = example();
  figure.name = "../escape";
  EXPECT_THROW((void)figure_json(figure), std::invalid_argument);
  figure = example();
  figure.panels.clear();
  EXPECT_THROW((void)figure_json(figure), std::invalid_argument);
}

TEST(Report, RefusesHalfAPage) {
  Page page("Test", "half");
  EXPECT_THROW(page.end_more(), std::logic_error);
  page.begin_more("open");
  EXPECT_THROW((void)page.json(), std::logic_error);
}

TEST(Report, FiguresKeepGapsAndEnoughDigits) {
  const auto json = figure_json(example());
  EXPECT_TRUE(json["panels"][0]["series"][0]["y"][2].is_null()) << "NaN is a gap";
  EXPECT_EQ(json["panels"][0]["verticals"][0]["label"], "here");
  EXPECT_EQ(json["panels"][1]["x"]["log"], true);
  // A small change on a large value: rounded to 1e-5 of the span, not of the value.
  const auto fine = figure_json({"fine", "", {{"", "x", "y", {{{0, 1, 2}, {1000.0001, 1000.0002, 1000.0003}}}}}});
  const auto& y = fine["panels"][0]["series"][0]["y"];
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(y[i].get<double>(), 1000.0001 + 1e-4 * i, 2e-4 * 1e-4);
}

TEST(Report, ALongSignalIsABandThatHoldsEveryReading) {
  std::vector<double> x, y;
  for (int i = 0; i < 100000; ++i) {
    x.push_back(i);
    y.push_back(i == 54321 ? 7.0 : i == 4321 ? -3.0 : i % 2 == 0 ? 0.5 : -0.5);
  }
  const auto out = enveloped(x, y, "force", 3, 500);
  ASSERT_EQ(out.size(), 2U);
  EXPECT_EQ(out[0].mark, Mark::kBand);
  EXPECT_EQ(out[0].x.size(), 500U);
  EXPECT_EQ(*std::max_element(out[0].y2.begin(), out[0].y2.end()), 7.0);
  EXPECT_EQ(*std::min_element(out[0].y.begin(), out[0].y.end()), -3.0);
  EXPECT_EQ(out[1].mark, Mark::kLine);
  EXPECT_NEAR(out[1].y[0], 0.0, 1e-12) << "the mean of 200 readings of +-0.5";
  EXPECT_EQ(out[0].label, out[1].label) << "once in the key";
  // A short one is itself, in the order of x.
  const auto few = enveloped(std::vector<double>{2, 0, 1}, std::vector<double>{20, 0, std::nan("")}, "few", 0, 500);
  ASSERT_EQ(few.size(), 1U);
  EXPECT_THAT(few[0].x, ::testing::ElementsAre(0, 2));
  EXPECT_THAT(few[0].y, ::testing::ElementsAre(0, 20));
}

TEST(Report, ASignalOfUnknownLengthKeepsEveryReadingInFewStretches) {
  LongSignal signal(0.001, 100);
  double sum = 0.0;
  constexpr int kReadings = 50000;
  for (int i = 0; i < kReadings; ++i) {
    const double y = i == 31234 ? 9.0 : i == 7 ? -4.0 : std::sin(1e-3 * i);
    sum += y;
    signal.add(0.001 * i - 10.0, y);  // from before zero on
  }
  const auto out = signal.series("x", 2, 1.0);
  ASSERT_EQ(out.size(), 2U);
  EXPECT_LE(out[0].x.size(), 100U);
  EXPECT_GT(out[0].x.size(), 50U) << "doubled no more often than needed";
  EXPECT_EQ(*std::max_element(out[0].y2.begin(), out[0].y2.end()), 9.0);
  EXPECT_EQ(*std::min_element(out[0].y.begin(), out[0].y.end()), -4.0);
  EXPECT_TRUE(std::is_sorted(out[1].x.begin(), out[1].x.end()));
  // All stretches but the two ends hold equally many readings: their mean is that of the signal, but for the ends.
  double mean = 0.0;
  for (const double y : out[1].y) mean += y / static_cast<double>(out[1].y.size());
  EXPECT_NEAR(mean, sum / kReadings, 2.0 / static_cast<double>(out[1].y.size()));
}

TEST(Report, ASignalWithAHoleIsNotDrawnAcrossIt) {
  LongSignal signal(0.1);
  for (int i = 0; i < 10; ++i) signal.add(0.1 * i + 0.05, 1.0);
  signal.add(60.0, 2.0, 3.0, 2.5, 100.0);  // an interval, as averages come
  signal.add(61.0, std::nan(""));
  const auto out = signal.series("x", 0, 5.0, 1.0 / 60.0);
  ASSERT_EQ(out.size(), 2U);
  ASSERT_EQ(out[1].y.size(), 12U);
  EXPECT_TRUE(std::isnan(out[1].y[10]));
  EXPECT_EQ(out[0].y[11], 2.0);
  EXPECT_EQ(out[0].y2[11], 3.0);
  EXPECT_EQ(out[1].y[11], 2.5);
  EXPECT_NEAR(out[1].x[11], 1.0, 0.1 / 60.0);
}

TEST(Report, RSquaredHasTheDigitsThatTellItFromOne) {
  EXPECT_EQ(r_squared_text(0.5), "0.500");
  EXPECT_EQ(r_squared_text(0.9987), "0.9987");
  EXPECT_EQ(r_squared_text(0.999987), "0.999987");
  EXPECT_EQ(r_squared_text(1.0), "> 0.999999");
  EXPECT_EQ(r_squared_text(std::nan("")), "-");
  EXPECT_EQ(r_squared_text(-1.25), "-1.250");
}

TEST(Report, NumbersAreAsPreciseAsTheirIntervals) {
  EXPECT_EQ(interval_text(1.23456, 1.2, 1.27), "1.235 [1.2, 1.27]");
  EXPECT_EQ(interval_text(2.0, -INFINITY, 3.0), "2 [.., 3]");
  EXPECT_EQ(number_text(std::nan("")), "-");
}

TEST(Report, ABandOfManyReadingsKeepsBothItsEdges) {
  std::vector<double> x, low, high;
  for (int i = 0; i < 10000; ++i) {
    x.push_back(i);
    low.push_back(i == 4321 ? -3.0 : -1.0);
    high.push_back(i == 77 ? 7.0 : 1.0);
  }
  const Series band = enveloped_band(x, low, high, "95 %", 1, 100);
  EXPECT_LE(band.x.size(), 101U) << "and one to its end";
  EXPECT_EQ(band.x.front(), 0.0);
  EXPECT_EQ(band.x.back(), 9999.0);
  EXPECT_EQ(*std::ranges::min_element(band.y), -3.0);
  EXPECT_EQ(*std::ranges::max_element(band.y2), 7.0);
}

std::vector<std::string> hrefs(const Links& links) {
  std::vector<std::string> out;
  for (const auto& [text, href] : links) out.push_back(href);
  return out;
}

void touch(const std::filesystem::path& file) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file) << "x";
}

TEST(Neighbours, OfARunAreThePagesThatLieInItsFolder) {
  const Folder folder;
  const auto run = folder.path / "runs" / "run-1", other = folder.path / "runs" / "run-2";
  for (const auto& file :
       {run / "run.toml", run / "report.html", run / "fv-report.html", run / "d" / "diagnosis-report.html",
        run / "fv" / "fv-report.html", other / "run.toml", other / "report.html", other / "diagnosis-report.html"})
    touch(file);
  using ::testing::ElementsAre;
  EXPECT_THAT(hrefs(neighbours(run, "report.html", {})),
              ElementsAre("fv-report.html", "d/diagnosis-report.html", "fv/fv-report.html"))
      << "nothing of another run's";
  // A page in a run's folder: the run, and what lies beside it.
  EXPECT_THAT(hrefs(neighbours(run / "d", "diagnosis-report.html", {})),
              ElementsAre("../report.html", "../fv-report.html", "../fv/fv-report.html"));
}

TEST(Neighbours, InACommonFolderAreThoseMadeFromTheSameRecordings) {
  const Folder folder;
  const auto out = folder.path / "out", run = folder.path / "runs" / "run-1";
  const auto recording = out / "recordings" / "rep-1";
  for (const auto& file : {recording / "recording.toml", out / "fv" / "fv-report.html",
                           out / "d" / "diagnosis-report.html", out / "i" / "investigation-report.html",
                           run / "run.toml", run / "report.html", run / "recordings" / "rep-1" / "recording.toml"})
    touch(file);
  using ::testing::ElementsAre;
  EXPECT_THAT(hrefs(neighbours(out / "d", "diagnosis-report.html", {"slse1", recording.string()})),
              ElementsAre("../fv/fv-report.html", "../i/investigation-report.html"));
  EXPECT_THAT(hrefs(neighbours(out / "d", "diagnosis-report.html", {"slse1", "/no/such/recording"})), ElementsAre())
      << "what happens to lie in one folder need not belong together";
  EXPECT_THAT(hrefs(neighbours(out / "d", "diagnosis-report.html", {(run / "recordings" / "rep-1").string()})),
              ElementsAre("../../runs/run-1/report.html"))
      << "the run that a recording was taken out of";
  EXPECT_EQ(run_folder_above(run / "recordings" / "rep-1").filename(), "run-1");
  EXPECT_TRUE(run_folder_above(recording).empty());
}

TEST(Neighbours, OfARecordingThatWasExportedElsewhereIsItsRun) {
  const Folder folder;
  const auto run = folder.path / "runs" / "run-1";
  touch(run / "run.toml");
  touch(run / "report.html");
  const auto recording = [&](const char* name, const std::string& text) {
    touch(folder.path / "home" / name / "recording.toml");
    std::ofstream(folder.path / "home" / name / "recording.toml") << text;
    return (folder.path / "home" / name).string();
  };
  const std::string said = "run = \"run-1\"\nrun_directory = \"" + run.string() + "\"\n";
  const auto one = recording("one", said), two = recording("two", said), old = recording("old", "run = \"run-0\"\n"),
             gone = recording("gone", "run = \"run-9\"\nrun_directory = \"/no/such/run-9\"\n"),
             wrong = recording("wrong", "run = [");
  const auto there = folder.path / "home" / "fv";
  EXPECT_THAT(hrefs(neighbours(there, "fv-report.html", {one, two, old, gone, wrong})),
              ::testing::ElementsAre("../../runs/run-1/report.html"));
  Page page("Force-velocity analysis", "x");
  page.made(
      {"isorig fv", "1", "", {{"Recording", one}, {"Recording", two}, {"Recording", old}, {"Recording", gone}}, {}});
  page.write(there, "fv-report.html");
  std::ifstream in(there / "fv-report.html");
  const std::string html{std::istreambuf_iterator<char>(in), {}};
  for (const std::string& what :
       {"run-1 (" + run.string() + ")", std::string("\"run-0\""), std::string("run-9 (/no/such/run-9)")})
    EXPECT_NE(html.find(what), std::string::npos) << what;
  EXPECT_EQ(html.find("run-1 (", html.find("run-1 (") + 1), std::string::npos) << "each run once";
}

TEST(Neighbours, AreReachedThroughFoldersOfAnyName) {
  const Folder folder;
  touch(folder.path / "50% #3?" / "fv-report.html");
  EXPECT_THAT(hrefs(neighbours(folder.path, "report.html", {})),
              ::testing::ElementsAre("50%25%20%233%3F/fv-report.html"));
}

TEST(Neighbours, NoPageIsCalledAsThatOfAnotherCommand) {
  EXPECT_TRUE(is_page_of_another("fv-report.html", "report.html"));
  EXPECT_FALSE(is_page_of_another("report.html", "report.html"));
  EXPECT_FALSE(is_page_of_another("mine.html", "report.html"));
}

TEST(Neighbours, AreLinkedOnceAndOnlyWhereTheyAre) {
  const Folder folder;
  const auto write = [&](const char* name) {
    Page page("Test", name);
    page.link("mine", "fv-report.html");
    page.write(folder.path, name);
    return data_of(read(folder.path / name))["links"];
  };
  const auto alone = write("diagnosis-report.html");
  ASSERT_EQ(alone.size(), 1U) << "the other page is not there yet";
  touch(folder.path / "fv-report.html");
  touch(folder.path / "campaign-report.html");
  const auto later = write("diagnosis-report.html");
  ASSERT_EQ(later.size(), 2U);
  EXPECT_EQ(later[0]["text"], "mine");
  EXPECT_EQ(later[1]["href"], "campaign-report.html");
}

}  // namespace
}  // namespace isorig::identify::report
