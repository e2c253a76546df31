// What a power cut leaves of a run on a disk: the recorder writes to ext4 in the virtual bench, qemu logs every write
// and flush of the disk (blklogwrites). The log is cut at a random entry. What was written before the last flush is
// there; of each write since, each sector of 512 bytes has reached the disk or has not. e2fsck replays the journal.
#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <random>

#include "tests/system/cut_judge.hpp"

namespace isorig::system_test {
namespace {

constexpr std::size_t kSector = 512, kDiskBytes = std::size_t{192} << 20U;
constexpr std::uint64_t kFlush = 1, kFua = 2, kDiscard = 4, kMark = 8;

/// An entry of the log, in the format of the kernel's dm-log-writes.
struct Logged {
  std::uint64_t sector, flags;
  std::string_view bytes;
};

std::uint64_t number_at(std::string_view bytes, std::size_t at) {
  std::uint64_t value = 0;
  std::memcpy(&value, bytes.substr(at, sizeof value).data(), sizeof value);
  return value;
}

std::vector<Logged> read_log(std::string_view log) {
  if (log.size() < kSector || number_at(log, 0) != 0x6a736677736872ULL) throw std::runtime_error("no log of writes");
  const auto count = number_at(log, 16);
  std::vector<Logged> all;
  std::size_t at = kSector;
  for (std::uint64_t n = 0; n < count; ++n) {
    if (at + kSector > log.size()) throw std::runtime_error("the log is cut");
    const auto flags = number_at(log, at + 16);
    const std::size_t size = (flags & kDiscard) != 0 ? 0
                             : (flags & kMark) != 0  ? number_at(log, at + 24)
                                                     : number_at(log, at + 8) * kSector;
    if (at + kSector + size > log.size()) throw std::runtime_error("the log is cut");
    all.push_back({number_at(log, at), flags, log.substr(at + kSector, size)});
    at += kSector + (size + kSector - 1) / kSector * kSector;
  }
  return all;
}

void apply(std::string& disk, const Logged& entry) {
  disk.replace(entry.sector * kSector, entry.bytes.size(), entry.bytes);
}

/// Without its zeros: most of a disk was never written.
void spit_sparse(const std::filesystem::path& path, const std::string& disk) {
  constexpr std::size_t kBlock = 4096;
  std::ofstream(path, std::ios::binary | std::ios::trunc).close();
  std::filesystem::resize_file(path, disk.size());
  std::fstream out(path, std::ios::binary | std::ios::in | std::ios::out);
  static const std::string zeros(kBlock, '\0');
  for (std::size_t at = 0; at < disk.size(); at += kBlock) {
    if (disk.compare(at, kBlock, zeros) == 0) continue;
    out.seekp(static_cast<std::streamoff>(at));
    out.write(disk.data() + at, kBlock);
  }
}

class DiskCut : public ::testing::Test {
 protected:
  int command(std::vector<std::string> words, double limit_s = 60.0) {
    Process process(std::move(words), dir_ / "command.log");
    return process.wait(limit_s);
  }

  /// dir_ / "runs" becomes what is in the file system after its journal was replayed.
  void take_runs(const std::string& disk) {
    spit_sparse(dir_ / "cut", disk);
    const int checked = command({"/sbin/e2fsck", "-fy", (dir_ / "cut").string()});
    ASSERT_TRUE(checked == 0 || checked == 1) << checked << slurp(dir_ / "command.log");  // 1: mended, as a journal is
    std::filesystem::remove_all(dir_ / "runs");
    ASSERT_EQ(command({"/sbin/debugfs", "-R", "rdump /runs " + dir_.path().string(), (dir_ / "cut").string()}), 0);
  }

