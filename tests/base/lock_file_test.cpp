#include "base/lock_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <optional>

#include "base/text_file.hpp"

namespace isorig::base {
namespace {

using testing::HasSubstr;
using Shared = LockFile::Shared;

class Lock : public testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  /// Why it cannot be had; nullopt when it can.
  [[nodiscard]] std::optional<LockError> refused(Shared shared = Shared::kNo) const {
    try {
      const LockFile lock(file_, shared);
      return {};
    } catch (const LockError& e) {
      return e;
    }
  }

  std::filesystem::path folder_ = std::filesystem::temp_directory_path() / ("lock-" + std::to_string(::getpid()));
  std::filesystem::path file_ = folder_ / "work.lock";
  std::string us_ = "process " + std::to_string(::getpid()) + " on " + host_name();
};

TEST_F(Lock, IsHadOnceAndFreeAfterwards) {
  {
    const LockFile first(file_);
    const auto why = refused();
    ASSERT_TRUE(why);
    EXPECT_EQ(why->why(), LockError::Why::kHeld);
    EXPECT_EQ(why->holder(), us_);
    EXPECT_THAT(why->what(), HasSubstr(file_.string() + ": in use by " + us_ + "; wait for it or end it"));
    EXPECT_EQ(read_text_file(file_), us_) << "the one that was refused leaves the holder's name";
  }
  EXPECT_FALSE(refused());
}

TEST_F(Lock, IsSharedByThoseThatShareItAndKeptFromOthers) {
  const LockFile first(file_, Shared::kYes);
  EXPECT_FALSE(refused(Shared::kYes));
  EXPECT_TRUE(refused(Shared::kNo));
}

TEST_F(Lock, IsFreeWhenItsHolderIsKilled) {
  int ready[2];
  ASSERT_EQ(::pipe(ready), 0);
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    const LockFile held(file_);
    (void)!::write(ready[1], "x", 1);
    ::pause();
    ::_exit(0);
  }
  char sign = 0;
  ASSERT_EQ(::read(ready[0], &sign, 1), 1);
  const auto why = refused();
  ASSERT_TRUE(why);
  EXPECT_EQ(why->holder(), "process " + std::to_string(child) + " on " + host_name());
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  EXPECT_FALSE(refused());
  ::close(ready[0]);
  ::close(ready[1]);
}

TEST_F(Lock, AFolderIsForOneAtATimeAndNothingOfTheLockStaysInIt) {
  const auto results = folder_ / "new" / "results";
  {
    const FolderLock first(results);
    try {
      const FolderLock second(results);
      FAIL() << "two write into one folder";
    } catch (const LockError& e) {
      EXPECT_EQ(e.why(), LockError::Why::kHeld);
      EXPECT_THAT(e.what(), HasSubstr("another command writes into this folder now"));
    }
    EXPECT_TRUE(std::filesystem::is_empty(results));
  }
  EXPECT_FALSE(std::filesystem::exists(results)) << "made for nothing";
  {
    const FolderLock again(results);
    std::ofstream(results / "kept") << "x";
  }
  EXPECT_TRUE(std::filesystem::exists(results / "kept"));
}

TEST_F(Lock, AFileThatCannotBeMadeSaysWhatToDo) {
  file_ = folder_ / "not-there" / "work.lock";
  const auto why = refused();
  ASSERT_TRUE(why);
  EXPECT_EQ(why->why(), LockError::Why::kUnwritable);
  EXPECT_THAT(why->what(), HasSubstr("No such file or directory; name a folder that you may write"));
}

}  // namespace
}  // namespace isorig::base
