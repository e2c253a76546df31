#include "cli/campaign/signals.hpp"

#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

namespace isorig::cli::pieces {
namespace {

constexpr std::array kNumbers{SIGINT, SIGTERM, SIGHUP};

}  // namespace

Signals::Signals() {
  sigemptyset(&set_);
  for (const int number : kNumbers) sigaddset(&set_, number);
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

bool Signals::came() const {
  sigset_t pending;
  ::sigpending(&pending);
  return std::ranges::any_of(kNumbers, [&](int number) { return ::sigismember(&pending, number) == 1; });
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
