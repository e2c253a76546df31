// A run that is killed at any moment: what it leaves is told short, is right as far as it goes, is short by no more
// than the stated bound, and can be gone on with. docs/fuzzing.md has the command for a thousand kills.
#include <gtest/gtest.h>

#include <chrono>
#include <random>
#include <thread>

#include "recorded_rows.hpp"

namespace isorig::system_test {
namespace {

using messages::RecordingState;

std::int64_t rig_ns_in(const std::filesystem::path& clock) {
  const auto bytes = slurp(clock);
  std::int64_t ns = 0;
  if (bytes.size() == sizeof ns) std::memcpy(&ns, bytes.data(), sizeof ns);
  return ns;
}

TEST(Kill, AtAnyMomentLeavesARecordingThatIsToldShortAndRightAsFarAsItGoes) {
  const TempDir dir;
  spit(dir / "three.toml", kThreeRepetitions);
  const auto rig = crash_rig(dir);
  const auto words = [&](const std::filesystem::path& runs) {
    return std::vector<std::string>{bin("kill_victim"), (dir / "three.toml").string(), rig.string(), runs.string(),
                                    (dir / "clock").string()};
  };
  const auto start = std::chrono::steady_clock::now();
  Process undisturbed(words(dir / "whole"), dir / "whole.log");
  ASSERT_EQ(undisturbed.wait(120.0), 0) << undisturbed.output();
  const double whole_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  Rows due;
  const auto reference = settled_run(dir / "whole");
  ASSERT_TRUE(reference);
  ASSERT_EQ(messages::read_run(reference->directory, due).state(), RecordingState::kWhole);
  ASSERT_EQ(due.complete.size(), 3U);

  const int kills = crashes_asked(24);
  std::mt19937_64 random(crash_seed());
  int finished = 0, nothing = 0, told = 0, sessions = 0, resumed = 0;
  double longest_s = 0.0;
  for (int n = 0; n < kills; ++n) {
    const auto runs = dir / "runs";
    std::filesystem::remove_all(runs);
    spit(dir / "clock", "");
    Process victim(words(runs), dir / "victim.log");
    std::this_thread::sleep_for(
        std::chrono::duration<double>(whole_s * std::uniform_real_distribution<>(0.0, 1.1)(random)));
    const int ended = victim.running() ? victim.stop(SIGKILL) : victim.wait(1.0);
    const auto killed_ns = rig_ns_in(dir / "clock");
    std::optional<daemon::RunRow> row;
    if (std::filesystem::exists(runs)) row = settled_run(runs);
    if (!row) {
      ++nothing;
      continue;
    }
    Rows is;
    const auto report = messages::read_run(row->directory, is);
    if (ended == 0) {
      ++finished;
      EXPECT_EQ(report.state(), RecordingState::kWhole);
    } else if (report.state() == RecordingState::kWhole) {
      EXPECT_TRUE(is.of == due.of) << "kill " << n << ": called whole";  // it was killed behind its last sync
      EXPECT_EQ(row->state, "done");
    } else {
      ++told;
      EXPECT_EQ(report.state(), RecordingState::kInterrupted) << testing::PrintToString(report.complaints());
      EXPECT_FALSE(report.complaints().empty());
      EXPECT_NE(row->state, "done");
      std::int64_t newest_ns = 0;
      for (const auto& [session, rows] : is.of)
        for (const auto& each : rows) newest_ns = std::max(newest_ns, std::get<1>(each));
      if (newest_ns > 0) longest_s = std::max(longest_s, static_cast<double>(killed_ns - newest_ns) * 1e-9);
    }
    EXPECT_TRUE(rows_are_right(due, is)) << "kill " << n;
    EXPECT_EQ(rows_lost(due, is, killed_ns - static_cast<std::int64_t>(kBound_s * 1e9)), 0U) << "kill " << n;
    EXPECT_FALSE(std::filesystem::exists(row->directory / ".reserve"));
    EXPECT_EQ(static_cast<std::size_t>(row->sessions_done), is.complete.size());
    for (const auto session : is.complete) {
      EXPECT_TRUE(is.of[session] == due.of[session]) << "kill " << n << ", session " << session << " is called done";
      ++sessions;
    }
    if (report.state() != RecordingState::kWhole) {
      expect_resumed(dir, runs, rig, row->id, due, is, {RecordingState::kWhole});
      ++resumed;
    }
    if (HasFailure()) break;
  }
  std::printf(
      "  %d kills of a run of %.2f s: %d had finished, %d before there was a run, %d told interrupted, %d of them gone "
      "on "
      "with to the end; %d whole sessions; newest row %.2f s of rig time before the kill at most, %.2f s are allowed\n",
      kills, whole_s, finished, nothing, told, resumed, sessions, longest_s, kBound_s);
  EXPECT_GT(told, 0);
}

}  // namespace
}  // namespace isorig::system_test
