#include "daemon/io/frame_service.hpp"

#include <optional>
#include <span>

namespace isorig::daemon {

void FrameService::run_once(std::int64_t now_ns) noexcept {
  keep(now_ns, [&] { turn(now_ns); });
}

/// What fails here is noted and does not keep the rest of the turn from happening. False when it failed.
template <typename Call>
bool FrameService::attempt(std::int64_t now_ns, const char* what, Call call) {
  try {
    call();
    return true;
  } catch (const drivers::DeviceError& error) {
    fail(now_ns, drivers::DeviceError(error.fault(), std::string(what) + ": " + error.what()));
    return false;
  }
}

void FrameService::turn(std::int64_t now_ns) {
  if (!health_.connected) {
    FrameCommand stale;  // a segment for a frame that was not there must not run when it comes back
    while (link_.commands.pop(stale)) {
    }
    if (!may_connect(now_ns)) return;
    const auto identity = device_.connect();
    note_connected(words({identity.maker, identity.model, identity.serial, identity.firmware}),
                   identity.sample_rate_hz);
    reference_epoch_ = identity.reference_epoch;
    taken_segment_ = 0;
    speed_mm_s_ = 0.0;
    begin_stop();  // whatever it was doing
    next_sync_ns_ = now_ns;
    has_best_ = false;
    report_health(now_ns, true);
  }
  if (const auto wanted = link_.stops_requested.load(std::memory_order_acquire); wanted != stop_request_) {
    stop_request_ = wanted;
    request_stop();
  }
  if (!left_ && leaving_.load(std::memory_order_acquire)) {
    left_ = true;
    request_stop();
  }
  stop_or_move(now_ns);
  if (!health_.connected) return;

  const auto poll = device_.poll(samples_);
  health_.lost += poll.lost;
  if (poll.has_exchange) take_exchange(poll.exchange);
  struct Tee {
    FrameService& self;
    void push(const Stamped<frame::Sample>& s) {
      self.link_.samples.push(s);
      // While a stop is not confirmed only what came after the frame took it says how it stands.
      if (self.stop_confirmed_ || self.stood_before_ ||
          (self.stop_accepted_ns_ >= 0 && s.mono_ns > self.stop_accepted_ns_)) {
        self.standstill_.add(s.mono_ns, double{s.sample.position_mm});
      }
    }
  } tee{*this};
  hand_over(std::span<const frame::Sample>(samples_).first(poll.samples), tee);
  judge_stop(poll.state);
  note_answer();

  // After the poll: a frame that does not answer gets no heartbeat either, and stops by itself. Nor does one that has
  // to stop: the request may have come while it was polled.
  const bool must_stop = !stop_confirmed_ || link_.stops_requested.load(std::memory_order_acquire) != stop_request_ ||
                         leaving_.load(std::memory_order_acquire);
  const std::uint32_t beat = link_.loop_beat.load(std::memory_order_acquire);
  if (!must_stop && now_ns >= next_heartbeat_ns_ && beat != last_beat_) {
    if (attempt(now_ns, "the heartbeat", [&] { device_.heartbeat(static_cast<std::uint16_t>(beat)); })) {
      last_beat_ = beat;
      next_heartbeat_ns_ = now_ns + config_.heartbeat_period_ns;
    }
  }
}

/// A stop that waits goes on waiting, with what was seen of it; one of a frame that stands has only to be taken.
void FrameService::request_stop() noexcept {
  if (!stop_confirmed_) return;
  if (told_to_move_ || !samples_stand_) return begin_stop();
  stop_confirmed_ = false;
  stop_accepted_ns_ = -1;
  stood_before_ = true;
}

void FrameService::begin_stop() noexcept {
  stop_confirmed_ = stood_before_ = false;
  stop_accepted_ns_ = -1;
  standstill_.restart(speed_mm_s_);
  stands_.store(false, std::memory_order_release);
}

void FrameService::stop_or_move(std::int64_t now_ns) {
  if (!stop_confirmed_) {
    const bool taken = attempt(now_ns, "the stop", [&] { device_.stop(); });
    if (taken && stop_accepted_ns_ < 0) stop_accepted_ns_ = clock_.now_ns();
    return;
  }
  // A stop overtakes what was commanded before it; of what came after it only the newest counts, since a segment that
  // runs is replaced.
  FrameCommand command;
  std::optional<FrameCommand> newest;
  while (link_.commands.pop(command)) {
    if (command.after_stop == stop_request_) newest = command;
  }
  if (!newest || left_) return;
  speed_mm_s_ = double{newest->segment.velocity_mm_s};
  told_to_move_ = true;
  if (attempt(now_ns, "the segment", [&] { device_.start_segment(newest->segment); })) {
    taken_segment_ = newest->number;
  } else {
    refused_segment_ = newest->number;
  }
}

void FrameService::judge_stop(const frame::State& state) noexcept {
  const bool moving = state.motion == frame::Motion::kMoving;
  // A fit over hundreds of samples: often while a stop waits for it, else often enough for windows of 60 ms and more.
  const std::int64_t now_ns = clock_.now_ns();
  if (!stop_confirmed_ || now_ns >= next_standstill_ns_) {
    samples_stand_ = standstill_.stands();
    next_standstill_ns_ = now_ns + kStandstillPeriodNs;
  }
  const bool stands = samples_stand_ && !moving;
  if (!stop_confirmed_ && stop_accepted_ns_ >= 0 && stands) {
    stop_confirmed_ = true;
    stood_before_ = told_to_move_ = false;
    speed_mm_s_ = 0.0;
  }
  stands_.store(left_ && stop_confirmed_, std::memory_order_release);
  FrameReport report;
  report.state = state;
  report.mono_ns = clock_.now_ns();
  report.stop_confirmed = stop_confirmed_;
  report.stop_request = stop_request_;
  report.stands = stands;
  report.velocity_mm_s = static_cast<float>(standstill_.velocity_mm_s());
  report.velocity_bound_mm_s = static_cast<float>(standstill_.bound_mm_s());
  report.position_mm = static_cast<float>(standstill_.position_mm());
  report.reference_epoch = reference_epoch_;
  report.reconnects = health_.reconnects;
  report.taken_segment = taken_segment_;
  report.refused_segment = refused_segment_;
  link_.reports.push(report);
}

void FrameService::take_exchange(const clock::Exchange& exchange) {
  const auto keep = [&](const clock::Exchange& e) {
    map_.add(e);
    link_.exchanges.push(e);
  };
  // One that contradicts is not weighed against others: the next tells whether the clock has stepped.
  if (clock_in_doubt() || !map_.agrees(exchange)) {
    keep(exchange);
    has_best_ = false;
    return;
  }
  if (burst_left_ > 0) {
    --burst_left_;
    keep(exchange);
    next_sync_ns_ = exchange.host_recv_ns + config_.sync_period_ns;
    return;
  }
  const auto round_trip = [](const clock::Exchange& e) { return e.host_recv_ns - e.host_send_ns; };
  if (!has_best_ || round_trip(exchange) < round_trip(best_)) best_ = exchange;
  has_best_ = true;
  if (exchange.host_recv_ns >= next_sync_ns_) {
    keep(best_);
    has_best_ = false;
    next_sync_ns_ = exchange.host_recv_ns + config_.sync_period_ns;
  }
}

void FrameService::drop(std::int64_t /*now_ns*/) noexcept {
  device_.disconnect();
}

bool FrameService::shut_down() noexcept {
  leave();
  const bool was_there = health_.identity[0] != '\0';
  if (health_.connected) {
    const std::int64_t until_ns = clock_.now_ns() + kLeaveNs;
    while (!stands() && clock_.now_ns() < until_ns) {
      run_once(clock_.now_ns());
      clock_.sleep_until_ns(clock_.now_ns() + config_.poll_period_ns);
    }
  }
  const bool stood = stands() || !was_there;
  device_.disconnect();
  health_.connected = false;
  return stood;
}

}  // namespace isorig::daemon
