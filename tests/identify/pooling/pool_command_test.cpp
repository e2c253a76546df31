// `isorig pool` from outside: what is wrong with a folder is said with the file and the cure, and a small campaign
// gives a page whose cells lead to the recordings.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <random>

#include "../../cli/page_links.hpp"
#include "tree.hpp"

namespace isorig {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::HasSubstr;

struct Said {
  int code = 0;
  std::string text;
};

Said isorig_pool(const std::string& arguments) {
  Said out;
  FILE* pipe = ::popen((test::program_path() + "/isorig pool " + arguments + " 2>&1").c_str(), "r");
  std::array<char, 4096> buffer{};
  for (std::size_t n = 0; (n = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
    out.text.append(buffer.data(), n);
  out.code = ::pclose(pipe) >> 8;
  return out;
}

json number(double value, double error) {
  return {{"value", value}, {"ci95", {value - 1.96 * error, value + 1.96 * error}}};
}

json part(const char* name, const char* number_name, double value) {
  json out = number(value, 0.01);
  out["part"] = name;
  out["number"] = number_name;
  return out;
}

/// The keys that a pool reads, as `isorig diagnose` writes them.
json diagnosis(const std::string& specimen, double pressure_psi, int repetition, bool friction) {
  json out{
      {"format", "isorig-diagnosis/1"},
      {"verdict", friction ? "missing_physics" : "consistent"},
      {"cannot_judge", nullptr},
      {"missing", json::array()},
      {"not_modelled", nullptr},
      {"tried",
       {{{"explanation", "nominal"}, {"weight", friction ? 0.0 : 0.9}},
        {{"explanation", "coulomb_friction"}, {"weight", friction ? 0.99 : 0.03}}}},
      {"discernible", json::array()},
      {"recordings", {{{"specimen", specimen}, {"nominal_pressure_psi", pressure_psi}, {"repetition", repetition}}}}};
  if (friction)
    out["missing"].push_back({{"effect", "coulomb_friction"},
                              {"law", "jenkins"},
                              {"probability", 0.97},
                              {"parameters", {{"force_N", number(0.2 + 0.03 * pressure_psi, 0.01)}}}});
  out["fit"]["model"]["numbers"] = {part("spring", "stiffness_N_mm", 2.0), part("maxwell", "stiffness_N_mm", 1.0),
                                    part("maxwell", "time_constant_s", 0.5)};
  out["fit"]["nominal"]["numbers"] = out["fit"]["model"]["numbers"];
  return out;
}

class PoolCommand : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::remove_all(folder_);
    for (int actuator = 1; actuator <= 10; ++actuator)
      for (const int pressure : {5, 10, 20}) {
        const std::string name = "a" + std::to_string(actuator) + "_" + std::to_string(pressure);
        put(name, diagnosis("Actuator" + std::to_string(actuator), pressure, 1, actuator != 2));
        all_ += " " + (folder_ / name).string();
      }
  }
  void TearDown() override { fs::remove_all(folder_); }
  void put(const std::string& name, const json& content) const {
    fs::create_directories(folder_ / name);
    std::ofstream(folder_ / name / "diagnosis.json") << content.dump();
  }
  [[nodiscard]] Said with(const std::string& more) const {
    return isorig_pool(all_ + " " + more + " --out " + (folder_ / "out").string());
  }
  fs::path folder_ = fs::path(::testing::TempDir()) /
                     ("isorig_pool_" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
  std::string all_;
};

TEST_F(PoolCommand, SaysWhatTheActuatorsShare) {
  const Said said = with("");
  EXPECT_EQ(said.code, 0) << said.text;
  EXPECT_THAT(said.text, HasSubstr("Dry friction is in 9 of 10 actuators, not in Actuator2"));
  EXPECT_THAT(said.text, HasSubstr("grows with the pressure by 0.03"));
  const auto pooled = json::parse(std::ifstream(folder_ / "out" / "pooled.json"));
  EXPECT_EQ(pooled["format"], "isorig-pooled/1");
  EXPECT_EQ(pooled["actuators"][9], "Actuator10");
  std::ifstream in(folder_ / "out" / "campaign-report.html");
  const std::string page(std::istreambuf_iterator<char>(in), {});
  EXPECT_THAT(page, HasSubstr("../a10_20/diagnosis.json"));
}

/// Two actuators, each at a pressure of its own: the sentence is there, a growth is not.
TEST_F(PoolCommand, SaysThatPressureAndActuatorCannotBeToldApart) {
  constexpr const char* kCannot = "Whether anything grows with the pressure they cannot tell";
  put("a1_again", diagnosis("Actuator1", 5, 2, true));
  const Said apart = isorig_pool((folder_ / "a1_5").string() + " " + (folder_ / "a1_again").string() + " " +
                                 (folder_ / "a3_20").string() + " --out " + (folder_ / "out").string());
  EXPECT_EQ(apart.code, 0) << apart.text;
  EXPECT_THAT(apart.text, HasSubstr(kCannot));
  EXPECT_THAT(apart.text, testing::Not(HasSubstr("grows with the pressure by")));
  EXPECT_THAT(with("").text, testing::Not(HasSubstr(kCannot)));
}

/// Recordings of which nothing is known are not recordings in which nothing is missing.
TEST_F(PoolCommand, UnknownAndUnjudgedAreNotNothingMissing) {
  for (const auto& [verdict, lead] :
       {std::pair{"unknown_physics", "unknown physics"}, {"cannot_judge", "nothing can be judged"}}) {
    all_.clear();
    for (int actuator = 1; actuator <= 4; ++actuator) {
      json one = diagnosis("Actuator" + std::to_string(actuator), 10, 1, false);
      one["verdict"] = verdict;
      if (one["verdict"] == "cannot_judge") one["cannot_judge"] = {{"why", "too little"}, {"record", "more"}};
      const std::string name = verdict + std::to_string(actuator);
      put(name, one);
      all_ += " " + (folder_ / name).string();
    }
    const Said said = with("");
    EXPECT_EQ(said.code, 0) << said.text;
    EXPECT_THAT(said.text, ::testing::Not(HasSubstr("No effect is in any")));
    std::ifstream in(folder_ / "out" / "campaign-report.html");
    const std::string page(std::istreambuf_iterator<char>(in), {});
    EXPECT_THAT(page, HasSubstr(lead));
    EXPECT_THAT(page, ::testing::Not(HasSubstr("nothing is missing")));
  }
}

TEST_F(PoolCommand, AnActuatorThatSaysNothingHasNoEffect) {
  for (const int pressure : {5, 10, 20}) {
    json silent = diagnosis("Actuator10", pressure, 1, false);
    silent["verdict"] = "cannot_judge";
    silent["cannot_judge"] = {{"why", "too little"}, {"record", "more"}};
    put("a10_" + std::to_string(pressure), silent);
  }
  const Said said = with("");
  EXPECT_EQ(said.code, 0) << said.text;
  EXPECT_THAT(said.text, HasSubstr("Dry friction is in 8 of 9 actuators, not in Actuator2"));
}

/// Each cell of the grid leads to a file that is there, also out of a folder with a name of another world; pooled.json
/// names the folders as seen from its own, so that both can be moved together.
TEST_F(PoolCommand, LinksAndFoldersLeadToWhatIsThere) {
  put("a 1 #2%", diagnosis("Actuator1", 10, 2, true));
  ASSERT_EQ(with("'" + (folder_ / "a 1 #2%").string() + "'").code, 0);
  const json page = pieces_test::page_data(folder_ / "out/campaign-report.html");
  const json grid = pieces_test::block_of(page, "grid");
  ASSERT_FALSE(grid.is_null());
  EXPECT_EQ(pieces_test::links_in(grid).size(), 31U);
  EXPECT_THAT(pieces_test::broken_links(folder_ / "out/campaign-report.html"), ::testing::IsEmpty());
  const json pooled = json::parse(std::ifstream(folder_ / "out/pooled.json"));
  for (const json& one : pooled["recordings"]) {
    const fs::path folder = one["folder"].get<std::string>();
    EXPECT_TRUE(folder.is_relative()) << folder;
    EXPECT_TRUE(fs::exists(folder_ / "out" / folder / "diagnosis.json")) << folder;
  }
}

/// One actuator of ten has a spring half as stiff again, and one recording of another is off: both are named, with the
/// number that gives them away.
TEST_F(PoolCommand, WhoDoesNotBelongIsSaid) {
  EXPECT_THAT(with("").text, ::testing::Not(HasSubstr("does not belong")));
  const auto with_spring = [](json one, double stiffness_N_mm) {
    one["fit"]["model"]["numbers"][0] = part("spring", "stiffness_N_mm", stiffness_N_mm);
    return one;
  };
  // The others scatter by their stated errors of 0.01 N/mm.
  std::mt19937 random(20261128);
  std::normal_distribution<double> error(0.0, 0.01);
  for (int actuator = 1; actuator <= 10; ++actuator)
    for (const int pressure : {5, 10, 20}) {
      const bool off = actuator == 7 || (actuator == 4 && pressure == 10);
      put("a" + std::to_string(actuator) + "_" + std::to_string(pressure),
          with_spring(diagnosis("Actuator" + std::to_string(actuator), pressure, 1, actuator != 2),
                      (off ? 3.0 : 2.0) + error(random)));
    }
  const Said said = with("");
  ASSERT_EQ(said.code, 0) << said.text;
  EXPECT_THAT(said.text, HasSubstr("Actuator7 does not belong to the others: spring: "));
  EXPECT_THAT(said.text,
              HasSubstr("The recording Actuator4, 10 psi, repetition 1 does not belong to its actuator: spring: "));
  EXPECT_THAT(said.text, HasSubstr("standard deviations above what the others let one expect (3"));
  for (const char* other : {"Actuator1 ", "Actuator3 ", "Actuator4 ", "Actuator10 "})
    EXPECT_THAT(said.text, ::testing::Not(HasSubstr(std::string(other) + "does not belong")));
}

TEST_F(PoolCommand, AFolderWithoutADiagnosisIsNamed) {
  fs::create_directories(folder_ / "empty");
  const Said said = with((folder_ / "empty").string());
  EXPECT_EQ(said.code, 3);
  EXPECT_THAT(said.text, HasSubstr("empty/diagnosis.json: no such file; name folders that"));
  EXPECT_FALSE(fs::exists(folder_ / "out"));
}

TEST_F(PoolCommand, ADiagnosisThatNamesNoRecordingIsRefused) {
  json old = diagnosis("Actuator1", 10, 2, true);
  old.erase("recordings");
  put("old", old);
  EXPECT_THAT(with((folder_ / "old").string()).text, HasSubstr("does not say of which recording it is"));
  json nameless = diagnosis("", 10, 2, true);
  put("old", nameless);
  EXPECT_THAT(with((folder_ / "old").string()).text, HasSubstr("names no specimen; add `specimen`"));
  json everywhere = diagnosis("Actuator1", 10, 2, true);
  everywhere["recordings"][0].erase("nominal_pressure_psi");
  put("old", everywhere);
  EXPECT_THAT(with((folder_ / "old").string()).text, HasSubstr("names no pressure; add `nominal_pressure_psi`"));
}

TEST_F(PoolCommand, AnotherNominalModelIsRefused) {
  json other = diagnosis("Actuator1", 10, 2, true);
  other["fit"]["nominal"]["numbers"].push_back(part("maxwell", "stiffness_N_mm", 0.5));
  put("other", other);
  const Said said = with((folder_ / "other").string());
  EXPECT_EQ(said.code, 3);
  EXPECT_THAT(said.text, HasSubstr("pool diagnoses of one nominal model"));
}

/// A dashpot that thins with shear stands in the arm's place: the same question, and another answer.
TEST_F(PoolCommand, AnActuatorWhoseArmIsReplacedIsPooledWithTheOthers) {
  json thinning = diagnosis("Actuator1", 10, 2, true);
  thinning["fit"]["model"]["numbers"] = {part("spring", "stiffness_N_mm", 2.0)};
  put("thinning", thinning);
  const Said said = with((folder_ / "thinning").string());
  EXPECT_EQ(said.code, 0) << said.text;
  const auto pooled = json::parse(std::ifstream(folder_ / "out" / "pooled.json"));
  EXPECT_EQ(pooled["recordings"].size(), 31U);
}

TEST_F(PoolCommand, WhatIsNoWholeDiagnosisIsRefused) {
  json cut = diagnosis("Actuator1", 10, 2, true);
  cut.erase("tried");
  put("cut", cut);
  EXPECT_THAT(with((folder_ / "cut").string()).text, HasSubstr("is no whole diagnosis"));
  json position = diagnosis("Actuator1", 10, 2, true);
  position["output"] = "position";
  put("cut", position);
  EXPECT_THAT(with((folder_ / "cut").string()).text, HasSubstr("is of the position; only diagnoses of forces"));
  std::ofstream(folder_ / "cut" / "diagnosis.json") << "{\"format\": ";
  EXPECT_THAT(with((folder_ / "cut").string()).text, HasSubstr("is no JSON"));
}

/// Arms stand in the order of the search, and other parts between them.
TEST_F(PoolCommand, TheSlowerArmIsTheFirstWhateverStandsBetween) {
  const auto arms = [](double first_s, double second_s) {
    return json{part("spring", "stiffness_N_mm", 2.0),       part("maxwell", "stiffness_N_mm", first_s),
                part("maxwell", "time_constant_s", first_s), part("constant", "force_N", 0.1),
                part("maxwell", "stiffness_N_mm", second_s), part("maxwell", "time_constant_s", second_s)};
  };
  for (int actuator = 1; actuator <= 10; ++actuator)
    for (const int pressure : {5, 10, 20}) {
      json one = diagnosis("Actuator" + std::to_string(actuator), pressure, 1, false);
      one["fit"]["model"]["numbers"] = one["fit"]["nominal"]["numbers"] =
          actuator % 2 == 0 ? arms(0.96, 0.13) : arms(0.13, 0.96);
      put("a" + std::to_string(actuator) + "_" + std::to_string(pressure), one);
    }
  const Said said = with("");
  ASSERT_EQ(said.code, 0) << said.text;
  const json pooled = json::parse(std::ifstream(folder_ / "out/pooled.json"));
  std::map<std::string, double> means;
  for (const json& quantity : pooled.at("quantities"))
    means[quantity.at("quantity")] = quantity.at("value").at("value");
  EXPECT_NEAR(means.at("maxwell.time_constant_s"), 0.96, 0.01) << pooled.at("quantities").dump(1);
  EXPECT_NEAR(means.at("maxwell_2.time_constant_s"), 0.13, 0.01);
}

TEST_F(PoolCommand, AFolderThatIsGivenTwiceIsRefused) {
  EXPECT_THAT(with((folder_ / "a1_5" / "").string()).text, HasSubstr("is given twice"));
  EXPECT_THAT(isorig_pool((folder_ / "a1_5").string() + " --out " + (folder_ / "out").string()).text,
              HasSubstr("one diagnosis is nothing to pool"));
}

/// By a link, or of a copy: its readings are the same.
TEST_F(PoolCommand, ARecordingThatWasDiagnosedTwiceIsRefused) {
  json one = diagnosis("Actuator1", 10, 2, true), other = diagnosis("Actuator1", 10, 3, true);
  one["recordings"][0]["id"] = 123456789;
  other["recordings"][0]["id"] = 987654321;
  put("one", one);
  put("other", other);
  const std::string both = (folder_ / "one").string() + " " + (folder_ / "other").string();
  EXPECT_EQ(with(both).code, 0);
  other["recordings"][0]["id"] = 123456789;
  put("other", other);
  const Said said = with(both);
  EXPECT_EQ(said.code, 3);
  EXPECT_THAT(said.text, HasSubstr("other/diagnosis.json: is of the same recording as " + (folder_ / "one").string()));
}

TEST_F(PoolCommand, TheFolderOfACampaignIsLeftAlone) {
  for (const char* file : {"plan.json", "campaign.json"}) {
    fs::remove_all(folder_ / "out");
    fs::create_directories(folder_ / "out");
    std::ofstream(folder_ / "out" / file) << "{}";
    std::ofstream(folder_ / "out/campaign-report.html") << "the campaign's";
    const Said said = with("");
    EXPECT_EQ(said.code, 2) << said.text;
    EXPECT_THAT(said.text, HasSubstr("holds what `isorig campaign` wrote"));
    std::ifstream in(folder_ / "out/campaign-report.html");
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), "the campaign's");
    EXPECT_FALSE(fs::exists(folder_ / "out/pooled.json"));
  }
}

}  // namespace
}  // namespace isorig
