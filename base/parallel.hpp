#pragma once
#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace isorig::base {

/// Calls `work(i)` for every i < count, from up to `threads` threads (the caller's is one of them), and returns when
/// all have ended. When work throws, nothing further is begun, and the exception of the lowest i comes out here: the
/// same one whatever the schedule, since every lower i had been begun before. Where the machine gives no more threads,
/// those that there are do all of it.
template <class Work>
void parallel_for(std::size_t count, unsigned threads, Work&& work) {
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::exception_ptr failure;
  std::size_t failed = count;
  const auto worker = [&]() noexcept {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        work(i);
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (i < failed) {
          failed = i;
          failure = std::current_exception();
        }
        next = count;
      }
    }
  };
  {
    std::vector<std::jthread> pool;
    const std::size_t wanted = std::min<std::size_t>(std::max(1U, threads), count);
    if (wanted > 1) pool.reserve(wanted - 1);
    for (std::size_t t = 1; t < wanted; ++t) {
      try {
        pool.emplace_back(worker);
      } catch (const std::system_error&) {
        break;
      }
    }
    worker();
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace isorig::base
