#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "../daemon/recording_rig.hpp"
#include "base/text_file.hpp"
#include "base/toml_reader.hpp"
#include "growth.hpp"
#include "play.hpp"
#include "schedule.hpp"
#include "tree.hpp"

/// What judges a soak has to be able to find something, and to find the same again.
namespace isorig::soak {
namespace {

std::string source(const std::string& path) {
  return isorig::test::source_path() + "/" + path;
}

TEST(Soak, ASeedIsTheSameRunAgain) {
  const auto once = [] {
    const daemon::testing::TemporaryDirectory folder("soak", "/tmp");
    PlayOptions options;
    options.rig = source("config/rigs/sim.toml");
    options.protocol = source("config/protocols/vma-short.toml");
    options.runs_root = folder.path();
    options.faults = 6;
    auto result = play(5, options);
    result.erase("begin");  // memory and descriptors of this process
    result.erase("end");
    return result;
  };
  const auto first = once(), second = once();
  EXPECT_EQ(first, second);
  EXPECT_EQ(first["findings"], nlohmann::ordered_json::array());
  EXPECT_EQ(first["outcome"], "done");
  EXPECT_GE(first["strikes"].size(), 1U);
}

// A slow stroke that is commanded under a fault of the frame trips long after the repair.
TEST(Soak, ASegmentThatAFaultHasSpoiltIsGoneOnWithWhenItShows) {
  const daemon::testing::TemporaryDirectory folder("soak", "/tmp");
  PlayOptions options;
  options.rig = source("config/rigs/sim.toml");
  options.protocol = (folder.path() / "slow.toml").string();
  std::ofstream(options.protocol) << R"(format = "isorig-protocol/1"
name = "slow strokes"
recording.policy = "round_ramps"
steps = [
  { do = "pressurize", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },
  { do = "hold", duration_s = 20 },
  { do = "wave", shape = "triangle", amplitude_mm = 2, velocity_mm_s = 0.05, cycles = 2 },
  { do = "hold", duration_s = 20 },
]
)";
  options.runs_root = folder.path();
  options.faults = 3;
  const auto result = play(5, options);
  EXPECT_EQ(result["findings"], nlohmann::ordered_json::array());
  EXPECT_EQ(result["outcome"], "done");
  const auto late = std::ranges::find_if(result["strikes"], [](const auto& strike) { return strike.contains("late"); });
  ASSERT_NE(late, result["strikes"].end());
  EXPECT_GT((*late)["late_s"], 3.0);  // as long as the operator stays by himself
}

TEST(Soak, EveryKindOfStepAndEveryFaultIsDrawn) {
  const auto config = daemon::load_rig(source("config/rigs/sim.toml"));
  const auto plan = protocol::compile(
      base::TomlDocument::parse_text(base::read_config_file(source("config/protocols/vma-short.toml")), "short.toml"),
      config.limits);
  std::vector<int> faults(daemon::test::faults().size()), at(daemon::test::kSituations);
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    for (const auto& s : draw(plan, seed, 12)) {
      ++faults[s.fault];
      ++at[static_cast<unsigned>(situation_of(plan, s.step))];
    }
  }
  // 2400 draws of 70 faults: 34 each; none at all has a probability of exp(-34).
  for (std::size_t i = 0; i < faults.size(); ++i) EXPECT_GT(faults[i], 0) << daemon::test::faults()[i].name;
  using daemon::test::At;
  for (const auto each : {At::kFill, At::kSettle, At::kHold, At::kFast, At::kTriangle, At::kSine})
    EXPECT_GT(at[static_cast<unsigned>(each)], 100);
}

TEST(Growth, TellsALeakFromWavering) {
  std::vector<double> time, steady, leaking;
  for (int i = 0; i < 300; ++i) {
    time.push_back(2.0 * i);
    const double waver = 0.2 * std::sin(0.7 * i);
    steady.push_back(90.0 + waver);
    leaking.push_back(90.0 + waver + 0.002 * 2.0 * i);  // 7 MB/h
  }
  const double most = 64.0 / 86'400.0;
  EXPECT_FALSE(growth_of(time, steady).surely_above(most));
  EXPECT_TRUE(growth_of(time, leaking).surely_above(most));
  EXPECT_NEAR(growth_of(time, leaking).slope, 0.002, 2e-4);
}

}  // namespace
}  // namespace isorig::soak
