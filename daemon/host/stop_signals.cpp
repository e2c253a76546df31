#include "daemon/host/stop_signals.hpp"

#include <ctime>

namespace isorig::daemon {

StopSignals::StopSignals() {
  sigemptyset(&ending_);
  for (const int number : {SIGTERM, SIGINT, SIGQUIT, SIGHUP, SIGPWR, SIGXCPU}) {
    struct sigaction present {};
    if (::sigaction(number, nullptr, &present) == 0 && present.sa_handler == SIG_IGN) continue;
    sigaddset(&ending_, number);
  }
  pthread_sigmask(SIG_BLOCK, &ending_, nullptr);
  for (const int number :
       {SIGPIPE, SIGXFSZ, SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGIO, SIGSTKFLT, SIGTSTP, SIGTTIN, SIGTTOU}) {
    ::signal(number, SIG_IGN);
  }
}

int StopSignals::wait(std::chrono::milliseconds patience) const {
  const timespec limit{patience.count() / 1000, patience.count() % 1000 * 1'000'000};
  const int number = ::sigtimedwait(&ending_, nullptr, &limit);
  return number > 0 ? number : 0;
}

}  // namespace isorig::daemon
