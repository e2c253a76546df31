#include <gmock/gmock.h>

#include <string>

#include "rig_fixture.hpp"

/// How long waves take in the simulated rig, against the plan: it stands at each turning point.
namespace isorig::daemon::test {
namespace {

struct Wave {
  const char* text;
  int cycles;
};

class WaveTimeTest : public RigFixture, public ::testing::WithParamInterface<Wave> {};

INSTANTIATE_TEST_SUITE_P(
    All, WaveTimeTest,
    ::testing::Values(Wave{"shape = \"triangle\", amplitude_mm = 0.1, frequency_hz = 5", 10},
                      Wave{"shape = \"triangle\", amplitude_mm = 0.5, frequency_hz = 4", 5},
                      Wave{"shape = \"triangle\", amplitude_mm = 0.5, frequency_hz = 0.1", 2},
                      Wave{"shape = \"sine\", amplitude_mm = 0.5, frequency_hz = 0.5", 5},
                      Wave{"shape = \"sine\", amplitude_mm = 0.5, frequency_hz = 2, deviation_mm = 0.1", 5},
                      Wave{"shape = \"sine\", amplitude_mm = 0.1, frequency_hz = 2, deviation_mm = 0.02", 5}));

TEST_P(WaveTimeTest, IsThePlansAndTheRunSaysWhichFrequencyItReached) {
  const auto& [text, cycles] = GetParam();
  start(R"(  { do = "pressurize", pressure_psi = 0, rate_psi_s = 5, settled_for_s = 0.01, timeout_s = 20 },
  { do = "wave", )" +
        std::string(text) + ", cycles = " + std::to_string(cycles) + " },");
  const auto& wave = plan.steps[1];
  ASSERT_TRUE(run_until(120.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }));
  const auto* done = event("wave.done");
  ASSERT_NE(done, nullptr);
  std::int64_t began_ns = -1;
  for (const auto& e : events)
    if (std::strcmp(e.code, "step") == 0 && e.step == 1) began_ns = e.mono_ns;
  const double took_s = 1e-9 * static_cast<double>(done->mono_ns - began_ns);
  std::printf("  %s: %.2f s, planned %.2f s; %.2f Hz\n", text, took_s, wave.nominal_s, done->value);
  EXPECT_NEAR(took_s, wave.nominal_s, 0.04 * wave.nominal_s);
  EXPECT_NEAR(done->value, cycles / took_s, 1e-3);
  EXPECT_EQ(done->threshold, wave.frequency_hz);
  EXPECT_THAT(done->text, ::testing::HasSubstr("a wave of "));
  EXPECT_EQ(done->step, 1U);
}

}  // namespace
}  // namespace isorig::daemon::test
