#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "base/text_file.hpp"
#include "tree.hpp"

/// Pages of docs/ against the tree: what they name has to be there.
namespace isorig::test {
namespace {

namespace fs = std::filesystem;

const fs::path kRoot = isorig::test::source_path();

std::vector<fs::path> pages() {
  std::vector<fs::path> all{kRoot / "README.md", kRoot / "CONTRIBUTING.md"};
  for (const auto& entry : fs::directory_iterator(kRoot / "docs")) {
    if (entry.path().extension() == ".md") all.push_back(entry.path());
  }
  return all;
}

/// "a.{hpp,cpp}" is two.
std::vector<std::string> alternatives(const std::string& path) {
  const auto open = path.find('{'), close = path.find('}');
  if (open == std::string::npos || close == std::string::npos) return {path};
  std::vector<std::string> all;
  for (auto from = open + 1; from <= close;) {
    const auto to = std::min(path.find(',', from), close);
    all.push_back(path.substr(0, open) + path.substr(from, to - from) + path.substr(close + 1));
    from = to + 1;
  }
  return all;
}

/// A file, a folder, a file without its extension ("model/slse"), or a beginning ("sim/wire/frame/instron8800_*").
bool exists(const std::string& path) {
  if (fs::exists(kRoot / path)) return true;
  const fs::path whole = kRoot / path;
  if (!fs::is_directory(whole.parent_path())) return false;
  const auto name = whole.filename().string();
  const auto star = name.find('*');
  const auto begin = star == std::string::npos ? name + "." : name.substr(0, star);
  const auto end = star == std::string::npos ? std::string() : name.substr(star + 1);
  return std::any_of(fs::directory_iterator(whole.parent_path()), fs::directory_iterator(), [&](const auto& entry) {
    const auto file = entry.path().filename().string();
    return file.starts_with(begin) && file.ends_with(end);
  });
}

/// What looks like a path from the root of the tree. Capitals alone stand for a name that the reader chooses.
std::set<std::string> paths_in(const std::string& text) {
  static const std::regex kPath(
      "(?:^|[^A-Za-z0-9_/"
      ".$~-])((?:base|bench|calibration|cli|cmake|config|daemon|docs|drivers|firmware|identify|messages|"
      "model|packaging|proof|protocol|scripts|sim|systemd|tests|virtual-bench|web|webserver)/[A-Za-z0-9_./{},*-]+)");
  static const std::regex kPlaceholder("[A-Z]{3,}|^messages/s$");
  std::set<std::string> found;
  for (std::sregex_iterator i(text.begin(), text.end(), kPath), end; i != end; ++i) {
    std::string path = (*i)[1];
    path.erase(path.find_last_not_of(".,-") + 1);
    if (std::regex_search(path, kPlaceholder)) continue;
    for (const auto& one : alternatives(path)) found.insert(one);
  }
  return found;
}

TEST(Docs, EveryPathThatAPageNamesExists) {
  std::size_t named = 0;
  for (const auto& page : pages()) {
    for (const auto& path : paths_in(base::read_text_file(page))) {
      EXPECT_TRUE(exists(path)) << page.filename() << " names " << path;
      ++named;
    }
  }
  EXPECT_GT(named, 200U);
}

TEST(Docs, APathIsFoundAndAMissingOneIsMissed) {
  EXPECT_THAT(
      paths_in("see `daemon/io/a_service.{hpp,cpp}`, (sim/frame/x_*) and model/effects/NAME.cpp; 5 messages/s."),
      ::testing::ElementsAre("daemon/io/a_service.cpp", "daemon/io/a_service.hpp", "sim/frame/x_*"));
  EXPECT_THAT(paths_in("/usr/share/docs/a.md, build/docs/b"), ::testing::IsEmpty());
  EXPECT_TRUE(exists("docs/drivers.md"));
  EXPECT_TRUE(exists("docs/drivers"));
  EXPECT_TRUE(exists("drivers/api/frame.h*"));
  EXPECT_FALSE(exists("docs/driver"));
  EXPECT_FALSE(exists("drivers/frame/no_such_*"));
  EXPECT_FALSE(exists("drivers/no_such/frame.hpp"));
}

/// What stands between single backquotes on one line.
std::set<std::string> quoted_in(const std::string& text) {
  std::set<std::string> found;
  for (auto open = text.find('`'); open != std::string::npos;) {
    const auto close = text.find_first_of("`\n", open + 1);
    if (close == std::string::npos) break;
    if (text[close] == '`' && close > open + 1) found.insert(text.substr(open + 1, close - open - 1));
    open = text[close] == '`' ? text.find('`', close + 1) : text.find('`', close);
  }
  return found;
}

bool is_word(const std::string& text) {
  return !text.empty() &&
         std::all_of(text.begin(), text.end(), [](unsigned char c) { return std::isalnum(c) != 0 || c == '_'; });
}

/// "a_file.cpp" or "a_file.hpp", without a folder.
bool is_source_name(const std::string& text) {
  return (text.ends_with(".cpp") || text.ends_with(".hpp")) && is_word(text.substr(0, text.size() - 4));
}

/// "Suite.Name": two words that begin with a capital and go on with a small letter somewhere, as a test has them.
bool is_test_name(const std::string& text) {
  const auto dot = text.find('.');
  if (dot == std::string::npos) return false;
  for (const auto& part : {text.substr(0, dot), text.substr(dot + 1)}) {
    if (!is_word(part) || std::isupper(static_cast<unsigned char>(part[0])) == 0) return false;
    if (std::none_of(part.begin(), part.end(), [](unsigned char c) { return std::islower(c) != 0; })) return false;
  }
  return true;
}

/// Names of all sources, and the text of all tests in a row without white space: "TEST_F(Suite,Name)".
struct Tree {
  std::set<std::string> sources;
  std::string tests;

