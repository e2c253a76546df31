// What a rig's own recording begins and ends with is not the specimen's test.
#include "identify/diagnose/filling.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace isorig::identify {
namespace {

/// 100 s at 10 Hz: nothing for 5 s, up to `nominal_psi` within 10 s, held, let go at 90 s when `vented`.
messages::Recording session(double nominal_psi, bool filled, bool vented) {
  messages::Recording out;
  out.metadata.rest_length_mm = 100.0;
  out.metadata.nominal_pressure_psi = nominal_psi;
  out.pressure.emplace();
  for (int i = 0; i <= 1000; ++i) {
    const double t_s = 0.1 * i;
    double share = filled ? 1.0 : std::fmin(std::fmax((t_s - 5.0) / 10.0, 0.0), 1.0);
    if (vented && t_s > 90.0) share = std::exp(-(t_s - 90.0));
    out.frame.t_s.push_back(t_s);
    out.frame.position_mm.push_back(std::sin(t_s));
    out.frame.force_N.push_back(2.0 * share);
    out.pressure->t_s.push_back(t_s + 0.03);
    out.pressure->pressure_psi.push_back(nominal_psi * share + 0.02 * std::sin(7.0 * t_s));
  }
  return out;
}

TEST(Filling, IsCutAtBothEnds) {
  auto recording = session(15.0, false, true);
  const auto cut = cut_filling(recording);
  ASSERT_TRUE(cut);
  EXPECT_EQ(cut->kind, "filling");
  EXPECT_EQ(recording.frame.size() + cut->rows, 1001U);
  // 95 % of the pressure is there at 14.5 s and has stayed for a second at 15.5 s.
  EXPECT_NEAR(recording.frame.t_s.front(), 15.5, 0.3);
  EXPECT_LT(recording.frame.t_s.back(), 90.0);
  EXPECT_GT(recording.frame.t_s.back(), 88.0);
  EXPECT_EQ(recording.frame.position_mm.size(), recording.frame.size());
  EXPECT_EQ(recording.frame.force_N.size(), recording.frame.size());
  EXPECT_NEAR(recording.frame.position_mm.front(), std::sin(recording.frame.t_s.front()), 1e-12);
  EXPECT_GE(recording.pressure->t_s.front(), recording.frame.t_s.front() - 0.1);
  EXPECT_LE(recording.pressure->t_s.back(), recording.frame.t_s.back() + 0.1);
  EXPECT_EQ(recording.pressure->size(), recording.pressure->pressure_psi.size());
}

TEST(Filling, NothingIsCutUnderPressureOrWithoutAny) {
  auto filled = session(15.0, true, false);
  EXPECT_FALSE(cut_filling(filled));
  EXPECT_EQ(filled.frame.size(), 1001U);
  auto dry = session(15.0, false, true);
  dry.pressure.reset();
  EXPECT_FALSE(cut_filling(dry));
  auto nameless = session(15.0, false, true);
  nameless.metadata.nominal_pressure_psi.reset();
  EXPECT_FALSE(cut_filling(nameless));
  // It never gets there: a leak or a wrong number in recording.toml, to be seen and not cut away.
  auto never = session(15.0, false, false);
  never.metadata.nominal_pressure_psi = 30.0;
  EXPECT_FALSE(cut_filling(never));
  EXPECT_EQ(never.frame.size(), 1001U);
}

}  // namespace
}  // namespace isorig::identify
