#pragma once
#include <signal.h>

namespace isorig::cli::pieces {

/// Ctrl-C and its kin as something to wait for: blocked while this lives, in this thread and all that it starts.
class Signals {
 public:
  Signals();
  ~Signals();
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;

  /// SIGINT, SIGTERM or SIGHUP, or 0 when none came within that time.
  [[nodiscard]] int wait(double seconds) const;
  /// One of them has come and nobody has waited for it yet. It is left to wait(). From any thread.
  [[nodiscard]] bool came() const;

 private:
  sigset_t set_, before_;
};

/// Ends this process by that signal, as whoever sent it expects (a shell's loop ends too).
[[noreturn]] void die_of(int signal_number);

}  // namespace isorig::cli::pieces
