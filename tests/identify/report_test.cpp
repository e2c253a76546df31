#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

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

TEST(Report, IsOneFileThatNeedsNoOther) {
  const Folder folder;
  Page page("Title with <tags> & more");
  page.heading("Section");
  page.paragraph("1 < 2");
  page.table({"name", "value"}, {{"a", "1.5"}, {"<b>", "-"}}, "caption");
  page.list({"one", "two"});
  page.note("note");
  page.figure(example());
  page.write(folder.path);
  const std::string html = read(folder.path / "report.html");
  EXPECT_THAT(html, ::testing::HasSubstr("Title with &lt;tags&gt; &amp; more"));
  EXPECT_THAT(html, ::testing::HasSubstr("1 &lt; 2"));
  EXPECT_THAT(html, ::testing::HasSubstr("<td class=\"n\">1.5</td>"));
  EXPECT_THAT(html, ::testing::HasSubstr("<td>&lt;b&gt;</td>"));
  EXPECT_THAT(html, ::testing::HasSubstr("<svg"));
  // No reference leaves the file: what is left of http are the names of the XML spaces.
  for (std::size_t at = html.find("http"); at != std::string::npos; at = html.find("http", at + 1))
    EXPECT_EQ(html.substr(at, 18), "http://www.w3.org/") << html.substr(at, 60);
  EXPECT_THAT(html, ::testing::Not(::testing::HasSubstr("<script src")));
  EXPECT_GT(std::filesystem::file_size(folder.path / "figures/example_1.svg"), 2000U);
  EXPECT_EQ(read(folder.path / "figures/example_1.png").substr(1, 3), "PNG");
}

TEST(Report, RefusesFiguresThatCannotBeDrawn) {
  const Folder folder;
  auto figure = example();
  figure.panels[0].series[0].y.pop_back();
  EXPECT_THROW(draw(std::vector{figure}, folder.path), std::invalid_argument);
  figure = example();
  figure.name = "../escape";
  EXPECT_THROW(draw(std::vector{figure}, folder.path), std::invalid_argument);
}

TEST(Report, SaysWhatIsMissing) {
  const Folder folder;
  DrawOptions options;
  options.gnuplot = "no-such-program";
  try {
    draw(std::vector{example()}, folder.path, options);
    FAIL() << "did not throw";
  } catch (const std::runtime_error& e) {
    EXPECT_THAT(e.what(), ::testing::HasSubstr("gnuplot-nox"));
  }
}

TEST(Report, LabelsCannotLeaveTheirQuotes) {
  auto figure = example();
  figure.panels[0].title = "it's `date`\nplot";
  const std::string script = gnuplot_script(std::vector{figure}, "/tmp", false);
  EXPECT_THAT(script, ::testing::HasSubstr("set title 'it''s `date` plot' "));
}

TEST(Report, ThinningKeepsTheExtremes) {
  Series s;
  for (int i = 0; i < 100000; ++i) {
    s.x.push_back(i);
    s.y.push_back(i == 54321 ? 7.0 : i == 4321 ? -3.0 : 0.0);
  }
  const Series out = thinned(s, 500);
  EXPECT_LE(out.x.size(), 500U);
  EXPECT_EQ(*std::max_element(out.y.begin(), out.y.end()), 7.0);
  EXPECT_EQ(*std::min_element(out.y.begin(), out.y.end()), -3.0);
  EXPECT_TRUE(std::is_sorted(out.x.begin(), out.x.end()));
}

TEST(Report, NumbersAreAsPreciseAsTheirIntervals) {
  EXPECT_EQ(interval_text(1.23456, 1.2, 1.27), "1.235 [1.2, 1.27]");
  EXPECT_EQ(interval_text(2.0, -INFINITY, 3.0), "2 [.., 3]");
  EXPECT_EQ(number_text(std::nan("")), "-");
}

}  // namespace
}  // namespace isorig::identify::report
