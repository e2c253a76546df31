// A run that is killed at any moment: what it leaves is told short, and what it leaves is right.
#include <gtest/gtest.h>

#include <chrono>
#include <map>
#include <random>
#include <set>
#include <thread>

#include "daemon/recording/catalogue.hpp"
#include "messages/run_log.hpp"
#include "processes.hpp"

namespace isorig::system_test {
namespace {

// Seconds of rig time that take about as long as the program's start: a kill meets every phase.
constexpr const char* kThreeRepetitions = R"(format = "isorig-protocol/1"
name = "three"
recording.policy = "round_ramps"
steps = [
  { do = "repeat", unit = "session", for = { repetition = [1, 2, 3] }, steps = [
    { do = "pressurize", pressure_psi = 10, rate_psi_s = 5, settled_for_s = 1, timeout_s = 30 },
    { do = "ramp", to_mm = 1, velocity_mm_s = 10 },
    { do = "hold", duration_s = 600 },
    { do = "ramp", to_mm = 0, velocity_mm_s = 1 },
  ] },
]
)";

/// Samples and intervals of each session, in the order of their time.
struct Rows : messages::RunVisitor {
  using Row = std::tuple<char, std::int64_t, double, double>;
  void session(const isorig_msgs::session_mark_t& m) override {
    if (m.kind == isorig_msgs::session_mark_t::END && m.complete != 0) complete.insert(m.session.session);
  }
  void frame(const isorig_msgs::frame_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      of[m.session].insert({'f', m.mono_ns + m.mono_offset_ns[i], m.position_mm[i], m.force_N[i]});
    }
  }
  void pressure(const isorig_msgs::pressure_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      of[m.session].insert({'p', m.mono_ns + m.mono_offset_ns[i], m.pressure_psi[i], 0.0});
    }
  }
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      of[m.session].insert({'F', m.first_mono_ns[i], m.mean_position_mm[i], m.mean_force_N[i]});
    }
  }
  std::map<std::int32_t, std::set<Row>> of;
  std::set<std::int32_t> complete;
};

TEST(Kill, AtAnyMomentLeavesARecordingThatIsToldShortAndRightAsFarAsItGoes) {
  const TempDir dir;
  spit(dir / "three.toml", kThreeRepetitions);
  const auto words = [&](const std::filesystem::path& runs) {
    return std::vector<std::string>{bin("isorig"),
                                    "run",
                                    (dir / "three.toml").string(),
                                    "--rig",
                                    source("config/rigs/sim.toml"),
                                    "--runs",
                                    runs.string(),
                                    "--seed",
                                    "7",
                                    "--quiet"};
  };
  const auto start = std::chrono::steady_clock::now();
  Process undisturbed(words(dir / "whole"), dir / "whole.log");
  ASSERT_EQ(undisturbed.wait(60.0), 0) << undisturbed.output();
  const double whole_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const auto run_of = [](const std::filesystem::path& runs) { return daemon::Catalogue(runs).find_run("latest"); };
  Rows due;
  const auto reference = run_of(dir / "whole");
  ASSERT_TRUE(reference);
  ASSERT_EQ(messages::read_run(reference->directory, due).state(), messages::RecordingState::kWhole);
  ASSERT_EQ(due.complete.size(), 3U);

  const char* asked = std::getenv("ISORIG_KILLS");
  const int kills = asked != nullptr ? std::atoi(asked) : 30;
  std::mt19937_64 random(1);
  int finished = 0, nothing = 0, told = 0, sessions = 0;
  for (int n = 0; n < kills; ++n) {
    const auto runs = dir / ("runs-" + std::to_string(n));
    Process victim(words(runs), dir / "victim.log");
    std::this_thread::sleep_for(
        std::chrono::duration<double>(whole_s * std::uniform_real_distribution<>(0.0, 1.1)(random)));
    const int ended = victim.running() ? victim.stop(SIGKILL) : victim.wait(1.0);
    std::optional<daemon::RunRow> row;
    if (std::filesystem::exists(runs)) row = run_of(runs);  // for writing: settles it
    if (!row) {
      ++nothing;
      continue;
    }
    Rows is;
    const auto report = messages::read_run(row->directory, is);
    if (ended == 0) {
      ++finished;
      EXPECT_EQ(report.state(), messages::RecordingState::kWhole);
    } else if (report.state() == messages::RecordingState::kWhole) {
      EXPECT_TRUE(is.of == due.of) << "kill " << n << ": called whole";  // it was killed behind its last sync
      EXPECT_EQ(row->state, "done");
    } else {
      ++told;
      EXPECT_EQ(report.state(), messages::RecordingState::kInterrupted) << testing::PrintToString(report.complaints());
      EXPECT_NE(row->state, "done");
    }
    EXPECT_FALSE(std::filesystem::exists(row->directory / ".reserve"));
    EXPECT_EQ(static_cast<std::size_t>(row->sessions_done), is.complete.size());
    for (const auto& [session, rows] : is.of) {
      if (is.complete.contains(session)) {
        EXPECT_TRUE(rows == due.of[session]) << "kill " << n << ", session " << session << " is called done";
        ++sessions;
      } else {
        EXPECT_TRUE(std::includes(due.of[session].begin(), due.of[session].end(), rows.begin(), rows.end()))
            << "kill " << n;
      }
    }
    std::filesystem::remove_all(runs);
    if (HasFailure()) break;
  }
  std::printf(
      "  %d kills in %.2f s each: %d had finished, %d before there was a run, %d told interrupted; %d whole sessions\n",
      kills, whole_s, finished, nothing, told, sessions);
  EXPECT_GT(told, 0);
}

}  // namespace
}  // namespace isorig::system_test
