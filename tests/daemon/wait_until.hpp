#pragma once
#include <chrono>
#include <functional>
#include <thread>

namespace isorig::daemon::test {

/// For what another process or thread does in its own time; the limit only says when to give up.
inline bool wait_until(double seconds, const std::function<bool()>& condition) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

}  // namespace isorig::daemon::test