  const TempDir dir_;
  CutJudge judge_{dir_, {}, {}};
};

TEST_F(DiskCut, AtAnyWriteCostsNoMoreThanStated) {
  spit(dir_ / "three.toml", kThreeRepetitions);
  judge_.rig = crash_rig(dir_);
  // The disk is small; what a crash costs does not depend on it.
  spit(judge_.rig, replaced(slurp(judge_.rig), "[recorder]\n", "[recorder]\nmin_free_MiB = 32\nreserve_MiB = 8\n"));
  std::ofstream(dir_ / "disk").close();
  std::filesystem::resize_file(dir_ / "disk", kDiskBytes);
  // 4 MiB at the end stay outside of the file system: the rig's time is in the last sector.
  ASSERT_EQ(command({"/sbin/mke2fs", "-q", "-F", "-t", "ext4", "-b", "4096", "-E", "lazy_itable_init=0,nodiscard",
                     (dir_ / "disk").string(), std::to_string(((kDiskBytes >> 20U) - 4) * 256)}),
            0)
      << slurp(dir_ / "command.log");
  std::string before = slurp(dir_ / "disk");
  std::ofstream(dir_ / "log").close();
  const std::string qemu =
      "-blockdev driver=blklogwrites,node-name=logged,log-sector-size=512,file.driver=file,"
      "file.filename=" +
      (dir_ / "disk").string() + ",log.driver=file,log.filename=" + (dir_ / "log").string() +
      " -device virtio-blk-pci,drive=logged,write-cache=on,discard=off,write-zeroes=off";
  ASSERT_EQ(command({source("virtual-bench/run"), "--modules", "virtio_blk ext4", "--timeout", "400", "--qemu", qemu,
                     "--", "bash", "-c",
                     "mount -t ext4 /dev/vda /mnt && " + bin("kill_victim") + " " + (dir_ / "three.toml").string() +
                         " " + judge_.rig.string() + " /mnt/runs /dev/vda && sync && umount /mnt"},
                    420.0),
            0)
      << slurp(dir_ / "command.log");
  const auto log_bytes = slurp(dir_ / "log");
  const auto log = read_log(log_bytes);
  std::string all = before;
  for (const auto& entry : log) {
    ASSERT_EQ(entry.flags & (kFua | kDiscard | kMark), 0U);  // the disk offers flushes alone
    apply(all, entry);
  }
  ASSERT_EQ(all, slurp(dir_ / "disk"));  // the log is all there is to the disk
  ASSERT_NO_FATAL_FAILURE(take_runs(all));
  const auto whole = settled_run(dir_ / "runs");
  ASSERT_TRUE(whole);
  ASSERT_EQ(messages::read_run(whole->directory, judge_.due).state(), messages::RecordingState::kWhole);
  ASSERT_EQ(judge_.due.complete.size(), 3U);

  constexpr std::uint64_t kClockSector = kDiskBytes / kSector - 1;
  // Nine tenths of the entries are marks of the clock: a cut behind one meets the same file system as the one before.
  std::vector<std::size_t> behind;
  for (std::size_t i = 0; i < log.size(); ++i)
    if (log[i].sector != kClockSector || log[i].bytes.empty()) behind.push_back(i + 1);
  const int cuts = crashes_asked(12);
  std::mt19937_64 random(crash_seed());
  int no_run = 0;
  for (int n = 0; n < cuts && !HasFailure(); ++n) {
    const auto at = behind[std::uniform_int_distribution<std::size_t>(0, behind.size() - 1)(random)];
    std::int64_t rig_ns = 0;  // the cut was no earlier
    std::size_t flushed = 0;
    for (std::size_t i = 0; i < at; ++i) {
      if ((log[i].flags & kFlush) != 0) flushed = i + 1;
      if (log[i].sector == kClockSector && !log[i].bytes.empty())
        rig_ns = static_cast<std::int64_t>(number_at(log[i].bytes, 0));
    }
    auto left = before;
    for (std::size_t i = 0; i < flushed; ++i) apply(left, log[i]);
    const double reached = std::uniform_real_distribution<>(0.0, 1.0)(random);
    for (std::size_t i = flushed; i < at; ++i) {
      for (std::size_t from = 0; from < log[i].bytes.size(); from += kSector) {
        if (std::uniform_real_distribution<>(0.0, 1.0)(random) < reached)
          left.replace(log[i].sector * kSector + from, kSector, log[i].bytes.substr(from, kSector));
      }
    }
    ASSERT_NO_FATAL_FAILURE(take_runs(left)) << "cut " << n;
    const auto safe_ns = rig_ns - static_cast<std::int64_t>(kBound_s * 1e9);
    std::optional<daemon::RunRow> row;
    if (std::filesystem::exists(dir_ / "runs")) row = settled_run(dir_ / "runs");
    if (!row) {
      EXPECT_EQ(rows_lost(judge_.due, Rows{}, safe_ns), 0U) << "cut " << n << ": no run";
      ++no_run;
      continue;
    }
    judge_.expect_told(n, row->directory, safe_ns);
  }
  judge_.tell("cuts of a disk", cuts);
  std::printf("  %zu entries in the disk's log; %d cuts before there was a run\n", log.size(), no_run);
  EXPECT_GT(judge_.interrupted + judge_.damaged, 0);
}

}  // namespace
}  // namespace isorig::system_test
