#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>
#include <string>

#include "daemon/core/trips.hpp"
#include "tree.hpp"

/// The tables that people act upon in a fault, against the code that raises the faults.
namespace isorig::daemon::test {
namespace {

std::string slurp(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

std::set<std::string> all(const std::string& text, const std::string& pattern) {
  std::set<std::string> found;
  const std::regex regex(pattern);
  for (std::sregex_iterator i(text.begin(), text.end(), regex), end; i != end; ++i) found.insert((*i)[1]);
  return found;
}

std::string sources() {
  std::string text;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(isorig::test::source_path() + "/daemon")) {
    if (entry.path().extension() == ".cpp" || entry.path().extension() == ".hpp") text += slurp(entry.path());
  }
  return text;
}

std::string section(const std::string& text, const std::string& title) {
  const auto from = text.find(title);
  EXPECT_NE(from, std::string::npos) << title;
  return text.substr(from, text.find("\n## ", from + 1) - from);
}

/// Of a rig that moves (daemon/core/trips.cpp).
std::set<std::string> rules(Severity severity) {
  std::set<std::string> codes;
  for (const auto& rule : trip_rules()) {
    if (rule.moving == severity) codes.insert(rule.code);
  }
  return codes;
}

std::set<std::string> faults_in_code() {
  auto faults = rules(Severity::kProgramStop);
  faults.merge(rules(Severity::kSafeState));
  return faults;
}

std::string fault_table() {
  return section(slurp(isorig::test::source_path() + "/docs/commissioning.md"),
                 "## What the daemon does at every fault");
}

TEST(Commissioning, EveryFaultOfTheCodeStandsInTheTable) {
  const auto table = fault_table();
  const auto faults = all(table, "\\n\\| `([a-z_.]+)` \\|[^|]*\\| (?:held|safe state)");
  EXPECT_EQ(faults, faults_in_code());
  auto warnings = all(sources(), R"re(Severity::kWarning,\s*"([a-z_.]+)")re");
  warnings.merge(rules(Severity::kWarning));
  warnings.insert("recorder.dropped");  // made by the recorder itself
  for (const char* link :
       {"frame", "pressure", "interlock", "regulator"}) {  // named where they are followed: core_watch.cpp
    warnings.insert(std::string("error.") + link);
    warnings.insert(std::string("reconnect.") + link);
  }
  EXPECT_EQ(all(table, "\\n\\| `([a-z_.]+)` \\|[^|]*\\|[^|\\n]*\\|(?=\\n)"), warnings);
}

TEST(Commissioning, ItSaysTheSeverityThatTheCodeHas) {
  const auto held = all(fault_table(), "\\n\\| `([a-z_.]+)` \\|[^|]*\\| held");
  EXPECT_EQ(held, rules(Severity::kProgramStop));
}

TEST(Safety, EveryFaultOfTheCodeStandsInTheHazardAnalysis) {
  const auto listed = all(slurp(isorig::test::source_path() + "/docs/safety.md"), "`([a-z_]+(?:\\.[a-z_]+)?)`");
  for (const auto& rule : trip_rules()) EXPECT_THAT(listed, ::testing::Contains(rule.code));
}

TEST(Safety, EveryTestThatTheHazardAnalysisNamesExists) {
  std::set<std::string> tests;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(isorig::test::source_path() + "/tests")) {
    if (entry.path().extension() != ".cpp") continue;
    const auto text = slurp(entry.path());
    const std::regex regex(R"re(TEST(?:_F|_P)?\(([A-Za-z0-9]+), ([A-Za-z0-9]+)\))re");
    for (std::sregex_iterator i(text.begin(), text.end(), regex), end; i != end; ++i) {
      tests.insert((*i)[1].str() + "." + (*i)[2].str());
    }
  }
  const auto named =
      all(slurp(isorig::test::source_path() + "/docs/safety.md"), "`([A-Z][A-Za-z0-9]+\\.[A-Z][A-Za-z0-9]+)`");
  EXPECT_GT(named.size(), 25U);
  for (const auto& name : named) EXPECT_THAT(tests, ::testing::Contains(name));
}

TEST(Faults, EveryTextFitsWhereItGoes) {
  // An event holds 160 characters, the status 224: "code: text (value, limit value)", whose numbers take 40 at most.
  const auto code = sources();
  const std::regex regex(R"re("([a-z_]+\.[a-z_]+|recorder)",\s*"([^"]*)")re");
  int texts = 0;
  for (std::sregex_iterator i(code.begin(), code.end(), regex), end; i != end; ++i, ++texts) {
    EXPECT_LT((*i)[2].length(), 160) << (*i)[1];
    EXPECT_LT((*i)[1].length() + 2 + (*i)[2].length() + 40, 224) << (*i)[1];
    EXPECT_LT((*i)[1].length(), 32);
  }
  EXPECT_GT(texts, 20);
}

TEST(States, EveryFaultOfTheCodeStandsThere) {
  const auto listed = all(slurp(isorig::test::source_path() + "/docs/states.md"), "`([a-z_]+(?:\\.[a-z_]+)?)`");
  for (const auto& code : faults_in_code()) EXPECT_THAT(listed, ::testing::Contains(code));
}

}  // namespace
}  // namespace isorig::daemon::test
