// `isorig export` in every format, read by what laboratories read with: pandas, numpy, h5py, h5dump, Octave.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <map>

#include "processes.hpp"

namespace isorig::system_test {
namespace {

using testing::HasSubstr;

std::string record(const TempDir& dir) {
  auto runs = (dir / "runs").string();
  Process run({bin("isorig"), "run", source("config/protocols/vma-short.toml"), "--rig", source("config/rigs/sim.toml"),
               "--runs", runs, "--no-report", "--quiet", "--json"},
              dir / "run.json");
  EXPECT_EQ(run.wait(120.0), 0) << run.output();
  return runs;
}

std::map<std::string, std::string> files_in(const std::filesystem::path& folder) {
  std::map<std::string, std::string> all;
  if (!std::filesystem::exists(folder)) return all;  // nothing was written
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) all.emplace(entry.path().string(), slurp(entry.path()));
  }
  return all;
}

TEST(ExportFormats, SayTheSameToEveryReader) {
  const TempDir dir;
  const auto runs = record(dir);
  const auto directory = nlohmann::json::parse(slurp(dir / "run.json"))["directory"].get<std::string>();
  const auto name = std::filesystem::path(directory).filename().string();
  for (const std::string format : {"csv", "hdf5", "mat"}) {
    Process out(
        {bin("isorig"), "export", "latest", "--runs", runs, "--format", format, "--out", (dir / format).string()},
        dir / (format + ".log"));
    ASSERT_EQ(out.wait(60.0), 0) << out.output();
  }
  EXPECT_TRUE(std::filesystem::exists(dir / "csv" / "rep-1_05-psi")) << "10 psi is in the plan too";
  // Debian's Python, whose packages these are, whatever else is on the PATH.
  Process readers({"/usr/bin/python3", source("tests/system/read_exports.py"), (dir / "csv").string(),
                   (dir / "hdf5" / (name + ".h5")).string(), (dir / "mat" / name).string()},
                  dir / "readers.log");
  EXPECT_EQ(readers.wait(240.0), 0) << readers.output();
}

/// The files of `folder` by their place in it.
std::map<std::string, std::string> content_of(const std::filesystem::path& folder) {
  std::map<std::string, std::string> all;
  for (auto& [path, text] : files_in(folder)) all.emplace(std::filesystem::relative(path, folder), std::move(text));
  return all;
}

/// Two real ones, whose rows differ: of the times as they were stamped, and of the times that are mapped again.
TEST(ExportFormats, OfTwoIntoOneFolderAtOnceNoFileIsOfBoth) {
  const TempDir dir;
  const auto runs = record(dir);
  const auto words = [&](const std::string& format, const std::filesystem::path& out, bool remapped) {
    std::vector<std::string> all{bin("isorig"), "export", "latest", "--runs",    runs,
                                 "--format",    format,   "--out",  out.string()};
    if (remapped) all.emplace_back("--remap");
    return all;
  };
  int refused = 0;
  for (const std::string format : {"csv", "hdf5", "mat"}) {
    std::array<std::map<std::string, std::string>, 2> alone;
    for (const bool remapped : {false, true}) {
      const auto out = dir / (format + (remapped ? "-remapped" : "-stamped"));
      ASSERT_EQ(run(dir, words(format, out, remapped)).code, 0);
      alone[remapped ? 1 : 0] = content_of(out);
    }
    ASSERT_NE(alone[0], alone[1]) << format << ": nobody could tell whose a row is";
    for (int pair = 0; pair < 4; ++pair) {
      const auto out = dir / (format + std::to_string(pair));
      Gate gate;
      const auto wait = [&gate] { gate.wait(); };
      Process stamped(words(format, out, false), dir / "stamped.log", wait);
      Process remapped(words(format, out, true), dir / "remapped.log", wait);
      gate.open();
      const std::array<int, 2> codes{stamped.wait(60.0), remapped.wait(60.0)};
      const auto there = content_of(out);
      bool is_one_of_them = false;
      for (std::size_t i = 0; i < codes.size(); ++i) {
        const auto said = (i == 0 ? stamped : remapped).output();
        if (codes[i] == 0) {
          is_one_of_them = is_one_of_them || there == alone[i];
        } else {
          EXPECT_EQ(codes[i], 1) << said;
          EXPECT_THAT(said, HasSubstr("another command writes into this folder now")) << format;
          ++refused;
        }
      }
      EXPECT_TRUE(is_one_of_them) << format << ", pair " << pair << ": " << codes[0] << ", " << codes[1];
    }
  }
  EXPECT_GT(refused, 0) << "no two of twelve pairs were there at once";
}

