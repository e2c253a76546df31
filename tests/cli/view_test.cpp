// What `isorig watch` draws for a status, a clock and a size: widths, heights, colours, verdicts.
#include "cli/screen/view.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "cli/screen/exit_codes.hpp"
#include "cli/screen/live_verdicts.hpp"
#include "cli/screen/progress.hpp"
#include "cli/screen/screen.hpp"

namespace isorig::cli {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

json link(double bound_us) {
  return {{"connected", true}, {"clock_ready", true}, {"bound_us", bound_us}, {"repeatability_us", 12.0}, {"lost", 0}};
}

json running() {
  return {{"rig", "bench 3"},
          {"state", "running"},
          {"progress", 0.25},
          {"remaining_s", 3600.0},
          {"force_N", 12.5},
          {"loop", {{"ticks", 100000}, {"overruns", 0}, {"worst_wakeup_us", 31900.0}, {"worst_run_us", 40.0}}},
          {"frame", link(80.0)},
          {"pressure", link(900.0)},
          {"interlock", {{"estop_closed", true}, {"guard_closed", true}}},
          {"run", {{"id", "20261122-101500-vma-control1"}, {"step", 1}, {"steps", 3}, {"step_text", "ramp to 5 mm"}}}};
}

View view_of(json status, int columns, int rows) {
  View v;
  v.status = std::move(status);
  v.size = {columns, rows};
  v.now = 1'793'000'000;  // 2026-10-26 07:33:20 UTC, a Monday
  return v;
}

/// Columns that a line takes: escape sequences none, each character one.
int width_of(const std::string& line) {
  int width = 0;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line[i] == '\x1b') {
      i = line.find('m', i);
    } else if ((static_cast<unsigned char>(line[i]) & 0xC0U) != 0x80U) {
      ++width;
    }
  }
  return width;
}

std::string joined(const std::vector<std::string>& lines) {
  std::string out;
  for (const auto& line : lines) out += line + "\n";
  return out;
}

class ViewTest : public testing::Test {
 protected:
  void SetUp() override {
    ::setenv("TZ", "UTC", 1);
    ::tzset();
  }
};

TEST_F(ViewTest, FitsEverySizeAndKeepsItsFooter) {
  auto v = view_of(running(), 80, 24);
  for (int i = 0; i < 100; ++i) {
    v.force_N.push_back(std::sin(0.1 * i));
    v.events.push_back({"frame.restart: a long line of what happened to the frame, number " + std::to_string(i) +
                            ", which no terminal of this width shows whole",
                        Tone::kWarn});
  }
  for (const int columns : {1, 5, 20, 40, 60, 80, 81, 132, 400}) {
    for (const int rows : {1, 2, 5, 12, 24, 60}) {
      v.size = {columns, rows};
      const auto lines = view_lines(v);
      EXPECT_EQ(lines.size(), static_cast<std::size_t>(rows)) << columns << " x " << rows;
      for (const auto& line : lines) EXPECT_LE(width_of(line), columns) << columns << " x " << rows << ": " << line;
      auto silent = v, unheard = v;
      silent.silent_s = unheard.silent_s = 1e5;
      unheard.status = json();
      for (const auto* other : {&silent, &unheard}) {
        const auto old = view_lines(*other);
        EXPECT_EQ(old.size(), static_cast<std::size_t>(rows)) << columns << " x " << rows;
        for (const auto& line : old) EXPECT_LE(width_of(line), columns) << columns << " x " << rows << ": " << line;
      }
    }
  }
  v.size = {80, 24};
  EXPECT_THAT(view_lines(v).back(), HasSubstr("q leaves the view; the run goes on"));
  EXPECT_THAT(joined(view_lines(v)), HasSubstr("number 99"));
}

TEST_F(ViewTest, SaysVerdictsAndTheClockOfTheEnd) {
  auto v = view_of(running(), 132, 40);
  v.worst_s = 90000.0;
  const auto text = joined(view_lines(v));
  EXPECT_THAT(text, HasSubstr("worst wake-up 31.9 ms: bad, see docs/threads.md"));
  EXPECT_THAT(text, HasSubstr("clock within 80 us (scatter 12 us): good; none lost"));
  EXPECT_THAT(text, HasSubstr("clock within 900 us (scatter 12 us): fair, see docs/clock.md"));
  EXPECT_THAT(text, HasSubstr("1 h 00 min left, ends 08:33, at worst Tue 08:33"));
  EXPECT_THAT(view_lines(v).front(), AllOf(HasSubstr("bench 3: running"), HasSubstr("Mon 07:33:20")));
}

