#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <sstream>

#include "base/formatted.hpp"
#include "cli/campaign/control.hpp"
#include "identify/report/page.hpp"
#include "page_links.hpp"
#include "pieces_of_test.hpp"

/// Force-velocity analyses of very many recordings, and of the paper's figures, as a user asks for them.
namespace isorig {
namespace {

namespace fs = std::filesystem;
using cli::pieces::Ask;
using cli::pieces::model_words;
using nlohmann::json;
using pieces_test::block_of;
using pieces_test::broken_links;
using pieces_test::links_in;
using pieces_test::page_data;
using system_test::isorig;
using system_test::slurp;
using system_test::spit;
using system_test::TempDir;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;

TEST(CampaignFv, ASheathIsFittedOnTheControlThatItsNameSays) {
  const Ask ask{.command = "fv", .model = "slse2", .control = "/lab/fv.json"};
  const std::vector<std::string> paper{"Control1", "Control2"}, own{"bare tube"};
  const auto on = [](const std::string& control) {
    return ElementsAre("--model", "slse2", "--control", "/lab/fv.json", "--control-specimen", control);
  };
  const auto alone = ElementsAre("--model", "slse1");
  EXPECT_THAT(model_words(ask, paper, "Ecoflex2"), on("Control2"));
  EXPECT_THAT(model_words(ask, paper, "Control1"), alone);
  EXPECT_THAT(model_words(ask, paper, "Control7"), alone) << "a control needs none";
  EXPECT_THAT(model_words(ask, own, "bare tube"), alone);
  EXPECT_THAT(model_words(ask, own, "tube in silicone"), on("bare tube"));
  EXPECT_THAT(model_words(ask, {"Control2"}, "Ecoflex2"), on("Control2"));
  for (const auto& [controls, specimen] :
       {std::pair{paper, "Ecoflex3"}, {std::vector<std::string>{"Control1"}, "Ecoflex2"}, {paper, "sleeve"}})
    EXPECT_THAT([&] { (void)model_words(ask, controls, specimen); },
                ThrowsMessage<std::runtime_error>(AllOf(HasSubstr(specimen), HasSubstr("Control1"))));
  EXPECT_THAT(model_words({.command = "fv"}, {}, "Ecoflex1"), alone);
}

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

std::vector<std::string> cells(const std::string& line) {
  std::vector<std::string> out(1);
  bool quoted = false;
  for (const char c : line) {
    if (c == '"')
      quoted = !quoted;
    else if (c == ',' && !quoted)
      out.emplace_back();
    else
      out.back() += c;
  }
  return out;
}

TEST(CampaignFv, TheSetOfThePaperControlsAndSheathsWithTheirNumbers) {
  const TempDir dir;
  std::vector<std::string> controls{record(dir / "r", "Control1", 1), record(dir / "r", "Control1", 2)}, all = controls;
  all.push_back(record(dir / "r", "Ecoflex1", 3));
  all.push_back(record(dir / "r", "Ecoflex1", 4));
  all.push_back(record(dir / "r", "Urethane2", 5));  // whose control nobody has analysed
  const auto fv_of = [&](std::vector<std::string> recordings, const std::string& out,
                         const std::vector<std::string>& more) {
    recordings.insert(recordings.begin(), "fv");
    recordings.insert(recordings.end(), more.begin(), more.end());
    recordings.insert(recordings.end(), {"--out", (dir / out).string()});
    const auto said = isorig(dir, recordings);
    EXPECT_EQ(said.code, 0) << said.text;
    return json::parse(slurp(dir / out / "fv.json"));
  };
  const json control = fv_of(controls, "controls", {});
  const std::string control_file = (dir / "controls/fv.json").string();

  std::vector<std::string> words{
      "campaign", "--ask", "fv", "--model", "slse2", "--control", control_file, "--out", (dir / "out").string()};
  words.insert(words.end(), all.begin(), all.end());
  const auto said = isorig(dir, words, 120.0);
  EXPECT_EQ(said.code, 1) << said.text;
  EXPECT_THAT(said.text, HasSubstr("4 of 5 recordings answered; 1 failed"));
  const json table = json::parse(slurp(dir / "out/campaign.json"));
  double mean = 0.0, squares = 0.0;
  for (const std::size_t i : {0U, 1U, 2U, 3U})
    mean += table["recordings"][i]["fit"]["fit"]["r_squared"].get<double>() / 4.0;
  for (const std::size_t i : {0U, 1U, 2U, 3U})
    squares += std::pow(table["recordings"][i]["fit"]["fit"]["r_squared"].get<double>() - mean, 2);
  // Never rounded up to a perfect fit; the deviation has two digits, which err by 5 % at most.
  const auto lead = "4 fits, R² " + identify::report::r_squared_text(mean) + " ± ";
  const auto at = said.text.find(lead);
  ASSERT_NE(at, std::string::npos) << lead << " in " << said.text;
  const double told_sd = std::strtod(said.text.c_str() + at + lead.size(), nullptr);
  EXPECT_NEAR(told_sd, std::sqrt(squares / 3.0), 0.05 * std::sqrt(squares / 3.0));
  EXPECT_THAT(table["recordings"][4]["why"].get<std::string>(),
              AllOf(HasSubstr("'Urethane2'"), HasSubstr("would be Control2"), HasSubstr("which has Control1")));
  // Each row has what `isorig fv` says of the recording alone.
  for (const std::size_t i : {0U, 2U}) {
    const bool sheath = i == 2;
    const json alone = sheath ? fv_of({all[i]}, "alone", {"--model", "slse2", "--control", control_file})
                              : fv_of({all[i]}, "alone", {});
    const json& row = table["recordings"][i]["fit"];
    EXPECT_EQ(row["model"], sheath ? "slse2" : "slse1");
    for (const char* key : {"fit", "means", "initial_strain", "strain_step", "refusal"})
      EXPECT_EQ(row[key], alone["curves"][0][key]) << key;
  }
  const json& sheath = table["recordings"][2]["fit"];
  EXPECT_EQ(sheath["control"]["kappa"], control["curves"][0]["fit"]["parameters"]["kappa"]["value"]);
  EXPECT_NEAR(sheath["fit"]["parameters"]["beta"]["value"].get<double>(), 0.5, 0.15);

  std::istringstream csv(slurp(dir / "out/campaign.csv"));
  std::vector<std::vector<std::string>> lines;
  for (std::string line; std::getline(csv, line);) lines.push_back(cells(line));
  ASSERT_EQ(lines.size(), 6U);
  const auto cell = [&](std::size_t row, const std::string& name) {
    return lines[row + 1].at(static_cast<std::size_t>(std::ranges::find(lines[0], name) - lines[0].begin()));
  };
  for (const auto& line : lines) EXPECT_EQ(line.size(), lines[0].size());
  EXPECT_DOUBLE_EQ(std::stod(cell(2, "r_squared")), sheath["fit"]["r_squared"].get<double>());
  EXPECT_DOUBLE_EQ(std::stod(cell(2, "beta_ci95_high")), sheath["fit"]["parameters"]["beta"]["ci95"][1].get<double>());
  EXPECT_EQ(cell(0, "beta"), "") << "a control has none";
  EXPECT_EQ(cell(0, "gamma_per_s_identifiable"), "yes");
  EXPECT_EQ(cell(2, "model"), "slse2");
  EXPECT_EQ(std::ranges::count(cell(2, "curve"), ';') + 1, static_cast<long>(sheath["means"].size()));
  EXPECT_EQ(cell(4, "r_squared"), "");

  const json page = page_data(dir / "out/campaign-report.html");
  const json rows = block_of(page, "table", "recording");
  ASSERT_FALSE(rows.is_null());
  EXPECT_EQ(rows["rows"][2][5], "slse2");
  EXPECT_THAT(rows["rows"][2][6].get<std::string>(), HasSubstr("0.99"));
  EXPECT_THAT(rows["rows"][2][9].get<std::string>(), HasSubstr("["));
  const json grid = block_of(page, "grid");
  ASSERT_FALSE(grid.is_null());
  EXPECT_EQ(links_in(grid).size(), 5U);
  EXPECT_THAT(grid["rows"][0]["cells"][0][0]["text"].get<std::string>(), HasSubstr("0.99"));
  const json figure = block_of(page, "figure");
  ASSERT_FALSE(figure.is_null());
  EXPECT_EQ(figure["figure"]["panels"].size(), 2U) << "Control1 and Ecoflex1";
  EXPECT_THAT(broken_links(dir / "out/campaign-report.html"), IsEmpty());

  // Another analysis of the controls in the same file: all pieces are of it.
  (void)fv_of({controls[0]}, "controls", {});
  EXPECT_EQ(isorig(dir, words, 120.0).code, 1);
  const json anew = json::parse(slurp(dir / "out/campaign.json"));
  EXPECT_NE(anew["recordings"][2]["fit"]["control"], sheath["control"]);
  EXPECT_EQ(anew["recordings"][0]["fit"], table["recordings"][0]["fit"]);
  EXPECT_NE(anew["ask"]["control_sha256"], table["ask"]["control_sha256"]);
}

TEST(CampaignFv, AModelThatCannotBeAskedForIsRefused) {
  const TempDir dir;
  const std::string r = record(dir / "r", "Ecoflex1", 1);
  const auto asked = [&](std::vector<std::string> more) {
    more.insert(more.begin(), {"campaign", r, "--out", (dir / "out").string()});
    return isorig(dir, more);
  };
  const auto without = asked({"--ask", "fv", "--model", "slse2"});
  EXPECT_EQ(without.code, 2);
  EXPECT_THAT(without.text, HasSubstr("needs --control FV.json"));
  EXPECT_EQ(asked({"--ask", "fv", "--control", "fv.json"}).code, 2);
  EXPECT_EQ(asked({"--ask", "diagnose", "--model", "slse2", "--control", "fv.json"}).code, 2);
  EXPECT_EQ(asked({"--control", "fv.json"}).code, 2);
  const auto gone = asked({"--ask", "fv", "--model", "slse2", "--control", (dir / "gone.json").string()});
  EXPECT_EQ(gone.code, 3) << gone.text;
  EXPECT_THAT(gone.text, HasSubstr("gone.json"));
  EXPECT_FALSE(fs::exists(dir / "out"));
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
