#pragma once
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "base/text_file.hpp"
#include "daemon/recording/catalogue.hpp"
#include "messages/run_log.hpp"
#include "processes.hpp"

/// What kill_test and power_cut_test have in common: the run, what it recorded, and the bound of what a crash may cost.
namespace isorig::system_test {

/// Some minutes of rig time that take about as long as the program's start: a kill meets every phase.
inline constexpr const char* kThreeRepetitions = R"(format = "isorig-protocol/1"
name = "three"
recording.policy = "round_ramps"
recording.before_s = 2.5
recording.average_interval_s = 0.1
steps = [
  { do = "repeat", unit = "session", for = { repetition = [1, 2, 3] }, steps = [
    { do = "pressurize", pressure_psi = 10, rate_psi_s = 5, settled_for_s = 1, timeout_s = 30 },
    { do = "ramp", to_mm = 1, velocity_mm_s = 10 },
    { do = "hold", duration_s = 60 },
    { do = "ramp", to_mm = 0, velocity_mm_s = 1 },
  ] },
]
)";
inline constexpr double kBefore_s = 2.5;
/// In place of 600 s: a kill then falls between two of many syncs.
inline constexpr double kSyncInterval_s = 5.0;
/// What is older is readable after a crash (docs/data.md, "What a crash costs"): sync_interval_s + 0.35 s and, in
/// averaged stretches, before_s more. The interval that an average is of ends up to 0.1 s later, and the recorder has
/// its turn every 0.01 s of rig time.
inline constexpr double kBound_s = kSyncInterval_s + 0.35 + kBefore_s + 0.1 + 0.02;

/// The shipped simulated rig with that sync interval.
inline std::filesystem::path crash_rig(const TempDir& dir) {
  auto text = slurp(source("config/rigs/sim.toml"));
  text = replaced(text, "\"../", "\"" + source("config/"));
  const auto at = text.find("[recorder]\n");
  const std::string key = "virtual_sync_interval_s = " + std::to_string(kSyncInterval_s) + "\n";
  if (at == std::string::npos) {
    text += "\n[recorder]\n" + key;
  } else {
    text.insert(at + 11, key);
  }
  const auto path = dir / "rig.toml";
  spit(path, text);
  return path;
}

/// Samples and intervals of each session, in the order of their time.
struct Rows : messages::RunVisitor {
  using Row = std::tuple<char, std::int64_t, double, double>;
  void session(const isorig_msgs::session_mark_t& m) override {
    if (m.kind == isorig_msgs::session_mark_t::END && m.complete != 0) complete.insert(m.session.session);
  }
  void frame(const isorig_msgs::frame_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i)
      take(m.session, {'f', m.mono_ns + m.mono_offset_ns[i], m.position_mm[i], m.force_N[i]});
  }
  void pressure(const isorig_msgs::pressure_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i)
      take(m.session, {'p', m.mono_ns + m.mono_offset_ns[i], m.pressure_psi[i], 0.0});
  }
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i)
      take(m.session, {'F', m.first_mono_ns[i], m.mean_position_mm[i], m.mean_force_N[i]});
  }
  std::map<std::int32_t, std::set<Row>> of;
  std::set<std::int32_t> complete;

 private:
  void take(std::int32_t session, const Row& row) { of[session].insert(row); }
};

/// How many rows of `due` older than `before_ns` are not in `is`.
inline std::size_t rows_lost(const Rows& due, const Rows& is, std::int64_t before_ns) {
  std::size_t lost = 0;
  for (const auto& [session, rows] : due.of) {
    const auto found = is.of.find(session);
    for (const auto& row : rows)
      if (std::get<1>(row) < before_ns && (found == is.of.end() || !found->second.contains(row))) ++lost;
  }
  return lost;
}

/// What is there was recorded so: nothing is in `is` that is not in `due`.
inline bool rows_are_right(const Rows& due, const Rows& is) {
  return std::all_of(is.of.begin(), is.of.end(), [&](const auto& each) {
    const auto found = due.of.find(each.first);
    return found != due.of.end() &&
           std::includes(found->second.begin(), found->second.end(), each.second.begin(), each.second.end());
  });
}

inline std::optional<daemon::RunRow> settled_run(const std::filesystem::path& runs) {
  return daemon::Catalogue(runs).find_run("latest");  // for writing: settles what a killed writer left
}

/// How often, and from which seed: ISORIG_KILLS and ISORIG_KILL_SEED.
inline int crashes_asked(int otherwise) {
  const char* asked = std::getenv("ISORIG_KILLS");
  return asked != nullptr ? std::atoi(asked) : otherwise;
}
inline std::uint64_t crash_seed() {
  const char* asked = std::getenv("ISORIG_KILL_SEED");
  return asked != nullptr ? std::strtoull(asked, nullptr, 10) : 1;
}

/// Goes on with the run as `isorig run --resume` does and looks at what it has become: every repetition is carried to
/// its end, those that were done before were left alone, and the recording is `wanted`.
inline void expect_resumed(const TempDir& dir, const std::filesystem::path& runs, const std::filesystem::path& rig,
                           const std::string& id, const Rows& due, const Rows& before,
                           std::initializer_list<messages::RecordingState> wanted) {
  const auto resumed = isorig(
      dir, {"run", "--resume", id, "--rig", rig.string(), "--runs", runs.string(), "--seed", "7", "--quiet"}, 120.0);
  ASSERT_EQ(resumed.code, 0) << resumed.text;
  const auto row = settled_run(runs);
  ASSERT_TRUE(row);
  EXPECT_EQ(row->id, id);
  EXPECT_EQ(row->state, "done");
  EXPECT_EQ(row->sessions_done, 3);
  Rows after;
  const auto report = messages::read_run(row->directory, after);
  EXPECT_NE(std::find(wanted.begin(), wanted.end(), report.state()), wanted.end())
      << messages::to_text(report.state()) << testing::PrintToString(report.complaints());
  EXPECT_EQ(after.complete.size(), 3U);
  for (const auto session : before.complete)
    EXPECT_TRUE(after.of[session] == before.of.at(session)) << "session " << session << " was done, and was changed";
  // A repetition takes as long as the rig needs to settle, which its noise decides: not to the sample.
  for (const auto& [session, rows] : due.of)
    EXPECT_GE(after.of[session].size(), rows.size() * 9 / 10) << "session " << session;
}

}  // namespace isorig::system_test