TEST_F(ViewTest, AVerdictIsNotCutOffAt80Columns) {
  auto status = running();
  status["loop"]["ticks"] = 86'400'000;
  status["loop"]["overruns"] = 12'345;
  EXPECT_THAT(joined(view_lines(view_of(status, 80, 24))),
              HasSubstr("worst wake-up 31.9 ms: bad, see docs/threads.md; 12345 of 8"));
}

TEST_F(ViewTest, ColoursByStateAndOnlyWhereWanted) {
  auto v = view_of(running(), 80, 24);
  EXPECT_THAT(view_lines(v).front(), StartsWith("\x1b[1;30;42m"));
  auto faulted = running();
  faulted["state"] = "faulted";
  faulted["fault"] = "limit.force: 210 N\x1b[2J";
  v.status = faulted;
  EXPECT_THAT(view_lines(v).front(), StartsWith("\x1b[1;97;41m"));
  v.colour = false;
  EXPECT_THAT(joined(view_lines(v)), Not(HasSubstr("\x1b")));  // nor what comes from outside
  EXPECT_THAT(joined(view_lines(v)), HasSubstr("FAULT     limit.force: 210 N"));
}

TEST_F(ViewTest, SaysHowOldItIsWhenNoNewsCome) {
  auto v = view_of(running(), 100, 24);
  EXPECT_THAT(joined(view_lines(v)), Not(HasSubstr("no news")));
  v.silent_s = 12.3;
  EXPECT_THAT(view_lines(v)[1], HasSubstr("no news for 12 s: isorigd does not answer; what stands here is that old"));
  EXPECT_THAT(joined(view_lines(v)), HasSubstr("ramp to 5 mm"));
  EXPECT_THAT(view_lines(v).front(), Not(HasSubstr("\x1b[1;30;42m")));  // nobody knows whether it still runs
  v.status = json();                                                    // nor came any before
  EXPECT_THAT(view_lines(v)[1], HasSubstr("no news for 12 s: isorigd does not answer"));
  EXPECT_THAT(joined(view_lines(v)), Not(HasSubstr("that old")));
  EXPECT_THAT(view_lines(v).back(), HasSubstr("q leaves the view"));
}

TEST_F(ViewTest, WorstLeftIsOfThisRunsPlanFromThisStepOn) {
  const json plan{{"run", "20261122-101500-vma-control1"},
                  {"steps", {{{"worst_s", 10.0}}, {{"worst_s", 20.0}}, {{"worst_s", 30.0}}}}};
  EXPECT_DOUBLE_EQ(worst_left_s(plan, running()), 50.0);
  auto another = running();
  another["run"]["id"] = "another";
  EXPECT_DOUBLE_EQ(worst_left_s(plan, another), -1.0);
  another.erase("run");
  EXPECT_DOUBLE_EQ(worst_left_s(plan, another), -1.0);
  EXPECT_DOUBLE_EQ(worst_left_s(json(), running()), -1.0);
}

TEST_F(ViewTest, SparklineScalesAndShowsGaps) {
  EXPECT_EQ(sparkline({0.0, 7.0, 3.5}, 10, true), "\u2581\u2588\u2585");
  EXPECT_EQ(sparkline({9.0, 0.0, std::nan(""), 7.0}, 3, false), "_ #");
  EXPECT_EQ(sparkline({5.0, 5.0}, 10, false), "__");
  EXPECT_EQ(sparkline({}, 10, true), "");
}

TEST_F(ViewTest, CutsBetweenCharacters) {
  EXPECT_EQ(cut("kraft", 5), "kraft");
  EXPECT_EQ(cut("kraft", 4), "kra~");
  EXPECT_EQ(cut("prüfstände", 5), "prüf~");
  EXPECT_EQ(cut("x", 0), "");
}

TEST(Status, ASealedChamberIsNotCalledRegulated) {
  auto status = running();
  status.update({{"state", "paused"}, {"pressure_psi", 9.98}, {"setpoint_psi", 10.0}, {"sealed", true}});
  const auto text = [&] {
    std::string all;
    for (const auto& line : status_lines(status)) all += line.text + "\n";
    return all;
  };
  EXPECT_THAT(text(), HasSubstr("9.980 psi (SEALED, both valves shut; was 10.00)"));
  status["sealed"] = false;
  EXPECT_THAT(text(), AllOf(HasSubstr("(set-point 10.00, fill 0, vent 0 permille)"), Not(HasSubstr("SEALED"))));
}