/// While one is under way, which is held here for as long as the test likes.
TEST(ExportFormats, AFolderTakesOneExportAtATime) {
  const TempDir dir;
  const auto runs = record(dir);
  const auto out = (dir / "out").string();
  std::filesystem::create_directories(out);
  const int held = ::open(out.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  ASSERT_EQ(::flock(held, LOCK_EX), 0);  // as an export that is under way has it
  for (const std::string format : {"csv", "hdf5", "mat"}) {
    Process second({bin("isorig"), "export", "latest", "--runs", runs, "--format", format, "--out", out},
                   dir / (format + ".log"));
    EXPECT_EQ(second.wait(60.0), 1) << second.output();
    EXPECT_THAT(second.output(), HasSubstr("out: another command writes into this folder now")) << format;
  }
  EXPECT_TRUE(files_in(out).empty());
  ::close(held);
  Process alone({bin("isorig"), "export", "latest", "--runs", runs, "--out", out}, dir / "alone.log");
  EXPECT_EQ(alone.wait(60.0), 0) << alone.output();
}

/// A file that cannot grow beyond 700 kB: above the 282 kB of a MAT session's columns, below the 1.1 MB of the least
/// file of every format. What a full disk does to write() it does too, without a disk of its own.
TEST(ExportFormats, AFullDiskIsOneMessageAndNoCutFile) {
  const TempDir dir;
  const auto runs = record(dir);
  const auto with_little_room = [] {
    const rlimit little{700'000, 700'000};
    ::setrlimit(RLIMIT_FSIZE, &little);
    ::signal(SIGXFSZ, SIG_IGN);  // write() fails with EFBIG
  };
  for (const std::string format : {"csv", "hdf5", "mat"}) {
    const auto into = [&](const std::string& out, const std::function<void()>& in_child) {
      Process process({bin("isorig"), "export", "latest", "--runs", runs, "--format", format, "--out",
                       (dir / (format + out)).string()},
                      dir / (format + out + ".log"), in_child);
      return std::pair{process.wait(60.0), process.output()};
    };
    const auto is_one_message = [&](const std::pair<int, std::string>& ended) {
      EXPECT_EQ(ended.first, 1) << format;
      EXPECT_EQ(std::count(ended.second.begin(), ended.second.end(), '\n'), 1) << ended.second;
      EXPECT_THAT(ended.second, HasSubstr("check the disk's space and permissions"));
    };
    is_one_message(into("-anew", with_little_room));
    EXPECT_THAT(files_in(dir / (format + "-anew")), testing::IsEmpty());
    EXPECT_FALSE(std::filesystem::exists(dir / "csv-anew" / "rep-1_05-psi"));
    ASSERT_EQ(into("-again", {}).first, 0);
    const auto earlier = files_in(dir / (format + "-again"));
    std::size_t largest = 0;
    for (const auto& [path, text] : earlier) largest = std::max(largest, text.size());
    ASSERT_GT(largest, 700'000U) << "the limit has to be met";
    is_one_message(into("-again", with_little_room));
    EXPECT_TRUE(files_in(dir / (format + "-again")) == earlier) << format;
  }
}

TEST(ExportFormats, WhatIsNotThereIsSaidBeforeAnythingIsWritten) {
  const TempDir dir;
  Process parquet({bin("isorig"), "export", "latest", "--format", "parquet", "--out", (dir / "out").string()},
                  dir / "parquet.log");
  EXPECT_EQ(parquet.wait(20.0), 2);
  EXPECT_THAT(parquet.output(), HasSubstr("no Parquet"));
  EXPECT_FALSE(std::filesystem::exists(dir / "out"));
}

}  // namespace
}  // namespace isorig::system_test
