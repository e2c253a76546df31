#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>
#include <string>

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
  for (const auto& entry : std::filesystem::directory_iterator(std::string(ISORIG_SOURCE_DIR) + "/daemon")) {
    if (entry.path().extension() == ".cpp" || entry.path().extension() == ".hpp") text += slurp(entry.path());
  }
  return text;
}

std::string section(const std::string& text, const std::string& title) {
  const auto from = text.find(title);
  EXPECT_NE(from, std::string::npos) << title;
  return text.substr(from, text.find("\n## ", from + 1) - from);
}

std::set<std::string> faults_in_code() {
  const auto code = sources();
  auto faults = all(code, R"re(Severity::k(?:ProgramStop|SafeState),\s*"([a-z_.]+)")re");
  const auto stale = all(code, R"re(stale\([a-z_]+,\s*[a-z_.]+,\s*"([a-z_.]+)")re");
  EXPECT_EQ(stale.size(), 4U);  // frame, pressure, interlock, regulator
  faults.insert(stale.begin(), stale.end());
  EXPECT_GT(faults.size(), 20U);
  return faults;
}

TEST(Commissioning, EveryFaultOfTheCodeStandsInTheTable) {
  const auto table = section(slurp(std::string(ISORIG_SOURCE_DIR) + "/docs/commissioning.md"), "## What the daemon does at every fault");
  const auto faults = all(table, "\\n\\| `([a-z_.]+)` \\|[^|]*\\| (?:held|safe state)");
  EXPECT_EQ(faults, faults_in_code());
  auto warnings = all(sources(), R"re(Severity::kWarning,\s*"([a-z_.]+)")re");
  warnings.insert("recorder.dropped");  // made by the recorder itself
  EXPECT_EQ(all(table, "\\n\\| `([a-z_.]+)` \\|[^|]*\\|[^|\\n]*\\|(?=\\n)"), warnings);
}

TEST(Commissioning, ItSaysTheSeverityThatTheCodeHas) {
  const auto code = sources();
  const auto table = section(slurp(std::string(ISORIG_SOURCE_DIR) + "/docs/commissioning.md"), "## What the daemon does at every fault");
  const auto held = all(table, "\\n\\| `([a-z_.]+)` \\|[^|]*\\| held");
  EXPECT_EQ(held, all(code, R"re(Severity::kProgramStop,\s*"([a-z_.]+)")re"));
}

TEST(Faults, EveryTextFitsWhereItGoes) {
  // An event holds 160 characters, the status 224: "code: text (value, limit value)", whose numbers take 40 at most.
  const auto code = slurp(std::string(ISORIG_SOURCE_DIR) + "/daemon/supervisor.cpp") + slurp(std::string(ISORIG_SOURCE_DIR) + "/daemon/core.cpp");
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
  const auto listed = all(slurp(std::string(ISORIG_SOURCE_DIR) + "/docs/states.md"), "`([a-z_]+(?:\\.[a-z_]+)?)`");
  for (const auto& code : faults_in_code()) EXPECT_THAT(listed, ::testing::Contains(code));
}

}  // namespace
}  // namespace isorig::daemon::test
