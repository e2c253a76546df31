#include "cli/screen/progress.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "base/formatted.hpp"
#include "base/printable.hpp"
#include "cli/screen/duration.hpp"
#include "cli/screen/screen.hpp"
#include "cli/screen/terminal.hpp"
#include "cli/screen/view.hpp"

namespace isorig::cli {
namespace {

constexpr auto kSilent = std::chrono::seconds(2);
constexpr auto kBetween = std::chrono::milliseconds(250);
constexpr double kSure = 0.05;
constexpr double kSure_s = 5.0;

}  // namespace

std::string progress_text(const std::string& what, double fraction, double at_s, double so_far_s,
                          const std::string& doing, int columns, double from) {
  const int bar = std::clamp(columns - 70, 10, 30);
  std::string text = what + "  " + progress_bar(fraction, bar) + ", " + duration_text(so_far_s) + " so far";
  const double own = from < 1.0 ? std::max(0.0, (fraction - from) / (1.0 - from)) : 0.0;  // of what was left then
  const double left_s = own > 0.0 ? at_s / own - so_far_s : 0.0;
  if (own >= kSure && so_far_s >= kSure_s && left_s > 0.0) {
    text += ", about " + duration_text(left_s) + " left";
  }
  if (!doing.empty()) text += ": " + doing;
  return cut(base::printable(text), columns);
}

Progress::Progress(std::string what, bool wanted) : what_(std::move(what)), began_(std::chrono::steady_clock::now()) {
  if (!wanted || ::isatty(STDERR_FILENO) == 0) return;
  thread_ = std::thread([this] {
    std::unique_lock lock(mutex_);
    if (wake_.wait_for(lock, kSilent, [this] { return over_; })) return;
    do {
      redraw();
    } while (!wake_.wait_for(lock, kBetween, [this] { return over_; }));
  });
}

Progress::~Progress() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    over_ = true;
  }
  wake_.notify_all();
  thread_.join();
  if (drawn_) std::fputs("\r\x1b[K", stderr);
}

void Progress::at(double fraction, std::string doing) {
  const std::lock_guard lock(mutex_);
  fraction_ = std::clamp(fraction, 0.0, 1.0);
  at_s_ = so_far_s();
  doing_ = std::move(doing);
}

void Progress::says(std::string doing) {
  const std::lock_guard lock(mutex_);
  doing_ = std::move(doing);
}

void Progress::begins_at(double fraction) {
  const std::lock_guard lock(mutex_);
  from_ = std::clamp(fraction, 0.0, 1.0);
}

double Progress::so_far_s() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - began_).count();
}

FilesProgress::FilesProgress(std::string what, const std::vector<std::filesystem::path>& files)
    : progress_(std::move(what)) {
  double all = 0.0;
  for (const auto& file : files) {
    until_.push_back(all);
    std::error_code none;
    const auto bytes = std::filesystem::file_size(file, none);
    if (!none) all += static_cast<double>(bytes);
  }
  until_.push_back(all);
  for (double& part : until_) part = all > 0.0 ? part / all : 0.0;
}

double FilesProgress::part_of_all(std::size_t file, double fraction) const {
  return until_.at(file) + std::clamp(fraction, 0.0, 1.0) * (until_.at(file + 1) - until_.at(file));
}
void FilesProgress::at(std::size_t file, double fraction, std::string doing) {
  progress_.at(part_of_all(file, fraction), std::move(doing));
}

void Progress::redraw() {
  // Never into the last column: some terminals wrap there.
  const auto text =
      progress_text(what_, fraction_, at_s_, so_far_s(), doing_, terminal_size(STDERR_FILENO).columns - 1, from_);
  std::fprintf(stderr, "\r\x1b[K%s", text.c_str());
  std::fflush(stderr);
  drawn_ = true;
}

}  // namespace isorig::cli
