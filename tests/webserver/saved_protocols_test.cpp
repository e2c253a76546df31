#include "webserver/rules/saved_protocols.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "base/fingerprint.hpp"

namespace isorig::web {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Is = SavedProtocols::Saved::Is;

class SavedProtocolsTest : public ::testing::Test {
 protected:
  static std::filesystem::path new_folder() {
    char pattern[] = "/tmp/isorig-saved-XXXXXX";
    return ::mkdtemp(pattern);
  }
  ~SavedProtocolsTest() override { std::filesystem::remove_all(root_); }
  [[nodiscard]] std::string on_disk(const std::string& name) const {
    std::ifstream in(root_ / "a" / "b" / name);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  const std::filesystem::path root_ = new_folder();
  const SavedProtocols saved_{root_ / "a" / "b"};
};

TEST_F(SavedProtocolsTest, TheFirstOneMakesTheFolder) {
  EXPECT_TRUE(toml_files(saved_.folder(), false).empty());
  const auto done = saved_.save("mine.toml", "x = 1\n", "");
  ASSERT_EQ(done.is, Is::kDone) << done.text;
  EXPECT_EQ(on_disk("mine.toml"), "x = 1\n");
  EXPECT_THAT(toml_files(saved_.folder(), false), ElementsAre("mine.toml"));
  const auto read = saved_.read("mine.toml");
  ASSERT_TRUE(read.has_value());
  EXPECT_EQ(read->version, done.version);
}

TEST_F(SavedProtocolsTest, NothingIsReplacedByWhoHasNotSeenIt) {
  const auto first = saved_.save("mine.toml", "first", "");
  const auto blind = saved_.save("mine.toml", "second", "");
  EXPECT_EQ(blind.is, Is::kThereAlready);
  EXPECT_THAT(blind.text, HasSubstr("there is a protocol mine.toml already"));
  EXPECT_EQ(blind.version, first.version);
  const auto second = saved_.save("mine.toml", "second", first.version);
  ASSERT_EQ(second.is, Is::kDone) << second.text;
  EXPECT_EQ(on_disk("mine.toml~"), "first");
  // Somebody else has opened the first one, too.
  const auto late = saved_.save("mine.toml", "third", first.version);
  EXPECT_EQ(late.is, Is::kThereAlready);
  EXPECT_THAT(late.text, HasSubstr("was changed by somebody else"));
  EXPECT_EQ(on_disk("mine.toml"), "second");
  EXPECT_EQ(saved_.save("mine.toml", "third", late.version).is, Is::kDone);
  EXPECT_EQ(on_disk("mine.toml~"), "second");
  // What is not a protocol's name does not show, nor does anything that was left aside.
  EXPECT_THAT(toml_files(saved_.folder(), false), ElementsAre("mine.toml"));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(saved_.folder()), {}), 2);
}

TEST_F(SavedProtocolsTest, AnEditThatComesWhileItIsSavedStays) {
  const auto first = saved_.save("mine.toml", "first", "");
  ASSERT_EQ(saved_.save("mine.toml", "second", first.version).is, Is::kDone);
  // save() has looked at the second one; an editor writes before its text is put there.
  const auto seen = saved_.read("mine.toml")->version;
  std::ofstream(saved_.folder() / "mine.toml") << "by an editor";
  const auto refused = saved_.replace("mine.toml", "third", seen);
  EXPECT_EQ(refused.is, Is::kThereAlready);
  EXPECT_THAT(refused.text, HasSubstr("was changed by somebody else"));
  EXPECT_EQ(refused.version, saved_.read("mine.toml")->version);
  EXPECT_EQ(on_disk("mine.toml"), "by an editor");
  EXPECT_EQ(on_disk("mine.toml~"), "first");
  std::filesystem::remove(saved_.folder() / "mine.toml");
  EXPECT_EQ(saved_.replace("mine.toml", "third", seen).is, Is::kThereAlready);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(saved_.folder()), {}), 1);
}

