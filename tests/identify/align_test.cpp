#include "identify/fv/align.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "iso_velocity_recording.hpp"

namespace isorig::identify {
namespace {

struct Case {
  double offset_s = 7.3;  ///< t_frame - t_pressure at pressure time 0
  double skew = 0.0;
  double response = -0.15;  ///< psi/mm
  double recovery_per_s = 1.2;
  double noise_psi = 0.01;
  double wander_psi = 0.0;  ///< slow regulator wander, rms
  double step_s = 0.02;
  unsigned seed = 1;
};

/// A pressure stream as the microcontroller would have it: own clock, own noise, the strokes' response in it.
messages::PressureSamples pressure_of(const messages::FrameSamples& frame, const Case& c) {
  std::mt19937 random(c.seed);
  std::normal_distribution<double> unit;
  std::vector<double> s(frame.size(), 0.0);
  for (std::size_t i = 1; i < frame.size(); ++i) {
    const double u = c.recovery_per_s * (frame.t_s[i] - frame.t_s[i - 1]);
    s[i] = s[i - 1] * std::exp(-u) + (frame.position_mm[i] - frame.position_mm[i - 1]) * model::maxwell_ramp_share(u);
  }
  messages::PressureSamples out;
  double wander = 0.0;
  std::size_t k = 0;
  const double last = (frame.t_s.back() - c.offset_s) / (1.0 + c.skew);
  for (double t = std::max(0.0, -c.offset_s); t < last; t += c.step_s) {
    const double on_frame = c.offset_s + (1.0 + c.skew) * t;
    while (k + 2 < frame.size() && frame.t_s[k + 1] < on_frame) ++k;
    const double w = std::clamp((on_frame - frame.t_s[k]) / (frame.t_s[k + 1] - frame.t_s[k]), 0.0, 1.0);
    wander += -wander * c.step_s / 30.0 + c.wander_psi * std::sqrt(2.0 * c.step_s / 30.0) * unit(random);
    out.t_s.push_back(t);
    out.pressure_psi.push_back(10.0 + c.response * ((1 - w) * s[k] + w * s[k + 1]) + wander +
                               c.noise_psi * unit(random));
  }
  return out;
}

const messages::Recording& paper_session() {
  static const messages::Recording recording = [] {
    testing::IsoVelocityTest test;
    test.precondition = false;
    return testing::simulate(test);
  }();
  return recording;
}

TEST(Align, FindsOffsetAndSkewWithinItsOwnErrors) {
  // Normalised errors over 12 cases: mean square 1 with a standard deviation of 0.41.
  double square = 0.0;
  int count = 0;
  for (double skew : {-90e-6, 0.0, 40e-6, 200e-6})
    for (unsigned seed : {1U, 2U, 3U}) {
      Case c;
      c.skew = skew;
      c.offset_s = seed == 1 ? 7.3 : seed == 2 ? -25.0 : 311.7;
      c.seed = seed;
      const auto result = align(paper_session().frame, pressure_of(paper_session().frame, c));
      SCOPED_TRACE(::testing::Message() << "skew " << skew << " offset " << c.offset_s);
      ASSERT_TRUE(result.aligned) << result.refusal;
      const Alignment& a = result.alignment;
      ASSERT_TRUE(a.skew_known);
      const double truth = c.offset_s + c.skew * a.reference_s;
      EXPECT_NEAR(a.offset_s.value, truth, 5 * a.offset_s.standard_error);
      EXPECT_NEAR(a.skew.value, skew, 5 * a.skew.standard_error);
      EXPECT_LT(a.offset_s.standard_error, 0.005);
      EXPECT_LT(a.skew.standard_error, 5e-6);
      EXPECT_NEAR(a.response, c.response, 0.01);
      square += std::pow((a.offset_s.value - truth) / a.offset_s.standard_error, 2);
      ++count;
    }
  EXPECT_LT(square / count, 3.0);
  EXPECT_GT(square / count, 0.1);
}

TEST(Align, WorksInRegulatorWanderAndCoarseSampling) {
  Case c;
  c.wander_psi = 0.05;
  c.noise_psi = 0.03;
  c.step_s = 0.1;
  c.skew = 60e-6;
  const auto result = align(paper_session().frame, pressure_of(paper_session().frame, c));
  ASSERT_TRUE(result.aligned) << result.refusal;
  const double truth = c.offset_s + c.skew * result.alignment.reference_s;
  EXPECT_NEAR(result.alignment.offset_s.value, truth, 5 * result.alignment.offset_s.standard_error);
  EXPECT_LT(result.alignment.worst_error_s, 0.1);
}

TEST(Align, RefusesAPressureWithoutResponse) {
  for (unsigned seed : {1U, 2U, 3U, 4U}) {
    Case c;
    c.response = 0.0;
    c.wander_psi = seed % 2 == 0 ? 0.05 : 0.0;
    c.seed = seed;
    const auto result = align(paper_session().frame, pressure_of(paper_session().frame, c));
    EXPECT_FALSE(result.aligned);
    EXPECT_THAT(result.refusal, ::testing::HasSubstr("does not stand out"));
  }
}

TEST(Align, RefusesWhenStrokesRepeatWithoutAnEnd) {
  // Equal strokes, evenly spaced, and a pressure stream that holds some of them: no lag is better than the
  // next.
  messages::FrameSamples frame;
  std::mt19937 random(2);
  std::normal_distribution<double> unit;
  for (double t = 0; t < 600; t += 0.02) {
    const double phase = std::fmod(t, 20.0);
    frame.t_s.push_back(t);
    frame.position_mm.push_back((phase < 5      ? 0
                                 : phase < 5.4  ? 5 * (phase - 5)
                                 : phase < 15   ? 2
                                 : phase < 15.4 ? 2 - 5 * (phase - 15)
                                                : 0) +
                                5e-4 * unit(random));
    frame.force_N.push_back(30);
  }
  Case c;
  c.offset_s = 103.0;
  auto pressure = pressure_of(frame, c);
  pressure.t_s.resize(10000);
  pressure.pressure_psi.resize(10000);
  const auto result = align(frame, pressure);
  EXPECT_FALSE(result.aligned);
  EXPECT_THAT(result.refusal, ::testing::HasSubstr("nearly alike"));
  // The refusal is right: shifted by one period the pressure fits the strokes as well, so no method could
  // tell.
}

TEST(Align, ResponsesThatRepeatAreNotCalledNone) {
  // Strokes without a pause: at every half period the response fits, so that it stands out of nothing.
  messages::FrameSamples frame;
  for (double t = 0; t < 300; t += 0.02) {
    frame.t_s.push_back(t);
    frame.position_mm.push_back(2.0 * std::sin(2.0 * M_PI * t / 8.0));
    frame.force_N.push_back(30);
  }
  Case c;
  c.offset_s = 40.0;
  const auto result = align(frame, pressure_of(frame, c));
  EXPECT_FALSE(result.aligned);
  EXPECT_THAT(result.refusal, ::testing::HasSubstr("follows the strokes"));
  EXPECT_THAT(result.refusal, ::testing::Not(::testing::HasSubstr("stand out")));
}

TEST(Align, OneStrokeGivesAnOffsetButNoSkew) {
  testing::IsoVelocityTest test;
  test.speeds_mm_s = {5};
  test.precondition = false;
  auto frame = testing::simulate(test).frame;
  const auto cut =
      static_cast<std::size_t>(std::lower_bound(frame.t_s.begin(), frame.t_s.end(), 70.0) - frame.t_s.begin());
  frame.t_s.resize(cut);
  frame.position_mm.resize(cut);
  frame.force_N.resize(cut);
  Case c;
  c.offset_s = 2.0;
  const auto result = align(frame, pressure_of(frame, c));
  ASSERT_TRUE(result.aligned) << result.refusal;
  EXPECT_FALSE(result.alignment.skew_known);
  EXPECT_NEAR(result.alignment.offset_s.value, 2.0, 5 * result.alignment.offset_s.standard_error);
}

TEST(Align, RefusesStillStreams) {
  messages::FrameSamples frame;
  for (double t = 0; t < 100; t += 0.1) {
    frame.t_s.push_back(t);
    frame.position_mm.push_back(0.0);
    frame.force_N.push_back(1.0);
  }
  Case c;
  EXPECT_THAT(align(frame, pressure_of(paper_session().frame, c)).refusal, ::testing::HasSubstr("nothing moves"));
}

}  // namespace
}  // namespace isorig::identify
