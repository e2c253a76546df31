// A force that the nominal model lacks, put in at a known place: the shares must say so, and cover what is
// true.
#include "identify/diagnose/explain/locate.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <ostream>

#include "concealed_specimen.hpp"
#include "identify/diagnose/noise/noise.hpp"

namespace isorig::identify {
namespace {

struct At {
  double t_s, position_mm, velocity_mm_s, excess_psi, since_s, travel_mm, way;
};
using Excess = std::function<double(const At&)>;

/// The bench's recording with its own true model, and a force more.
class Located {
 public:
  explicit Located(const Excess& excess) {
    const test::ConcealedSpecimen bench{.pressure_wander_psi = 0.1, .seed = 6};
    series_.push_back(prepare_series("bench", test::record(bench), {}));
    Series& series = series_.front();
    double travel_mm = 0.0, way = 0.0, follower_mm = 0.0;
    for (std::size_t k = 0; k < series.nodes.size(); ++k) {
      const model::Instant& node = series.nodes[k];
      travel_mm += std::fabs(node.step_mm);
      // A turn counts from 10 um on: twenty times the reading's noise, a hundredth of a stroke.
      const double before_mm = follower_mm;
      follower_mm = std::clamp(follower_mm, node.position_mm - 0.01, node.position_mm + 0.01);
      if (follower_mm != before_mm) way = follower_mm > before_mm ? 1.0 : -1.0;
      at_.push_back({node.t_s, node.position_mm, node.velocity_mm_s, node.excess_pressure_psi, series.since_corner_s[k],
                     travel_mm, way});
      series.force_N[k] += excess(at_.back());
    }
    nominal_ = model::nominal_model("slse1");
    nominal_.parts[0].coefficients = {bench.stiffness_N_mm};
    nominal_.parts[1].coefficients = {bench.arm_N_mm};
    nominal_.parts[1].parameters = {bench.arm_s};
    for (std::size_t i = 0; i < 2; ++i) nominal_.parts[i].fixed = true;
    places_ = locate(Problem(series_, {bench.force_noise_N, 0.0, 1.0}), nominal_, nominal_, 1.0);
  }

  /// The share of a variable over the whole recording; absent: below what is listed (3 %).
  [[nodiscard]] Place of(std::string_view covariate) const {
    for (const Place& place : places_)
      if (place.covariate == covariate && place.t_end_s - place.t_start_s > 1000.0) return place;
    return {};
  }
  [[nodiscard]] std::vector<Place> stretches() const {
    std::vector<Place> out;
    std::ranges::copy_if(places_, std::back_inserter(out),
                         [](const Place& p) { return p.covariate == "time" && p.t_end_s - p.t_start_s < 1000.0; });
    return out;
  }
  [[nodiscard]] const std::vector<Place>& places() const { return places_; }
  /// Power of a force, weighed by readings as the shares are.
  [[nodiscard]] double power(const Excess& excess) const {
    double sum = 0.0;
    for (std::size_t k = 0; k < at_.size(); ++k) sum += series_[0].count[k] * std::pow(excess(at_[k]), 2);
    return sum;
  }

 private:
  std::vector<Series> series_;
  std::vector<At> at_;
  model::ModelSpec nominal_;
  std::vector<Place> places_;
};

struct Variable {
  std::string_view name;
  Excess excess;
};
void PrintTo(const Variable& variable, std::ostream* out) {
  *out << variable.name;
}

class Carried : public testing::TestWithParam<Variable> {};
TEST_P(Carried, ByOneVariableIsSaidOfThatVariable) {
  const Located located(GetParam().excess);
  const Place place = located.of(GetParam().name);
  EXPECT_GT(place.share, 0.85);
  EXPECT_LE(place.share_low, place.share);
  EXPECT_GE(place.share_high, place.share);
  EXPECT_GT(place.share_high, 0.9);
  EXPECT_NE(place.text.find(GetParam().name), std::string::npos);
  for (const Place& other : located.places())
    EXPECT_LT(other.share, place.share + 0.1) << other.covariate << " before " << place.covariate;
  EXPECT_GT(place.nominal_rmse_N, 0.02) << "the error there is more than the noise";
}
const Variable kVariables[] = {
    {"position", [](const At& at) { return 0.2 * std::sin(4.0 * at.position_mm); }},
    {"rate", [](const At& at) { return 0.05 * at.velocity_mm_s; }},
    {"direction", [](const At& at) { return 0.1 * at.way; }},
    {"pressure", [](const At& at) { return 1.5 * at.excess_psi; }},
    {"history", [](const At& at) { return 0.4 * std::exp(-at.travel_mm / 15.0); }},
    {"hold", [](const At& at) { return 0.3 * at.way * std::exp(-at.since_s / 3.0); }},
};
INSTANTIATE_TEST_SUITE_P(ConcealedSpecimen, Carried, testing::ValuesIn(kVariables),
                         [](const auto& variable) { return std::string(variable.param.name); });

/// Two that know nothing of each other: the greater is first, and neither gets less than its part of the
/// power. It may get more: the pressure wanders for a minute and meets each place only a few times, so that a
/// table of the position takes some of it.
TEST(Locate, SharesAreNoLessThanTrueAndInTheirOrder) {
  for (const double size : {0.3, 2.0}) {
    const Excess ripple = [](const At& at) { return 0.15 * std::sin(5.0 * at.position_mm); };
    const Excess push = [size](const At& at) { return size * at.excess_psi; };
    const Located located([&](const At& at) { return ripple(at) + push(at); });
    const double a = located.power(ripple), b = located.power(push);
    const Place position = located.of("position"), pressure = located.of("pressure");
    EXPECT_EQ(position.share > pressure.share, a > b) << size;
    EXPECT_GE(position.share_high, 0.95 * a / (a + b)) << size;
    EXPECT_GE(pressure.share_high, 0.95 * b / (a + b)) << size;
    EXPECT_LT(position.share_high - position.share_low, 0.6) << size;
    EXPECT_LT(pressure.share_high - pressure.share_low, 0.6) << size;
  }
}

TEST(Locate, FindsTheTimeOfAnEvent) {
  const Located located([](const At& at) { return at.t_s > 600.0 && at.t_s < 640.0 ? 0.4 : 0.0; });
  const std::vector<Place> stretches = located.stretches();
  ASSERT_FALSE(stretches.empty());
  // A two-hundredth of the recording is what times are told in.
  const double grain_s = located.of("time").t_end_s / 200.0;
  double share = 0.0;
  for (const Place& place : stretches) {
    EXPECT_GT(place.t_start_s, 600.0 - 2.0 * grain_s);
    EXPECT_LT(place.t_end_s, 640.0 + 2.0 * grain_s);
    share += place.share;
  }
  EXPECT_GT(share, 0.85);
}

TEST(Locate, SaysNothingOfNoiseAlone) {
  const Located located([](const At&) { return 0.0; });
  for (const Place& place : located.places())
    EXPECT_LT(place.nominal_rmse_N, 0.03) << place.covariate << ": an error beyond the noise of 0.02 N";
}

}  // namespace
}  // namespace isorig::identify