TEST_F(SavedProtocolsTest, TheSameTextTwiceKeepsTheOneBefore) {
  const auto first = saved_.save("mine.toml", "first", "");
  const auto second = saved_.save("mine.toml", "second", first.version);
  const auto again = saved_.save("mine.toml", "second", second.version);
  EXPECT_EQ(again.is, Is::kDone);
  EXPECT_THAT(again.text, HasSubstr("already"));
  EXPECT_EQ(again.version, second.version);
  EXPECT_EQ(on_disk("mine.toml~"), "first");
}

TEST_F(SavedProtocolsTest, WhatAKilledProcessLeftAsideIsRemoved) {
  ASSERT_EQ(saved_.save("mine.toml", "x", "").is, Is::kDone);
  for (const char* left : {".saving-aBcDeF", ".saving-1-0"}) std::ofstream(saved_.folder() / left) << "half";
  std::filesystem::last_write_time(saved_.folder() / ".saving-aBcDeF",
                                   std::filesystem::file_time_type::clock::now() - std::chrono::hours(2));
  ASSERT_EQ(saved_.save("other.toml", "x", "").is, Is::kDone);
  EXPECT_FALSE(std::filesystem::exists(saved_.folder() / ".saving-aBcDeF"));
  EXPECT_TRUE(std::filesystem::exists(saved_.folder() / ".saving-1-0")) << "another process may be at it";
}

TEST_F(SavedProtocolsTest, AFileHasTheRightsOfTheUmask) {
  const mode_t mask = ::umask(027);
  const auto done = saved_.save("mine.toml", "x", "");
  ::umask(mask);
  ASSERT_EQ(done.is, Is::kDone) << done.text;
  EXPECT_EQ(std::filesystem::status(saved_.folder() / "mine.toml").permissions(), std::filesystem::perms(0640));
}

TEST_F(SavedProtocolsTest, NoNameLeadsOutOfTheFolder) {
  for (const char* name :
       {"", ".toml", "../x.toml", "/tmp/x.toml", "a/b.toml", ".hidden.toml", "x.txt", "x.toml~", "x\n.toml"}) {
    EXPECT_EQ(saved_.save(name, "x", "").is, Is::kRefused) << name;
    EXPECT_FALSE(saved_.read(name).has_value()) << name;
  }
  EXPECT_FALSE(std::filesystem::exists(root_ / "a"));
}

TEST_F(SavedProtocolsTest, ALinkOutOfTheFolderIsNeitherReadNorListedNorWritten) {
  const std::string theirs = "theirs";
  ASSERT_EQ(saved_.save("mine.toml", "x", "").is, Is::kDone);
  std::ofstream(root_ / "outside") << theirs;
  std::filesystem::create_symlink(root_ / "outside", saved_.folder() / "link.toml");
  EXPECT_FALSE(saved_.read("link.toml").has_value());
  EXPECT_THAT(toml_files(saved_.folder(), false), ElementsAre("mine.toml"));
  EXPECT_THAT(toml_files(saved_.folder(), true), ElementsAre("link.toml", "mine.toml"));
  for (const auto& seen : {std::string(), base::fingerprint(theirs)})
    EXPECT_EQ(saved_.save("link.toml", "mine", seen).is, Is::kRefused);
  std::ifstream in(root_ / "outside");
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), theirs);
  EXPECT_TRUE(std::filesystem::is_symlink(saved_.folder() / "link.toml"));
}

TEST_F(SavedProtocolsTest, WhatCannotBeSavedSaysWhy) {
  EXPECT_EQ(saved_.save("long.toml", std::string(SavedProtocols::kBytes + 1, 'x'), "").is, Is::kRefused);
  EXPECT_THAT(SavedProtocols({}).save("x.toml", "x", "").text, HasSubstr("--saved-protocols"));
  std::ofstream(root_ / "file") << "x";
  const auto failed = SavedProtocols(root_ / "file" / "in").save("x.toml", "x", "");
  EXPECT_EQ(failed.is, Is::kFailed);
  EXPECT_THAT(failed.text, HasSubstr("Not a directory"));
  std::filesystem::create_directories(saved_.folder() / "folder.toml");
  EXPECT_THAT(saved_.save("folder.toml", "x", "").text, HasSubstr("another name"));
}

}  // namespace
}  // namespace isorig::web
