// What a power cut leaves of a run, on the level of its files: made of a trace of every write and sync of the segments
// (kill_victim.cpp). What was synced is there, and so is every segment whose name was. Of what was written since, each
// sector of 512 bytes has reached the disk or has not; a file is as long as any of its writes had made it. And files
// that end anywhere.
#include <gtest/gtest.h>

#include <random>

#include "cut_judge.hpp"
#include "write_trace.hpp"

namespace isorig::system_test {
namespace {

using messages::RecordingState;

constexpr std::size_t kSector = 512;

class PowerCut : public ::testing::Test {
 protected:
  void SetUp() override {
    spit(dir_ / "three.toml", kThreeRepetitions);
    judge_.rig = crash_rig(dir_);
    Process whole({bin("kill_victim"), (dir_ / "three.toml").string(), judge_.rig.string(), (dir_ / "whole").string(),
                   (dir_ / "clock").string(), (dir_ / "trace").string()},
                  dir_ / "whole.log");
    ASSERT_EQ(whole.wait(120.0), 0) << whole.output();
    const auto run = settled_run(dir_ / "whole");
    ASSERT_TRUE(run);
    whole_ = run->directory;
    ASSERT_EQ(messages::read_run(whole_, judge_.due).state(), RecordingState::kWhole);
    trace_bytes_ = slurp(dir_ / "trace");
    trace_ = read_trace(trace_bytes_);
    std::map<int, std::string> written;
    for (const auto& [entry, bytes] : trace_)
      if (entry.kind == TraceEntry::Kind::kWrite) written[entry.segment].replace(entry.offset, entry.size, bytes);
    for (const auto& [segment, bytes] : written)  // the trace is all there is to the files
      ASSERT_EQ(bytes, slurp(whole_ / messages::segment_name(segment))) << segment;
  }

  /// The run's folder with other segments, and no catalogue: that is made again from the recording.
  std::filesystem::path folder_with(const std::map<int, std::string>& segments) {
    std::filesystem::remove_all(dir_ / "runs");
    const auto folder = dir_ / "runs" / whole_.filename().string();
    std::filesystem::create_directories(folder);
    for (const auto& entry : std::filesystem::directory_iterator(whole_)) {
      if (entry.path().extension() != ".lcm")
        std::filesystem::copy(entry.path(), folder / entry.path().filename(), std::filesystem::copy_options::recursive);
    }
    for (const auto& [segment, bytes] : segments) spit(folder / messages::segment_name(segment), bytes);
    return folder;
  }

  const TempDir dir_;
  std::filesystem::path whole_;
  CutJudge judge_{dir_, {}, {}};
  std::string trace_bytes_;
  std::vector<Traced> trace_;
};

TEST_F(PowerCut, AtAnyMomentCostsNoMoreThanStated) {
  const int cuts = crashes_asked(12);
  std::mt19937_64 random(crash_seed());
  for (int n = 0; n < cuts && !HasFailure(); ++n) {
    const auto at = std::uniform_int_distribution<std::size_t>(1, trace_.size())(random);
    std::map<int, std::string> synced, written;
    int named = 1;  // a run is begun when its first segment's name is on the disk
    for (std::size_t i = 0; i < at; ++i) {
      const auto& [entry, bytes] = trace_[i];
      if (entry.kind == TraceEntry::Kind::kWrite) {
        written[entry.segment].replace(entry.offset, entry.size, bytes);
      } else if (entry.kind == TraceEntry::Kind::kSync) {
        synced[entry.segment] = written[entry.segment];
      } else {
        named = std::max(named, entry.segment);
      }
    }
    std::map<int, std::string> left;
    for (int segment = 1; segment <= named; ++segment) {
      const auto& bytes = written[segment];
      const auto& old = synced[segment];
      auto& now = left[segment] = old;
      const auto size = std::uniform_int_distribution<std::size_t>(old.size(), bytes.size())(random);
      now.resize(size);  // zeros, as a file system shows what was never written
      const double reached = std::uniform_real_distribution<>(0.0, 1.0)(random);
      for (std::size_t sector = old.size() / kSector; sector * kSector < size; ++sector) {
        if (std::uniform_real_distribution<>(0.0, 1.0)(random) >= reached) continue;
        const auto from = sector * kSector, to = std::min(from + kSector, size);
        now.replace(from, to - from, bytes, from, to - from);
      }
    }
    const auto cut_ns = trace_[at - 1].entry.rig_ns;
    judge_.expect_told(n, folder_with(left), cut_ns - static_cast<std::int64_t>(kBound_s * 1e9));
  }
  judge_.tell("power cuts", cuts);
  EXPECT_GT(judge_.interrupted + judge_.damaged, 0);
}

TEST_F(PowerCut, FilesThatEndAnywhereAreToldShort) {
  const int cuts = crashes_asked(12);
  std::mt19937_64 random(crash_seed() + 1);
  std::map<int, std::string> whole;
  for (const auto& file : messages::list_segments(whole_)) whole[messages::segment_number(file)] = slurp(file);
  for (int n = 0; n < cuts && !HasFailure(); ++n) {
    const auto last = std::uniform_int_distribution<int>(1, static_cast<int>(whole.size()))(random);
    std::map<int, std::string> left;
    for (int segment = 1; segment <= last; ++segment) left[segment] = whole.at(segment);
    left[last].resize(std::uniform_int_distribution<std::size_t>(1, left[last].size() - 1)(random));
    judge_.expect_told(n, folder_with(left), std::numeric_limits<std::int64_t>::min());
  }
  judge_.tell("files cut at any byte", cuts);
  EXPECT_EQ(judge_.interrupted + judge_.not_begun, cuts);
}

}  // namespace
}  // namespace isorig::system_test
