#pragma once
#include <array>
#include <atomic>
#include <cstdint>

#include "daemon/core/links.hpp"
#include "daemon/core/standstill.hpp"
#include "daemon/io/sampled_link.hpp"

namespace isorig::daemon {

/// Owns the frame. A stop is a state in here, not a message: once the loop requests it (FrameLink::stops_requested), or
/// the connection is new, device.stop() is repeated at every turn until the frame reports no motion and its samples
/// stand still. Until then no segment is sent, and no heartbeat: the frame's own watchdog is the second way to stop it.
class FrameService : private SampledLink {
 public:
  FrameService(frame::Device& device, FrameLink& link, const ServiceConfig& config, clock::Clock& clock)
      : SampledLink(link.health, config, clock), device_(device), link_(link), clock_(clock) {}
  /// One turn: reconnect if due, stop or segment, poll, heartbeat. Never throws.
  void run_once(std::int64_t now_ns) noexcept;

  /// From now on no segment and no heartbeat goes out, only stops. Whoever calls it goes on with run_once() until
  /// stands(), for a bounded time, and then calls shut_down(). Any thread.
  void leave() noexcept { leaving_.store(true, std::memory_order_release); }
  /// The frame was seen to stand after leave(). Any thread.
  [[nodiscard]] bool stands() const noexcept { return stands_.load(std::memory_order_acquire); }
  /// Closes the connection; called on every way out, after the last run_once(). Takes the turns that are missing
  /// itself, for at most kLeaveNs, when nobody has. False when a frame that was there was not seen to stand: its own
  /// watchdog has to stop it then, and people have to look.
  bool shut_down() noexcept;

  static constexpr std::int64_t kLeaveNs = 1'000'000'000;

 private:
  void turn(std::int64_t now_ns);
  template <typename Call>
  bool attempt(std::int64_t now_ns, const char* what, Call call);
  void drop(std::int64_t now_ns) noexcept override;
  void request_stop() noexcept;
  void begin_stop() noexcept;
  void stop_or_move(std::int64_t now_ns);
  void judge_stop(const frame::State& state) noexcept;
  void take_exchange(const clock::Exchange& exchange);

  frame::Device& device_;
  FrameLink& link_;
  clock::Clock& clock_;
  // Between the exchanges that are kept, the one with the shortest round trip.
  clock::Exchange best_;
  bool has_best_ = false;

  static constexpr std::int64_t kStandstillPeriodNs = 20'000'000;
  Standstill standstill_;
  bool samples_stand_ = false;
  std::int64_t next_standstill_ns_ = 0;
  std::uint32_t stop_request_ = 0;      ///< the newest of FrameLink::stops_requested that was taken up
  bool stop_confirmed_ = false;         ///< ... and has ended in standstill
  std::int64_t stop_accepted_ns_ = -1;  ///< the frame took it; -1: not yet
  bool stood_before_ = false;           ///< ... and stood when it was requested: its samples of before count
  bool told_to_move_ = false;           ///< a segment was sent since it was last seen to stand
  std::uint32_t reference_epoch_ = 0;
  double speed_mm_s_ = 0.0;            ///< of the last segment sent
  std::uint32_t taken_segment_ = 0;    ///< number of the last that the frame took; 0: none since it was connected
  std::uint32_t refused_segment_ = 0;  ///< of the last that it did not take
  std::atomic<bool> leaving_{false};
  std::atomic<bool> stands_{false};
  bool left_ = false;  ///< leave() was taken up
  std::array<frame::Sample, 512> samples_{};
};

}  // namespace isorig::daemon
