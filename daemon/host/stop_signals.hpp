#pragma once
#include <signal.h>

#include <chrono>

namespace isorig::daemon {

/// Every signal that would end or stop the process at once. Those that mean "end" (SIGTERM, SIGINT, SIGQUIT, SIGHUP of
/// a closed terminal, SIGPWR, SIGXCPU) are kept for wait(), so that a run ends with the frame stopped and vented. The
/// others are ignored: a file size limit (SIGXFSZ) and a closed pipe are errors of a write, which is told of them; a
/// daemon that Ctrl-Z or a background terminal stops would be a loop that hangs; the rest has no meaning here.
class StopSignals {
 public:
  /// Before any thread is made: they inherit the mask. What was ignored already (nohup, a script's background job)
  /// stays ignored.
  StopSignals();

  /// The next one's number; 0 when none came.
  [[nodiscard]] int wait(std::chrono::milliseconds patience) const;

 private:
  sigset_t ending_{};
};

}  // namespace isorig::daemon
