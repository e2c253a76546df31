#include "base/toml_budget.hpp"

#include <gtest/gtest.h>

#include "base/toml_reader.hpp"

namespace isorig::base {
namespace {

TEST(TomlBudget, AnOrdinaryTextIsWithin) {
  EXPECT_FALSE(over_budget(""));
  EXPECT_FALSE(over_budget("a.b.c = [ { d = 1.5 }, { d = \"[[[[\" } ] # {{{\n[x.y]\n'lit.eral' = '''\n'' ]]\n'''\n"));
  EXPECT_FALSE(over_budget("s = \"\\\"[\\\\\"\nt = \"\"\"a \"\" [ \\\"\"\"\" \"\"\"\n"));
}

TEST(TomlBudget, SaysWhere) {
  const auto deep = over_budget("a = 1\nb = " + std::string(65, '['));
  ASSERT_TRUE(deep);
  EXPECT_EQ(deep->line, 2U);
  EXPECT_EQ(deep->column, 69U);
  // Brackets that are closed again are not deep; that many are too many values.
  std::string flat = "a = [";
  for (int i = 0; i < 150'000; ++i) flat += "[],\n";
  const auto many = over_budget(flat + "]\n");
  ASSERT_TRUE(many);
  EXPECT_NE(many->message.find("more than 200000 values"), std::string::npos);
  EXPECT_EQ(many->line, 100'000U);
}

TEST(TomlBudget, FaultsAndTheirTextsAreBounded) {
  std::string text;
  for (int i = 0; i < 5000; ++i) text += "key" + std::to_string(i) + " = 1\n";
  text += std::string(10'000, 'k') + " = 1\n";
  const auto document = TomlDocument::parse_text(text, "x.toml");
  (void)document.root();
  const auto faults = document.diagnostics();
  EXPECT_LE(faults.size(), 202U);
  EXPECT_EQ(faults.back().message, "and further faults; correct these first");
  for (const auto& fault : faults) EXPECT_LE(fault.message.size(), 600U);
}

TEST(TomlBudget, ADeviceWithoutAnEndIsNotReadToItsEnd) {
  EXPECT_THROW((void)TomlDocument::parse_file("/dev/zero"), ConfigError);
}

}  // namespace
}  // namespace isorig::base
