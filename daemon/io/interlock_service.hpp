#pragma once
#include <cstdint>

#include "daemon/core/links.hpp"
#include "daemon/io/link_keeper.hpp"

namespace isorig::daemon {

/// The chain's inputs, the dump valve and the sync line. The valve is held open only while the loop ticks.
class InterlockService : private LinkKeeper {
 public:
  InterlockService(interlock::Device& device, InterlockLink& link)
      : LinkKeeper(link.health, {.initial_ns = kRetryNs, .max_ns = kRetryNs}, 0), device_(device), link_(link) {}
  void run_once(std::int64_t now_ns) noexcept;
  void shut_down() noexcept;
  /// Waits for an input to change; false at once when the device cannot tell, or is not there.
  bool wait(std::int64_t timeout_ns) noexcept;

 private:
  /// A chip that is plugged in again enumerates in some tenths of a second.
  static constexpr std::int64_t kRetryNs = 500'000'000;

  void turn(std::int64_t now_ns);
  void drop(std::int64_t now_ns) noexcept override;
  void complete(LinkHealth& health) const noexcept override;

  interlock::Device& device_;
  InterlockLink& link_;
  LoopWatch loop_;
  bool holding_ = false;
};

}  // namespace isorig::daemon
