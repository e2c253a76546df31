#include "base/beneath.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <fstream>
#include <thread>

namespace isorig::base {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

class BeneathTest : public ::testing::Test {
 protected:
  BeneathTest() {
    std::filesystem::create_directories(folder_ / "a" / "b");
    std::filesystem::create_directories(root_ / "outside");
    std::ofstream(folder_ / "a" / "b" / "file") << "inside";
    std::ofstream(root_ / "outside" / "file") << "outside";
  }
  ~BeneathTest() override { std::filesystem::remove_all(root_); }

  static std::filesystem::path made() {
    std::string pattern = (std::filesystem::temp_directory_path() / "isorig-beneath-XXXXXX").string();
    return ::mkdtemp(pattern.data());
  }
  std::filesystem::path root_ = made(), folder_ = root_ / "folder";
};

TEST_F(BeneathTest, ReadsWhatLiesThere) {
  EXPECT_EQ(read_text_beneath(folder_, "a/b/file"), "inside");
  EXPECT_EQ(read_text_beneath(folder_, "a/b/file", 2), "in");
  std::filesystem::create_directory_symlink(folder_, root_ / "link");
  EXPECT_EQ(read_text_beneath(root_ / "link", "a/b/file"), "inside") << "the folder itself is its namer's";
}

TEST_F(BeneathTest, NoNameLeadsOut) {
  const auto outside = std::filesystem::relative(root_ / "outside" / "file", folder_);
  ASSERT_TRUE(std::filesystem::exists(folder_ / outside));
  for (const auto& name :
       {outside, root_ / "outside" / "file", std::filesystem::path("a/../a/b/file"),
        std::filesystem::path("./a/b/file"), std::filesystem::path(""), std::filesystem::path("a/b/file/")}) {
    EXPECT_THROW((void)read_text_beneath(folder_, name), FileError) << name;
    EXPECT_EQ(open_beneath(folder_, name, O_RDONLY), -1) << name;
    EXPECT_TRUE(errno == EINVAL || errno == ENOTDIR) << name;
  }
}

TEST_F(BeneathTest, NoLinkIsFollowedWhereverItStands) {
  std::filesystem::create_symlink(root_ / "outside" / "file", folder_ / "link");
  std::filesystem::create_directory_symlink(root_ / "outside", folder_ / "a" / "door");
  std::filesystem::create_directory_symlink("b", folder_ / "a" / "own");
  for (const char* name : {"link", "a/door/file", "a/own/file"}) {
    EXPECT_THAT([&] { (void)read_text_beneath(folder_, name); },
                ThrowsMessage<FileError>(HasSubstr("is a symbolic link, or leads through one")))
        << name;
    EXPECT_EQ(open_beneath(folder_, name, O_WRONLY | O_CREAT | O_TRUNC, 0600), -1) << name;
    EXPECT_EQ(errno, ELOOP) << name;
  }
  EXPECT_EQ(read_text_beneath(root_, "outside/file"), "outside");
}

TEST_F(BeneathTest, WhatIsNoFileIsNotWaitedFor) {
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  for (const char* name : {"pipe", "a"}) {
    EXPECT_THAT([&] { (void)read_text_beneath(folder_, name); }, ThrowsMessage<FileError>(HasSubstr("no plain file")));
  }
  try {
    (void)read_text_beneath(folder_, "a/none");
    ADD_FAILURE();
  } catch (const FileError& e) {
    EXPECT_TRUE(e.missing());
  }
}

/// Somebody who may write there exchanges a folder for a link, over and over, while it is read.
TEST_F(BeneathTest, ALinkThatComesBetweenTheLookAndTheReadingLeadsNowhere) {
  std::filesystem::create_directory_symlink(root_ / "outside", folder_ / "a" / "door");
  const auto real = folder_ / "a" / "b", link = folder_ / "a" / "door";
  std::atomic<bool> done{false};
  std::thread swapping([&] {
    while (!done) (void)::renameat2(AT_FDCWD, real.c_str(), AT_FDCWD, link.c_str(), RENAME_EXCHANGE);
  });
  int read = 0, refused = 0;
  for (int i = 0; i < 20'000; ++i) {
    try {
      ASSERT_EQ(read_text_beneath(folder_, "a/b/file"), "inside");
      ++read;
    } catch (const FileError&) {
      ++refused;
    }
  }
  done = true;
  swapping.join();
  EXPECT_GT(read, 0);
  EXPECT_GT(refused, 0) << "the race was never met";
}

}  // namespace
}  // namespace isorig::base
