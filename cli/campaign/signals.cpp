#include "cli/campaign/signals.hpp"

#include <pthread.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <initializer_list>

namespace isorig::cli::pieces {

Signals::Signals() {
  sigemptyset(&set_);
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&set_, number);
  ::pthread_sigmask(SIG_BLOCK, &set_, &before_);
}

Signals::~Signals() {
  ::pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

int Signals::wait(double seconds) const {
  const double whole = std::floor(seconds);
  const timespec limit{static_cast<time_t>(whole), static_cast<long>(1e9 * (seconds - whole))};
  const int number = ::sigtimedwait(&set_, nullptr, &limit);
  return number > 0 ? number : 0;
}

void die_of(int signal_number) {
  ::signal(signal_number, SIG_DFL);
  sigset_t one;
  sigemptyset(&one);
  sigaddset(&one, signal_number);
  ::pthread_sigmask(SIG_UNBLOCK, &one, nullptr);
  ::raise(signal_number);
  std::_Exit(128 + signal_number);
}

}  // namespace isorig::cli::pieces