TEST(ProgressText, SaysTheTimeLeftOnceItCanBeKnownAndFits) {
  EXPECT_THAT(progress_text("run", 0.25, 28.0, 30.0, "2 h 00 min of rig time", 120),
              HasSubstr("25.0 %, 30.0 s so far, about 1 min 22 s left: 2 h 00 min of rig time"));
  EXPECT_THAT(progress_text("run", 0.01, 30.0, 30.0, "", 120), Not(HasSubstr("left")));  // 1 %: anything may come
  EXPECT_THAT(progress_text("run", 0.5, 2.0, 2.0, "", 120), Not(HasSubstr("left")));
  // A stage that takes longer than was promised: nothing is promised any more.
  EXPECT_THAT(progress_text("run", 0.5, 30.0, 61.0, "", 120), Not(HasSubstr("left")));
  // What was done before it began to watch took nobody knows how long: half of the rest in 30 s.
  EXPECT_THAT(progress_text("run", 0.95, 30.0, 30.0, "", 120, 0.9),
              HasSubstr("95.0 %, 30.0 s so far, about 30.0 s left"));
  EXPECT_THAT(progress_text("run", 0.9, 30.0, 30.0, "", 120, 0.9), Not(HasSubstr("left")));
  EXPECT_THAT(progress_text("run", 0.904, 30.0, 30.0, "", 120, 0.9), Not(HasSubstr("left")));  // 4 % of the rest
  EXPECT_THAT(progress_text("run", 1.0, 30.0, 30.0, "", 120, 1.0), Not(HasSubstr("left")));
  for (const int columns : {1, 20, 60, 79, 200}) {
    EXPECT_LE(
        width_of(progress_text("round 3, diagnosis", 0.5, 3600.0, 3600.0, "weighing \n what may be missing", columns)),
        columns);
  }
}

TEST(ExitCode, IsThatOfTheRunAndNotOfAllThatTheDaemonHasSeen) {
  EXPECT_EQ(exit_code_of({{"outcome", "done"}, {"dropped_records", 0}}), kOk);
  EXPECT_EQ(lost_words({{"outcome", "done"}, {"dropped_records", 0}, {"missing_samples", 0}}), "");
  EXPECT_EQ(lost_words({{"missing_samples", 9449}, {"lost_messages", 0}, {"dropped_records", 2}}),
            "9449 samples never came, 2 records were dropped");
  for (const char* lost : {"dropped_records", "missing_samples", "lost_messages"})
    EXPECT_EQ(exit_code_of({{"outcome", "done"}, {lost, 3}}), kDataLost) << lost;
  EXPECT_EQ(exit_code_of({{"outcome", "failed"}, {"dropped_records", 3}}), kTripped);
  EXPECT_EQ(exit_code_of({{"outcome", "aborted"}}), kFailure);
}

TEST(FilesProgress, AFileHasTheShareOfItsSize) {
  const auto folder = std::filesystem::path(testing::TempDir()) / "isorig_files_progress";
  std::filesystem::create_directories(folder);
  const auto file = [&](const char* name, std::size_t bytes) {
    std::ofstream(folder / name) << std::string(bytes, 'x');
    return folder / name;
  };
  const FilesProgress all("fv", {file("a", 1000), folder / "is not there", file("b", 3000), file("empty", 0)});
  EXPECT_DOUBLE_EQ(all.part_of_all(0, 0.0), 0.0);
  EXPECT_DOUBLE_EQ(all.part_of_all(0, 0.5), 0.125);
  EXPECT_DOUBLE_EQ(all.part_of_all(0, 1.0), 0.25);
  EXPECT_DOUBLE_EQ(all.part_of_all(1, 0.7), 0.25);
  EXPECT_DOUBLE_EQ(all.part_of_all(2, 0.5), 0.625);
  EXPECT_DOUBLE_EQ(all.part_of_all(3, 0.0), 1.0);
  EXPECT_DOUBLE_EQ(all.part_of_all(2, 7.0), 1.0);  // what a command counts too far
  EXPECT_DOUBLE_EQ(all.part_of_all(2, -1.0), 0.25);
  EXPECT_THROW((void)all.part_of_all(4, 0.5), std::out_of_range);
  const FilesProgress none("fv", {folder / "is not there"});
  EXPECT_DOUBLE_EQ(none.part_of_all(0, 1.0), 0.0);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace isorig::cli
