#include "identify/fv/campaign.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "iso_velocity_recording.hpp"

namespace isorig::identify {
namespace {

/// A small campaign of our own simulation: one mesh, control and urethane, two pressures, one repetition. The
/// control's kappa falls with pressure; the sheath raises the curve, less so at the higher pressure; the
/// spring stiffens.
std::vector<RecordingResult> recordings(bool with_control = true) {
  struct Case {
    const char* specimen;
    double pressure_psi;
    std::vector<model::StandardLinearSolid> elements;
  };
  const model::StandardLinearSolid low{150, 150, 30}, high{200, 120, 24};
  std::vector<Case> cases{{"Urethane1", 10, {low, {100, 300, 300}}}, {"Urethane1", 20, {high, {60, 120, 120}}}};
  if (with_control) {
    cases.push_back({"Control1", 10, {low}});
    cases.push_back({"Control1", 20, {high}});
  }
  std::vector<RecordingResult> out;
  for (const Case& c : cases) {
    testing::IsoVelocityTest test;
    test.elements = c.elements;
    test.precondition = false;
    test.return_speed_mm_s = 0.05;
    test.pressurized_length_mm = c.pressure_psi == 10 ? 82 : 75;
    auto r = testing::simulate(test);
    for (std::size_t i = 0; i < r.frame.size(); ++i)
      r.frame.force_N[i] += 0.2 * r.frame.position_mm[i] * r.frame.position_mm[i];
    r.metadata.specimen = c.specimen;
    r.metadata.nominal_pressure_psi = c.pressure_psi;
    FvOptions options;
    options.whole_series = false;
    out.push_back(analyse_recording(r, c.specimen, options));
  }
  return out;
}

const Trend& trend(const Campaign& c, std::string_view start) {
  for (const Trend& t : c.trends)
    if (t.claim.starts_with(start)) return t;
  throw std::out_of_range(std::string(start));
}

TEST(Campaign, NamesAreMaterialAndNumber) {
  EXPECT_EQ(parse_specimen("Urethane12").material, "Urethane");
  EXPECT_EQ(parse_specimen("Urethane12").number, "12");
  EXPECT_EQ(parse_specimen("Sample").number, "");
}

TEST(Campaign, TrendsThatWerePutInComeOut) {
  const Campaign c = analyse_campaign(recordings());
  EXPECT_EQ(c.fits, 4U);
  ASSERT_EQ(c.sheaths.curves.size(), 2U);
  for (const Curve& curve : c.sheaths.curves) {
    ASSERT_TRUE(curve.control) << curve.result.refusal;
    const auto& control = c.controls.curves[*curve.nominal_pressure_psi == 10 ? 0 : 1];
    EXPECT_EQ(curve.control->kappa, control.result.fit->parameter("kappa").value);
  }
  for (const char* claim :
       {"Larger response in extension", "More pressure lowers", "The arm's stiffness over the spring's, kappa, falls",
        "Urethane, 6 and 12 mm: higher", "Fits under-predict", "Fits over-predict"}) {
    const Trend& t = trend(c, claim);
    EXPECT_GT(t.of, 0) << claim;
    EXPECT_EQ(t.holds, t.of) << claim << ": " << t.measured;
  }
  EXPECT_EQ(trend(c, "Ecoflex").of, 0);
  EXPECT_THAT(trend(c, "Ecoflex").measured, ::testing::HasSubstr("no such specimens"));
}

TEST(Campaign, TrendsThatWereNotPutInDoNot) {
  // Pressures exchanged: everything that is said of pressure has to turn round.
  auto list = recordings();
  for (RecordingResult& r : list) r.nominal_pressure_psi = 30 - *r.nominal_pressure_psi;
  const Campaign c = analyse_campaign(std::move(list));
  EXPECT_EQ(trend(c, "More pressure lowers").holds, 0);
  EXPECT_EQ(trend(c, "The arm's stiffness over the spring's, kappa, falls").holds, 0);
  EXPECT_THAT(trend(c, "The arm's stiffness over the spring's, kappa, falls").measured,
              ::testing::HasSubstr("not in Control1 20 psi"));
}

/// An actuator that was only shortened has no height in extension: that is no case in which it is lower there.
TEST(Campaign, WhatWasNotMeasuredDoesNotHold) {
  auto list = recordings();
  for (RecordingResult& r : list) {
    if (!r.specimen.starts_with("Urethane")) continue;
    r.specimen = "Ecoflex1";
    std::erase_if(r.ramps.ramps, [](const Ramp& ramp) { return ramp.move.velocity_mm_s.value > 0.0; });
  }
  const Campaign c = analyse_campaign(std::move(list));
  ASSERT_FALSE(c.sheaths.curves.front().points.empty());
  EXPECT_TRUE(std::isnan(mean_response(c.sheaths.curves.front(), 1)));
  EXPECT_EQ(trend(c, "Ecoflex").holds, 0);
  EXPECT_EQ(trend(c, "Ecoflex").of, 0) << trend(c, "Ecoflex").measured;
  EXPECT_EQ(trend(c, "Larger response in extension").of, 2) << "the controls";
  EXPECT_EQ(trend(c, "More pressure lowers").of, 2) << "both actuators";
}

TEST(Campaign, NeedsAControl) {
  EXPECT_THROW(analyse_campaign(recordings(false)), std::invalid_argument);
}

TEST(Campaign, ReportHoldsTheFiguresOfThePaper) {
  const auto folder = std::filesystem::path(::testing::TempDir()) / "campaign-report";
  std::filesystem::remove_all(folder);
  write_campaign_report(analyse_campaign(recordings()), folder, "Simulated <here>.");
  std::ifstream in(folder / "campaign-report.html");
  const std::string html(std::istreambuf_iterator<char>(in), {});
  EXPECT_THAT(html, ::testing::HasSubstr("Simulated \\u003chere>."));
  for (const char* name : {"parameter_sweeps", "ramps_overlaid", "force_velocity_curves", "comparison_urethane1"}) {
    EXPECT_THAT(html, ::testing::HasSubstr(std::string("\"figure\":{\"name\":\"") + name + "\"")) << name;
  }
  std::ifstream json(folder / "campaign.json");
  EXPECT_EQ(nlohmann::json::parse(json)["format"], "isorig-campaign/1");
  EXPECT_TRUE(std::filesystem::exists(folder / "fv-controls/fv.json"));
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace isorig::identify
