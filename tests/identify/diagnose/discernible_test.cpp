// What a recording can show: against simulations with the effect at the size that the linear sum names.
#include "identify/diagnose/explain/discernible.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "concealed_specimen.hpp"
#include "identify/diagnose/noise/noise.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify {
namespace {

struct Looked {
  explicit Looked(std::vector<Series> recorded)
      : series(std::move(recorded)),
        search(series, {0.02, 0.0, 1.0}, 2),
        nominal(search.nominal(model::nominal_model("slse1"))),
        all(discernible(search, nominal, 2)) {}

  [[nodiscard]] const Discernible& of(std::string_view name) const {
    return *std::ranges::find_if(all, [&](const Discernible& d) { return d.effect->name == name; });
  }

  std::vector<Series> series;
  Search search;
  Hypothesis nominal;
  std::vector<Discernible> all;
};

std::vector<Series> prepared(messages::Recording recording) {
  return {prepare_series("bench", std::move(recording), {})};
}

// A drag of the size that is seen with z = 4 leaves 16 squares beside the best nominal model. In a recording without
// noise of the force they are all that it adds; the time constant gives way in the second order of that size.
TEST(Discernible, AnEffectOfTheSizeThatIsSeenLeavesSixteenSquares) {
  const Looked before(prepared(test::record_other({.force_noise_N = 0.0, .force_step_N = 0.0, .seed = 3})));
  const Discernible& drag = before.of("viscous_drag");
  ASSERT_TRUE(std::isfinite(drag.seen_from_N));
  std::vector<Series> changed = before.series;
  std::vector<double> speeds_mm_s;
  for (const auto& node : changed[0].nodes) speeds_mm_s.push_back(std::fabs(node.velocity_mm_s));
  std::ranges::sort(speeds_mm_s);
  const double fast_mm_s = speeds_mm_s[speeds_mm_s.size() * 99 / 100];
  for (std::size_t k = 0; k < changed[0].nodes.size(); ++k)
    changed[0].force_N[k] += drag.seen_from_N * changed[0].nodes[k].velocity_mm_s / fast_mm_s;
  const Problem problem(changed, {0.02, 0.0, 1.0});
  const double left = problem.fit(before.nominal.fit.spec, 50).chi2 - before.nominal.ls_chi2;
  EXPECT_NEAR(left, 16.0, 2.0);
}

TEST(Discernible, TwiceTheNoiseNeedsTwiceTheSize) {
  const messages::Recording recording = test::record_other({.seed = 4});
  const std::vector<Series> series = prepared(recording);
  const Search once(series, {0.02, 0.0, 1.0}, 2), twice(series, {0.04, 0.0, 1.0}, 2);
  const Hypothesis nominal = once.nominal(model::nominal_model("slse1"));
  const auto a = discernible(once, nominal, 2), b = discernible(twice, nominal, 2);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!std::isfinite(a[i].seen_from_N)) continue;
    EXPECT_NEAR(b[i].seen_from_N / a[i].seen_from_N, 2.0, 1e-6) << a[i].effect->name;
    EXPECT_EQ(a[i].nearest, b[i].nearest) << a[i].effect->name;
  }
}

// A lag of 20 ms and a dead time of 20 ms differ in the second order of 20 ms over the duration of an onset; a drift
// and a mass have nothing in common. Every effect is seen before it is told from its nearest rival.
TEST(Discernible, LikeEffectsAreEachOthersNearest) {
  const Looked on(prepared(test::record({.seed = 5})));
  EXPECT_EQ(on.of("force_lag").nearest->name, "force_delay");
  EXPECT_EQ(on.of("force_delay").nearest->name, "force_lag");
  EXPECT_GT(on.of("force_lag").told_from_N, 1.5 * on.of("force_lag").seen_from_N);
  EXPECT_NE(on.of("zero_drift").nearest->name, "fixture_inertia");
  for (const Discernible& one : on.all) EXPECT_GE(one.told_from_N, one.seen_from_N) << one.effect->name;
}

}  // namespace
}  // namespace isorig::identify
