#pragma once
#include <chrono>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>

#include "daemon/core/core.hpp"

namespace isorig::daemon {

/// The loop answers within some milliseconds; after this long whoever waits for it is told that it does not.
inline constexpr auto kVerbPatience = std::chrono::seconds(2);

/// Where several threads hand requests to the loop and fetch its answers: the loop's queues have one producer and one
/// consumer. Nothing here waits for anything but another caller's push or pop.
class VerbDesk {
 public:
  explicit VerbDesk(Core& core) : core_(core) {}

  /// The number to ask for the answer with; 0 when the loop takes no requests. An abort always gets through.
  [[nodiscard]] std::uint32_t submit(Request request) {
    const std::lock_guard hold(mutex_);
    request.id = next_++;
    if (next_ == 0) next_ = 1;
    if (core_.requests.push(request)) return request.id;
    if (request.verb != Request::Verb::kAbort) return 0;
    core_.request_abort();
    Reply taken;
    taken.id = request.id;
    taken.accepted = true;
    copy_text(taken.text, "the abort overtakes what the loop has not taken yet; see isorig status");
    keep(taken);
    return request.id;
  }

  /// Nothing: not answered yet.
  [[nodiscard]] std::optional<Reply> reply_to(std::uint32_t id) {
    const std::lock_guard hold(mutex_);
    Reply reply;
    while (core_.replies.pop(reply)) keep(reply);
    for (auto it = arrived_.begin(); it != arrived_.end(); ++it) {
      if (it->id != id) continue;
      reply = *it;
      arrived_.erase(it);
      return reply;
    }
    return std::nullopt;
  }

  /// Nobody waits for the answer any more: an operator who was told so does not expect a motion.
  void withdraw(std::uint32_t id) noexcept { core_.withdraw(id); }

 private:
  void keep(const Reply& reply) {
    arrived_.push_back(reply);
    if (arrived_.size() > kKept) arrived_.pop_front();  // nobody waits for it any more
  }

  static constexpr std::size_t kKept = 256;
  Core& core_;
  std::mutex mutex_;
  std::uint32_t next_ = 1;
  std::deque<Reply> arrived_;
};

}  // namespace isorig::daemon
