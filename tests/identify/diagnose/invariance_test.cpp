// The same recording told in other words: what a diagnosis finds must not hang on how a laboratory counts time, length,
// force and positions, or on the order of its files (metamorphic relations, Chen et al. 1998).
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

#include "concealed_specimen.hpp"
#include "identify/diagnose/diagnosis.hpp"

namespace isorig::identify {
namespace {

using Recordings = std::vector<messages::Recording>;

struct Found {
  Verdict verdict = Verdict::kConsistent;
  std::vector<std::string> names;
  double noise_N = 0.0;
  bool whole = false;   ///< model.toml holds all that was found
  double closed = 0.0;  ///< share of the nominal model's rms that is gone
};

Found found_in(Recordings recordings) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < recordings.size(); ++i) names.push_back("recording " + std::to_string(i));
  const Diagnosis d = diagnose(std::move(recordings), names, model::nominal_model("slse1"), {}).diagnosis;
  Found out{d.verdict,
            {},
            d.noise_N,
            d.not_modelled.why.empty(),
            1.0 - d.model_errors.train_rmse_N / d.nominal_errors.train_rmse_N};
  for (const MissingEffect& missing : d.missing) out.names.emplace_back(missing.effect->name);
  return out;
}

messages::Recording with_friction(unsigned seed) {
  return test::record({.friction_N = 0.8, .seed = seed});
}

void for_each_time(messages::Recording& r, const std::function<double(double)>& change) {
  for (double& t_s : r.frame.t_s) t_s = change(t_s);
  if (r.pressure)
    for (double& t_s : r.pressure->t_s) t_s = change(t_s);
}

void times_the_length(messages::Recording& r, double factor) {
  for (double& x_mm : r.frame.position_mm) x_mm *= factor;
  *r.metadata.rest_length_mm *= factor;
  if (r.metadata.pressurized_rest_length_mm) *r.metadata.pressurized_rest_length_mm *= factor;
}

struct Retold {
  const char* name;
  std::function<void(messages::Recording&)> change;
  double force = 1.0;  ///< its unit, in that of before
};

class Invariance : public testing::TestWithParam<Retold> {};

TEST_P(Invariance, TheSameIsFound) {
  static const Found plain = found_in({with_friction(31)});
  ASSERT_EQ(plain.verdict, Verdict::kMissingPhysics);
  messages::Recording retold = with_friction(31);
  GetParam().change(retold);
  const Found found = found_in({std::move(retold)});
  EXPECT_EQ(found.verdict, plain.verdict);
  EXPECT_EQ(found.names, plain.names);
  // Sampling at half the rate changes what is known of the corners, the rest only roundings.
  EXPECT_NEAR(found.closed, plain.closed, 0.05);
  EXPECT_TRUE(found.whole);
  // Rests of half as many readings, or of other ones, tell the noise to a few per cent.
  EXPECT_NEAR(found.noise_N / GetParam().force, plain.noise_N, 0.1 * plain.noise_N);
}

INSTANTIATE_TEST_SUITE_P(
    Retold, Invariance,
    testing::Values(Retold{"ClockOffset", [](auto& r) { for_each_time(r, [](double t_s) { return t_s + 1000.0; }); }},
                    Retold{"ZeroOfThePosition",
                           [](auto& r) {
                             for (double& x : r.frame.position_mm) x += 3.0;
                             *r.metadata.rest_length_mm -= 3.0;
                           }},
                    Retold{"ZeroOfTheForce",
                           [](auto& r) {
                             for (double& f : r.frame.force_N) f += 5.0;
                           }},
                    Retold{"TenTimesTheForce",
                           [](auto& r) {
                             for (double& f : r.frame.force_N) f *= 10.0;
                           },
                           10.0},
                    Retold{"HundredTimesTheLength", [](auto& r) { times_the_length(r, 100.0); }},
                    Retold{"TenthOfTheLength", [](auto& r) { times_the_length(r, 0.1); }},
                    Retold{"TenTimesAsFast", [](auto& r) { for_each_time(r, [](double t_s) { return 0.1 * t_s; }); }},
                    Retold{"TenTimesAsSlow", [](auto& r) { for_each_time(r, [](double t_s) { return 10.0 * t_s; }); }},
                    Retold{"TimeTwiceAsFast", [](auto& r) { for_each_time(r, [](double t_s) { return 0.5 * t_s; }); }},
                    Retold{"EverySecondRow",
                           [](auto& r) {
                             messages::FrameSamples half;
                             for (std::size_t k = 0; k < r.frame.size(); k += 2) {
                               half.t_s.push_back(r.frame.t_s[k]);
                               half.position_mm.push_back(r.frame.position_mm[k]);
                               half.force_N.push_back(r.frame.force_N[k]);
                             }
                             r.frame = std::move(half);
                           }}),
    [](const auto& of) { return std::string(of.param.name); });

