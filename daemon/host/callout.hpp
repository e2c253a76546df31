#pragma once
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "daemon/core/records.hpp"
#include "daemon/core/status.hpp"
#include "daemon/rig/notify_config.hpp"

namespace isorig::daemon {

/// Calls somebody who is not there: runs the command of [notify] when a run is done, paused, aborted, faulted, held for
/// long or overdue, or when the live twin parts from the muscle (docs/config.md). What to say is queued, and a thread
/// that does nothing else starts the command and waits for it: a command that hangs, or cannot be started, holds up
/// nobody and nothing.
class Callout {
 public:
  /// What went wrong with a call, a line each.
  using Log = std::function<void(const std::string&)>;

  Callout(NotifyConfig config, Log log) : config_(std::move(config)), log_(std::move(log)) {}

  /// The event's name for the command, if it is one to call about: done, paused, aborted, faulted, held.
  [[nodiscard]] static std::optional<std::string> name_of(const EventRecord& event);

  /// Any thread; queues.
  void on_event(const EventRecord& event, const std::string& run);
  /// Now and then, from one thread: tells when a run is held for long, and once when it takes longer than it can.
  /// `longest_s`: what the open run takes when each of its steps takes its longest; 0 if none is open.
  void watch(const Status& status, const std::string& run, double longest_s);
  /// Any thread; queues. `then`: what whoever watches the twin does about it: "pause", "abort", or nothing.
  void on_parted(const std::string& run, const std::string& text, const std::string& then, RunState state);

  /// Beyond its longest a run is overdue after a tenth of it, or this: a plan knows the longest of what waits, and of
  /// what moves only what the frame was asked for, not its round trips at each turning point.
  static constexpr double kOverdueShare = 0.1;
  static constexpr double kOverdueLeast_s = 60.0;

  /// The thread: calls until stop(). What is queued then is still called, for `stop_patience` in all.
  void run();
  void stop();

 private:
  struct Call {
    std::string event, run, text, state;
  };
  static constexpr std::size_t kQueued = 16;
  static constexpr auto kStopPatience = std::chrono::seconds(5);
  /// isorig-web pauses or aborts within a second of telling of a parting: what comes later has another cause.
  static constexpr auto kPartingActs = std::chrono::seconds(10);

  void watch_held(const Status& status, const std::string& run);
  void watch_duration(const Status& status, const std::string& run, double longest_s);
  [[nodiscard]] std::string cause_of(const std::string& name, const std::string& run);
  void queue(Call call);
  void call(const Call& call);
  [[nodiscard]] bool wait_for(int pid, std::chrono::steady_clock::time_point deadline, int& status);
  void note(const std::string& text) const {
    if (log_) log_(text);
  }

  const NotifyConfig config_;
  const Log log_;
  std::mutex mutex_;
  std::condition_variable more_;
  std::deque<Call> calls_;                                                                        // guarded by mutex_
  std::size_t dropped_ = 0;                                                                       // guarded by mutex_
  bool stopping_ = false;                                                                         // guarded by mutex_
  std::chrono::steady_clock::time_point give_up_ = std::chrono::steady_clock::time_point::max();  // guarded by mutex_

  struct Parting {
    std::string run, then, text;
    std::chrono::steady_clock::time_point at;
  };
  Parting parting_;  // guarded by mutex_

  std::int64_t held_since_ns_ = -1;  // of watch()'s thread, as what follows
  bool held_told_ = false;
  std::int64_t began_ns_ = -1;  // when the open run was first seen running
  std::uint64_t run_number_ = 0;
  bool overdue_told_ = false;
};

}  // namespace isorig::daemon
