#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "page_links.hpp"
#include "pieces_of_test.hpp"

/// Force-velocity analyses of very many recordings, and of the paper's figures, as a user asks for them.
namespace isorig {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using pieces_test::page_data;
using system_test::isorig;
using system_test::slurp;
using system_test::spit;
using system_test::TempDir;
using ::testing::AllOf;
using ::testing::HasSubstr;

/// kappa 0.5 and gamma 1 of a control; its sheath has beta 0.5, kappa 2 and gamma 20.
std::string record(const fs::path& folder, const std::string& specimen, unsigned seed) {
  identify::testing::IsoVelocityTest test;
  test.speeds_mm_s = {0.05, 0.5, 2, 5, 10};
  test.force_noise_N = 0.005;
  test.precondition = false;
  test.seed = seed;
  test.elements = {{200.0, 100.0, 100.0}};
  if (!specimen.starts_with("Control")) test.elements.push_back({100.0, 200.0, 10.0});
  messages::Recording made = identify::testing::simulate(test);
  made.metadata.specimen = specimen;
  made.metadata.nominal_pressure_psi = 10.0;
  const fs::path place = folder / specimen / ("rep-" + std::to_string(seed));
  messages::write_recording(place, made);
  return place.string();
}

/// The paper's figures take minutes of hundreds of recordings: one that is damaged does not cost the others.
TEST(CampaignFv, ThePapersFiguresLeaveOutWhatCannotBeRead) {
  const TempDir dir;
  const std::string control = record(dir / "r", "Control1", 1), sheath = record(dir / "r", "Ecoflex1", 2),
                    bad = record(dir / "r", "Ecoflex1", 3);
  spit(fs::path(bad) / "frame.csv", "t_s,position_mm,force_N\n0,0,zero\n");
  const auto said = isorig(dir, {"campaign", control, bad, sheath, "--out", (dir / "out").string()}, 120.0);
  EXPECT_EQ(said.code, 3) << said.text;
  EXPECT_THAT(said.text, HasSubstr("rep-3/frame.csv:2"));
  EXPECT_THAT(said.text, HasSubstr("1 of 3 recordings cannot be read, and are left out"));
  const json campaign = json::parse(slurp(dir / "out/campaign.json"));
  EXPECT_EQ(campaign["fits"], 2);
  ASSERT_EQ(campaign["left_out"].size(), 1U);
  EXPECT_EQ(campaign["left_out"][0]["recording"], bad);
  EXPECT_THAT(campaign["left_out"][0]["why"].get<std::string>(), HasSubstr("frame.csv:2"));
  EXPECT_THAT(page_data(dir / "out/campaign-report.html").dump(),
              AllOf(HasSubstr("1 recording cannot be read"), HasSubstr("rep-3/frame.csv:2")));
  const auto none = isorig(dir, {"campaign", bad, "--out", (dir / "none").string()});
  EXPECT_EQ(none.code, 3) << none.text;
  EXPECT_FALSE(fs::exists(dir / "none"));
}

}  // namespace
}  // namespace isorig
