#include "base/whole_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

namespace isorig::base {
namespace {

using testing::HasSubstr;

class WholeFile : public testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  [[nodiscard]] std::string text() const {
    std::ifstream in(file_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  [[nodiscard]] std::ptrdiff_t entries() const {
    return std::distance(std::filesystem::directory_iterator(folder_), std::filesystem::directory_iterator());
  }
  std::filesystem::path folder_ =
      std::filesystem::path(testing::TempDir()) / ("whole-file-" + std::to_string(::getpid()));
  std::filesystem::path file_ = folder_ / "a.txt";
};

TEST_F(WholeFile, TakesThePlaceOfWhatWasThere) {
  write_whole_file(file_, "first");
  write_whole_file(file_, std::string("sec\0ond", 7));
  EXPECT_EQ(text(), std::string("sec\0ond", 7));
  EXPECT_EQ(entries(), 1);
}

TEST_F(WholeFile, IsWrittenAsideUnderANameOfThisProcess) {
  EXPECT_THAT(aside_of(file_).filename().string(), HasSubstr(std::to_string(::getpid())));
  EXPECT_EQ(aside_of(file_).parent_path(), folder_);
}

/// What cannot be written whole is named with its reason, and leaves what was there, and nothing beside it.
TEST_F(WholeFile, LeavesWhatWasThereWhenTheDiskIsFull) {
  write_whole_file(file_, "first");
  const pid_t child = ::fork();  // the limit is of a whole process
  if (child == 0) {
    const rlimit limit{1000, 1000};
    ::signal(SIGXFSZ, SIG_IGN);  // write() fails with EFBIG
    ::setrlimit(RLIMIT_FSIZE, &limit);
    try {
      write_whole_file(file_, std::string(100'000, 'x'));
    } catch (const std::exception& e) {
      ::_exit(std::string(e.what()) == file_.string() + ": cannot be written: File too large" ? 7 : 1);
    }
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(WEXITSTATUS(status), 7);
  EXPECT_EQ(text(), "first");
  EXPECT_EQ(entries(), 1);
}

TEST_F(WholeFile, SeveralTakeTheirPlacesTogetherOrNotAtAll) {
  write_whole_file(file_, "first");
  std::filesystem::create_directory(folder_ / "b.txt");
  try {
    WholeFiles files;
    files.add(file_, "second");
    files.add(folder_ / "b.txt", "beside");
    FAIL() << "a folder was written";
  } catch (const WriteError& e) {
    EXPECT_EQ(e.file(), folder_ / "b.txt");
    EXPECT_EQ(e.reason(), "it is a folder");
  }
  EXPECT_EQ(text(), "first");
  EXPECT_EQ(entries(), 2);
  std::filesystem::remove(folder_ / "b.txt");
  WholeFiles files;
  files.add(file_, "second");
  files.add(folder_ / "b.txt", "beside");
  EXPECT_EQ(text(), "first");
  files.put();
  EXPECT_EQ(text(), "second");
  EXPECT_EQ(entries(), 2);
}

TEST_F(WholeFile, SaysWhyThereIsNoPlaceForIt) {
  const auto said = [](const std::filesystem::path& file) {
    try {
      write_whole_file(file, "x");
    } catch (const std::runtime_error& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_THAT(said(folder_ / "none/a.txt"), HasSubstr("none/a.txt: cannot be written: No such file or directory"));
  EXPECT_THAT(said(folder_), HasSubstr(": cannot be written: it is a folder"));
  EXPECT_EQ(entries(), 0);
}

}  // namespace
}  // namespace isorig::base