  Tree() {
    for (const char* room : {"base", "bench", "calibration", "cli", "daemon", "drivers", "firmware", "identify",
                             "messages", "model", "packaging", "proof", "protocol", "sim", "tests", "webserver"}) {
      for (const auto& entry : fs::recursive_directory_iterator(kRoot / room)) {
        const auto name = entry.path().filename().string();
        if (!name.ends_with(".cpp") && !name.ends_with(".hpp")) continue;
        sources.insert(name);
        if (room != std::string("tests")) continue;
        for (const char c : base::read_text_file(entry.path()))
          if (std::isspace(static_cast<unsigned char>(c)) == 0) tests += c;
      }
    }
  }
  [[nodiscard]] bool has_test(const std::string& name) const {
    const auto dot = name.find('.');
    const auto call = "(" + name.substr(0, dot) + "," + name.substr(dot + 1) + ")";
    return tests.find("TEST" + call) != std::string::npos || tests.find("TEST_F" + call) != std::string::npos ||
           tests.find("TEST_P" + call) != std::string::npos;
  }
};

TEST(Docs, EverySourceAndEveryTestThatAPageNamesExists) {
  const Tree tree;
  std::size_t sources = 0, tests = 0;
  for (const auto& page : pages()) {
    for (const auto& name : quoted_in(base::read_text_file(page))) {
      if (is_source_name(name)) {
        EXPECT_TRUE(tree.sources.contains(name)) << page.filename() << " names the source " << name;
        ++sources;
      } else if (is_test_name(name)) {
        EXPECT_TRUE(tree.has_test(name)) << page.filename() << " names the test " << name;
        ++tests;
      }
    }
  }
  EXPECT_GT(sources, 20U);
  EXPECT_GT(tests, 30U);
}

TEST(Docs, ASourceAndATestAreFoundAndMissingOnesAreMissed) {
  EXPECT_THAT(quoted_in("`a.cpp`, not `b\n`c.hpp`."), ::testing::ElementsAre("a.cpp", "c.hpp"));
  EXPECT_TRUE(is_source_name("a_file.hpp"));
  EXPECT_FALSE(is_source_name("daemon/a_file.hpp"));
  EXPECT_TRUE(is_test_name("StateModelTest.EveryAct"));
  EXPECT_FALSE(is_test_name("constants.NAME"));
  EXPECT_FALSE(is_test_name("recording.toml"));
  const Tree tree;
  EXPECT_TRUE(tree.sources.contains("docs_test.cpp"));
  EXPECT_FALSE(tree.sources.contains("no_such_source.cpp"));
  EXPECT_TRUE(tree.has_test("Docs.EverySourceAndEveryTestThatAPageNamesExists"));
  EXPECT_FALSE(tree.has_test("Docs.NoSuchTest"));
}

/// The page counts on being complete: whoever follows it for another frame has touched everything.
TEST(Docs, TheDriversPageNamesEveryFileThatKnowsTheFrameItFollows) {
  const auto page = base::read_text_file(kRoot / "docs/drivers.md");
  std::size_t known = 0;
  for (const char* room : {"config", "daemon", "drivers", "sim"}) {
    for (const auto& entry : fs::recursive_directory_iterator(kRoot / room)) {
      if (!entry.is_regular_file()) continue;
      auto text = base::read_text_file(entry.path()) + entry.path().filename().string();
      std::transform(text.begin(), text.end(), text.begin(),
                     [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
      if (text.find("instron8800") == std::string::npos) continue;
      EXPECT_THAT(page, ::testing::HasSubstr("`" + fs::relative(entry.path(), kRoot).string() + "`"));
      ++known;
    }
  }
  EXPECT_GT(known, 20U);
}

}  // namespace
}  // namespace isorig::test
