#pragma once
#include "recorded_rows.hpp"

namespace isorig::system_test {

/// Judges what a power cut left of a run, and goes on with it: whether the cut was made of a trace of the files'
/// writes (power_cut_test.cpp) or of those of a disk (tests/vm/disk_cut_test.cpp). The runs are in dir / "runs".
struct CutJudge {
  /// What is there is right and not called more than it is, nothing older than `safe_ns` is gone, and it can be gone
  /// on with.
  void expect_told(int n, const std::filesystem::path& folder, std::int64_t safe_ns) {
    Rows is;
    messages::ReadReport report;
    ASSERT_NO_THROW(report = messages::read_run(folder, is)) << n;
    EXPECT_TRUE(rows_are_right(due, is)) << n;
    EXPECT_EQ(rows_lost(due, is, safe_ns), 0U) << n;
    if (report.state() == messages::RecordingState::kWhole) {
      EXPECT_TRUE(is.of == due.of) << n << ": called whole";
      ++whole_left;
      return;
    }
    EXPECT_FALSE(report.complaints().empty()) << n;
    if (!report.has_header) {  // the run had not begun: its header is synced before anything else is done
      EXPECT_TRUE(is.of.empty()) << n;
      const auto refused = isorig(dir, {"run", "--resume", folder.filename().string(), "--rig", rig.string(), "--runs",
                                        (dir / "runs").string(), "--quiet"});
      EXPECT_NE(refused.code, 0) << n;
      EXPECT_FALSE(refused.text.empty()) << n;
      ++not_begun;
      return;
    }
    EXPECT_NE(report.state(), messages::RecordingState::kIncomplete)
        << n << testing::PrintToString(report.complaints());
    const bool is_damaged = report.state() == messages::RecordingState::kDamaged;
    ++(is_damaged ? damaged : interrupted);
    const auto row = settled_run(dir / "runs");
    ASSERT_TRUE(row) << n;
    EXPECT_NE(row->state, "done") << n;
    // What was altered stays so, and is said for as long as the recording is there.
    if (is_damaged) {
      expect_resumed(dir, dir / "runs", rig, row->id, due, is, {messages::RecordingState::kDamaged});
    } else {
      expect_resumed(dir, dir / "runs", rig, row->id, due, is, {messages::RecordingState::kWhole});
    }
    ++resumed;
  }

  void tell(const char* what, int count) const {
    std::printf(
        "  %d %s: %d told interrupted, %d told damaged, %d of both gone on with to the end; %d behind the end, %d "
        "before "
        "the run had begun\n",
        count, what, interrupted, damaged, resumed, whole_left, not_begun);
  }

  const TempDir& dir;
  std::filesystem::path rig;
  Rows due;
  int interrupted = 0, damaged = 0, resumed = 0, whole_left = 0, not_begun = 0;
};

}  // namespace isorig::system_test
