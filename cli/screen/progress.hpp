#pragma once
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

/// What a command shows while somebody waits for it.
namespace isorig::cli {

/// "diagnose  [####......]  41.0 %, 12.5 s so far, about 18 s left: weighing effects", cut to `columns`. The time left
/// is what `fraction` promises with the time `at_s` when it was reached; said from 5 % and 5 s on, until it has gone
/// by. `from`: the fraction that was done before the time began, of which nobody knows how long it took.
[[nodiscard]] std::string progress_text(const std::string& what, double fraction, double at_s, double so_far_s,
                                        const std::string& doing, int columns, double from = 0.0);

/// One line on standard error from the third second on, and only where that is a terminal; gone without a trace when
/// this ends. Elsewhere it does nothing. A thread of its own keeps the time running through long stages.
class Progress {
 public:
  explicit Progress(std::string what, bool wanted = true);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// How much of the work is done, 0 to 1, and what is being done. From any thread.
  void at(double fraction, std::string doing = {});
  /// What is being done, where nobody knows how much of it.
  void says(std::string doing);
  /// So much was done by others before this began to watch.
  void begins_at(double fraction);

 private:
  void redraw();
  [[nodiscard]] double so_far_s() const;

  std::string what_, doing_;
  double fraction_ = 0.0, at_s_ = 0.0, from_ = 0.0;
  bool drawn_ = false, over_ = false;
  std::chrono::steady_clock::time_point began_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::thread thread_;  // none where nothing is shown
};

/// Work on one file after the other, each with a share of the bar by its size.
class FilesProgress {
 public:
  /// `files`: of each what is read of it; one that is not there has no share.
  FilesProgress(std::string what, const std::vector<std::filesystem::path>& files);
  /// Of the file with this number, which part is done.
  void at(std::size_t file, double fraction, std::string doing = {});
  /// Which part of all that is, 0 to 1. Throws std::out_of_range: there is no such file.
  [[nodiscard]] double part_of_all(std::size_t file, double fraction) const;

 private:
  std::vector<double> until_;  ///< share of all files before this one, and 1 behind the last
  Progress progress_;
};

}  // namespace isorig::cli
