#include "cli/campaign/local.hpp"

#include <chrono>
#include <fstream>
#include <mutex>
#include <thread>
#include <vector>

namespace isorig::cli::pieces {
namespace {

constexpr double kLook_s = 0.25;
constexpr auto kPatience = std::chrono::seconds(5);  // for a child that does not end by SIGTERM

/// The lines of a list that are this process's, one after the other to whoever asks.
class Source {
 public:
  Source(const std::filesystem::path& list, Share share) : in_(list), share_(share) {
    if (!in_) throw PlanError(list.string() + ": cannot be read; give the whole command again");
  }
  bool next(std::string& recording) {
    while (std::getline(in_, recording))
      if (line_++ % share_.of == share_.task) return true;
    return false;
  }

 private:
  std::ifstream in_;
  Share share_;
  std::size_t line_ = 0;
};

}  // namespace

Done make_pieces(Workshop shop, const std::filesystem::path& list, Share share, unsigned jobs, const Signals& signals,
                 const std::function<void(const std::string&, const Attempt&)>& ended,
                 const std::function<void(const Done&)>& meanwhile) {
  base::Processes processes;
  shop.among = &processes;
  Source source(list, share);
  Done done;
  std::mutex mutex;
  bool stop = false;
  unsigned working = jobs;
  const auto work = [&] {
    std::string recording;
    while (true) {
      {
        const std::lock_guard lock(mutex);
        if (stop || !source.next(recording)) break;
      }
      Attempt attempt;
      std::string why;
      try {
        attempt = make_piece(shop, recording);
      } catch (const CannotGoOn& e) {
        why = e.what();
      }
      const std::lock_guard lock(mutex);
      if (!why.empty()) {
        stop = true;
        done.cannot_go_on = why;
      } else if (attempt.ended != Ended::kInterrupted) {
        ++done.ended;
        if (attempt.ended == Ended::kFailed) ++done.failed;
        done.last = recording;
        if (ended) ended(recording, attempt);
      }
    }
    const std::lock_guard lock(mutex);
    --working;
  };
  std::vector<std::jthread> threads;
  for (unsigned i = 0; i < jobs; ++i) threads.emplace_back(work);
  std::chrono::steady_clock::time_point signalled;
  for (bool over = false; !over;) {
    const int signal_number = signals.wait(kLook_s);
    Done now;
    {
      const std::lock_guard lock(mutex);
      if (signal_number != 0 && done.stopped_by == 0) {
        stop = true;
        done.stopped_by = signal_number;
        signalled = std::chrono::steady_clock::now();
        processes.end(SIGTERM);
      } else if (done.stopped_by != 0 && std::chrono::steady_clock::now() - signalled > kPatience) {
        processes.end(SIGKILL);
      }
      now = done;
      over = working == 0;
    }
    if (meanwhile) meanwhile(now);
  }
  threads.clear();
  return done;
}

}  // namespace isorig::cli::pieces