/// A knee in the elastic force, the position counted from elsewhere.
TEST(InvarianceOfAPlace, TheKneeIsFoundWhereverThePositionBegins) {
  for (const double zero_mm : {0.0, 20.0, 300.0}) {
    messages::Recording r = test::record({.seed = 33});
    for (std::size_t k = 0; k < r.frame.size(); ++k) {
      r.frame.force_N[k] += 1.5 * std::max(r.frame.position_mm[k] - 0.7, 0.0);
      r.frame.position_mm[k] += zero_mm;
    }
    const Found found = found_in({std::move(r)});
    EXPECT_EQ(found.verdict, Verdict::kMissingPhysics) << zero_mm;
    EXPECT_EQ(found.names, std::vector<std::string>{"strain_stiffening"}) << zero_mm;
  }
}

/// An event is in one recording, whichever is named first.
TEST(InvarianceOfSeveral, TheOrderOfARecordingWithASlip) {
  const auto without = test::record({.seed = 31}), with = test::record({.slip_mm = 0.2, .slip_s = 400.0, .seed = 32});
  const Found one = found_in({with, without}), other = found_in({without, with});
  EXPECT_EQ(one.names, std::vector<std::string>{"grip_slip"});
  EXPECT_EQ(other.names, one.names);
  EXPECT_EQ(other.verdict, one.verdict);
  EXPECT_NEAR(other.closed, one.closed, 1e-3);
}

/// What happened before the first reading is another zero of the force, and no event that was seen.
TEST(InvarianceOfSeveral, AnotherZeroOfTheForceIsNoSlip) {
  const auto first = test::record({.seed = 31});
  auto second = test::record({.seed = 32});
  for (double& force_N : second.frame.force_N) force_N -= 0.3;
  const Found one = found_in({second, first}), other = found_in({first, second});
  for (const Found& found : {one, other}) EXPECT_EQ(std::ranges::count(found.names, "grip_slip"), 0);
  EXPECT_EQ(one.verdict, other.verdict);
  EXPECT_EQ(one.names, other.names);
}

/// The rows of `whole` from the share `from` of them up to `to`, with the clock that it has.
messages::Recording piece(const messages::Recording& whole, double from, double to) {
  messages::Recording r = whole;
  const auto row = [&](double share) {
    return static_cast<std::ptrdiff_t>(share * static_cast<double>(whole.frame.size()));
  };
  for (auto member :
       {&messages::FrameSamples::t_s, &messages::FrameSamples::position_mm, &messages::FrameSamples::force_N})
    (r.frame.*member).assign((whole.frame.*member).begin() + row(from), (whole.frame.*member).begin() + row(to));
  return r;
}

/// A logger that begins a new file does so in mid-stroke, where the arms hold what the strokes before have left in
/// them.
TEST(InvarianceOfSeveral, ARecordingThatIsCutInTwo) {
  const messages::Recording whole = test::record({.seed = 31});
  const Found one = found_in({whole});
  for (const double share : {0.2, 0.27, 0.4, 0.45, 0.55, 0.7, 0.8}) {
    const Found two = found_in({piece(whole, 0.0, share), piece(whole, share, 1.0)});
    EXPECT_EQ(two.verdict, one.verdict) << share;
    EXPECT_EQ(two.names, one.names) << share;
  }
}

TEST(InvarianceOfSeveral, TheOrderOfTheRecordings) {
  const Found one = found_in({with_friction(31), with_friction(32)});
  const Found other = found_in({with_friction(32), with_friction(31)});
  EXPECT_EQ(one.verdict, Verdict::kMissingPhysics);
  EXPECT_EQ(other.verdict, one.verdict);
  EXPECT_EQ(other.names, one.names);
  EXPECT_NEAR(other.closed, one.closed, 1e-3);
}

}  // namespace
}  // namespace isorig::identify
