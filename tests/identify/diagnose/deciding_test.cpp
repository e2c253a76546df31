// The numbers that decide a diagnosis stand in one table, each with its derivation, and nowhere else.
#include "identify/diagnose/deciding/deciding.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "identify/diagnose/deciding/deciding_table.hpp"
#include "tree.hpp"

namespace isorig::identify {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::string read(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

class Deciding : public testing::Test {
 protected:
  void TearDown() override { decide_as_stated(); }
};

std::string refusal(std::string_view assignment) {
  try {
    decide(assignment);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

TEST_F(Deciding, EveryNumberHasANameOfItsOwnAndADerivation) {
  std::set<std::string_view> names;
  for (const DecidingNumber& one : deciding_numbers()) {
    EXPECT_TRUE(names.insert(one.name).second) << one.name << " is there twice";
    EXPECT_EQ(one.name.find_first_not_of("abcdefghijklmnopqrstuvwxyzH_"), std::string_view::npos) << one.name;
    EXPECT_FALSE(one.unit.empty()) << one.name;
    EXPECT_TRUE(one.what.ends_with('.')) << one.name;
    EXPECT_GT(one.derivation.size(), 10U) << one.name;
    EXPECT_LE(one.least, one.stated) << one.name;
    EXPECT_GE(one.most, one.stated) << one.name;
    EXPECT_LT(one.least, one.most) << one.name;
    EXPECT_EQ(one.in_force(), one.stated) << one.name;
    // A unit stands in the name.
    if (one.unit == "s" || one.unit == "psi" || one.unit == "Hz") {
      EXPECT_TRUE(one.name.ends_with("_" + std::string(one.unit))) << one.name;
    }
    if (one.unit == "nat") {
      EXPECT_TRUE(one.name.ends_with("_nats")) << one.name;
    }
  }
}

TEST_F(Deciding, EveryNumberIsReadWhereItDecides) {
  std::string code;
  for (const auto& entry : fs::recursive_directory_iterator(test::source_path("/identify")))
    if (entry.path().extension() == ".cpp" || entry.path().extension() == ".hpp") code += read(entry.path());
  for (const DecidingNumber& one : deciding_numbers())
    EXPECT_THAT(code.find("deciding()." + std::string(one.name)), testing::Ne(std::string::npos))
        << one.name << " decides nothing";
}

TEST_F(Deciding, TheTableIsDocumentedByItsCommand) {
  EXPECT_THAT(read(test::source_path("/docs/diagnosis.md")), HasSubstr("isorig diagnose --deciding"));
  const std::string table = deciding_table();
  const auto json = deciding_json();
  ASSERT_EQ(json.size(), deciding_numbers().size());
  for (const DecidingNumber& one : deciding_numbers()) {
    EXPECT_THAT(table, HasSubstr("\n    From: " + std::string(one.derivation)));
    EXPECT_THAT(table, HasSubstr(std::string(one.name) + " = "));
  }
}

TEST_F(Deciding, AnotherValueIsInForceAndSaid) {
  EXPECT_TRUE(decided().empty());
  EXPECT_EQ(decided_text({}), "");
  decide("prior_cost_nats=6.5");
  decide("most_effects=2");
  EXPECT_EQ(deciding().prior_cost_nats, 6.5);
  EXPECT_EQ(deciding().most_effects, 2U);
  EXPECT_EQ(changed_json(decided()).dump(), R"({"prior_cost_nats":6.5,"most_effects":2.0})");
  EXPECT_THAT(decided_text(decided()), HasSubstr("prior_cost_nats = 6.5 (stated: 3), most_effects = 2 (stated: 3)"));
  decide("prior_cost_nats=3");
  EXPECT_EQ(decided().size(), 1U) << "the stated value is no change";
  decide_as_stated();
  EXPECT_EQ(deciding().most_effects, 3U);
}

TEST_F(Deciding, WhatCannotBeIsRefusedWithAdvice) {
  EXPECT_THAT(refusal("prior_cost"), HasSubstr("\"prior_cost\" is not NAME=VALUE; `isorig diagnose --deciding`"));
  EXPECT_THAT(refusal("prior_cost=3"), HasSubstr("near it: prior_cost_nats"));
  EXPECT_THAT(refusal("pror_cost_nats=3"), HasSubstr("near it: prior_cost_nats"));
  EXPECT_THAT(refusal("zzz=3"), HasSubstr("no number \"zzz\" decides a diagnosis; `isorig diagnose --deciding` lists"));
  for (const char* value : {"nan", "inf", "-inf", "3x", "", " 3", "0x3"})
    EXPECT_THAT(refusal("prior_cost_nats=" + std::string(value)), HasSubstr("is no finite number")) << value;
  EXPECT_THAT(refusal("prior_cost_nats=-1"), HasSubstr("is not within 0 to 1e+06"));
  EXPECT_THAT(refusal("surest_probability=1.01"), HasSubstr("is not within 0 to 1"));
  EXPECT_THAT(refusal("most_effects=2.5"), HasSubstr("is no whole number"));
  EXPECT_TRUE(decided().empty()) << "what is refused changes nothing";
}

}  // namespace
}  // namespace isorig::identify
