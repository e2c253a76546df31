#pragma once
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "base/spsc_queue.hpp"
#include "daemon/recording/averages.hpp"

namespace isorig::daemon {

struct KeepOptions {
  std::int64_t average_interval_ns = 100'000'000;
  std::int64_t before_ns = 1'000'000'000;
  std::size_t max_held = 1U << 13U;  ///< samples of `before_ns`, at the highest rate
};

struct KeepCounts {
  std::uint64_t full = 0;
  std::uint64_t averaged = 0;
  std::uint64_t missing = 0;  ///< jumps of the device's sample counter
};

/// Decides for one stream what is written in full and what as averages.
///
/// An averaged sample first waits in a ring for `before_ns`. If a sample that is to be kept in full arrives,
/// the whole ring goes out in full before it: so a full stretch starts `before_ns` early, and the averages
/// end exactly where it starts, since a sample becomes part of an average only on leaving the ring. Every
/// sample is written once, in full or in one average. Intervals lie on a grid of absolute time and end
/// early where a step ends or a full stretch begins.
///
/// The 23 h of a campaign in virtual time pass through here, nearly all averaged: samples are popped from
/// the queue straight into the ring.
///
/// `Sink`: seen(record) for every one as it comes, full(record), average(interval), session_of(step), and a member
/// `session` that this class sets before the first sample of a session comes out.
template <typename Record, typename Average, typename Sink>
class KeepPolicy {
 public:
  KeepPolicy(const KeepOptions& options, Sink& sink)
      : options_(options), ring_(std::bit_ceil(options.max_held + 1)), mask_(ring_.size() - 1), sink_(sink) {}

  /// Takes every queued sample stamped before `end_ns`; the first one after it waits here for the next call.
  void take(base::SpscQueue<Record>& queue, std::int64_t end_ns) {
    while (waiting_ || queue.pop(ring_[head_ & mask_])) {
      waiting_ = true;
      if (ring_[head_ & mask_].mono_ns >= end_ns) return;
      waiting_ = false;
      accept();
    }
  }

  /// From here on until `mono_ns` everything is kept in full, whatever the samples say: the evidence round a
  /// stop. The ring goes out in full now: a stream that has died, which may be why there is a stop, brings no sample
  /// to push it out.
  void keep_full_until(std::int64_t mono_ns) {
    if (mono_ns <= full_until_ns_) return;
    full_until_ns_ = mono_ns;
    ring_in_full();
  }

  /// The ring becomes averages, the open interval closes: the end of a session or of the run.
  void finish() {
    // A popped sample that waits for its time stays where it is.
    for (; tail_ != head_; ++tail_) average(ring_[tail_ & mask_]);
    close_interval();
  }

  [[nodiscard]] bool has_more(const base::SpscQueue<Record>& queue) const noexcept {
    return waiting_ || queue.size() > 0;
  }
  [[nodiscard]] const KeepCounts& counts() const noexcept { return counts_; }
  /// True while the last sample was kept in full.
  [[nodiscard]] bool in_full() const noexcept { return in_full_; }

 private:
  void accept() {
    const Record& r = ring_[head_ & mask_];
    sink_.seen(r);
    if (have_last_) {
      // Modulo 2^32, as the counter wraps. A device that starts anew counts from 0: no jump forward.
      const std::uint32_t step = r.sequence - last_sequence_;
      if (step != 1 && step != 0 && step < 0x8000'0000U) counts_.missing += step - 1;
    }
    have_last_ = true;
    last_sequence_ = r.sequence;
    if (r.step != last_step_ || sink_.session < 0) {
      last_step_ = r.step;
      const auto session = sink_.session_of(r.step);
      if (session != sink_.session) {
        finish();  // nothing of the old session stays behind here
        sink_.session = session;
      }
    }
    if (r.keep == Keep::kFull || r.mono_ns <= full_until_ns_) {
      in_full_ = true;
      ++head_;
      ring_in_full();
      return;
    }
    in_full_ = false;
    const std::int64_t leave_ns = r.mono_ns - options_.before_ns;
    ++head_;
    // One slot stays free for the next pop.
    while (tail_ != head_ && (ring_[tail_ & mask_].mono_ns <= leave_ns || head_ - tail_ >= mask_)) {
      average(ring_[tail_ & mask_]);
      ++tail_;
    }
  }

  void ring_in_full() {
    if (tail_ == head_) return;
    if (open_) close_interval();
    for (; tail_ != head_; ++tail_) {
      ++counts_.full;
      sink_.full(ring_[tail_ & mask_]);
    }
  }

  void average(const Record& r) {
    ++counts_.averaged;
    if (open_ && r.mono_ns < interval_end_ns_ && r.step == interval_.core.step &&
        r.mono_ns >= interval_.core.first_mono_ns) {
      interval_.add(r);
      return;
    }
    close_interval();
    interval_.begin(r);
    open_ = true;
    const auto d = options_.average_interval_ns;
    const auto below = r.mono_ns >= 0 ? r.mono_ns / d : (r.mono_ns - d + 1) / d;
    interval_end_ns_ = (below + 1) * d;
  }

  void close_interval() {
    if (open_) sink_.average(interval_);
    open_ = false;
  }

  KeepOptions options_;
  std::vector<Record> ring_;
  std::size_t mask_;
  Sink& sink_;
  std::size_t head_ = 0;
  std::size_t tail_ = 0;
  bool waiting_ = false;
  bool in_full_ = false;
  bool open_ = false;
  bool have_last_ = false;
  std::uint32_t last_sequence_ = 0;
  std::uint32_t last_step_ = std::numeric_limits<std::uint32_t>::max();
  std::int64_t full_until_ns_ = std::numeric_limits<std::int64_t>::min();
  std::int64_t interval_end_ns_ = 0;
  Average interval_;
  KeepCounts counts_;
};

}  // namespace isorig::daemon
