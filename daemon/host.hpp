#pragma once
#include <cstdint>
#include <deque>
#include <filesystem>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "calibration/store.hpp"
#include "daemon/catalogue.hpp"
#include "daemon/config.hpp"
#include "daemon/core.hpp"
#include "daemon/live_window.hpp"
#include "daemon/recorder.hpp"
#include "protocol/plan.hpp"

namespace isorig::daemon {

struct StartOptions {
  std::string protocol_text;
  std::string protocol_name = "protocol.toml";
  std::string specimen_text;     ///< empty: the rig's own
  std::string specimen_name;
  std::string operator_name;
  std::string resume_run;        ///< go on with this run from its first repetition that is not done
};

/// What surrounds the core and may take its time: compiles protocols, opens and closes runs, feeds the recorder and
/// the catalogue, answers the API. Its members may be called from any thread but the loop's.
class Host {
 public:
  struct Options {
    std::filesystem::path runs_root;
    bool virtual_time = false;
    std::int64_t epoch_unix_us = 0;     ///< Unix time at mono_ns = 0
    std::int64_t seed = 0;
    /// Waits for the loop's answer to a verb; the virtual runner lets the rig tick here.
    std::function<void()> breathe;
    /// Every event of the core as it is taken, for a log.
    std::function<void(const EventRecord&)> on_event;
  };
  struct Result {
    bool ok = false;
    std::string text;
    std::string run;
  };

  Host(const RigConfig& rig, Core& core, Streams& recording, Options options);
  ~Host();

  /// Compiles, checks against the limits, opens the run and starts it. Throws base::ConfigError when protocol or
  /// specimen are wrong, std::runtime_error when the run cannot be opened; nothing has moved then.
  Result start(const StartOptions& options);
  Result verb(Request::Verb verb);

  /// The recorder thread's turn: drains the queues, follows the events, closes a run that has ended.
  void turn(std::int64_t now_ns);
  /// On the way out: what is queued is written, an open run is marked interrupted.
  void shut_down();

  [[nodiscard]] bool run_open() const;
  [[nodiscard]] std::string run_id() const;
  /// Of the last run that was closed: done, aborted, failed, interrupted.
  [[nodiscard]] std::string last_outcome() const;
  [[nodiscard]] std::filesystem::path run_directory() const;
  /// What went wrong in the last run, in words; empty when nothing did.
  [[nodiscard]] std::string last_fault() const;
  [[nodiscard]] RecorderStatus recorder_status() const;

  [[nodiscard]] nlohmann::json status_json() const;
  [[nodiscard]] nlohmann::json events_json(std::uint64_t after) const;

  /// For calibration and self-test (host_bench.cpp). Averages over the last `window_s`, whatever the rig does.
  [[nodiscard]] nlohmann::json readings_json(double window_s) const;
  /// What is in force, and every record there is.
  [[nodiscard]] nlohmann::json calibrations_json() const;
  /// What a self-test cannot see from outside: devices, limits, real-time properties, disk.
  [[nodiscard]] nlohmann::json selftest_json() const;
  /// Keeps a record and puts it in force at once. Throws base::ConfigError when the record is wrong.
  Result add_calibration(const std::string& record_toml);
  /// Calibrations whose date is over, a line each.
  [[nodiscard]] std::vector<std::string> overdue() const;

 private:
  struct Run;

  Result post(Request request);
  void take_events();
  void close_run(const std::string& outcome, bool complete);
  void watch_disk();
  [[nodiscard]] std::string calibration_text() const;

  const RigConfig& rig_;
  Core& core_;
  Streams& recording_;
  Options options_;
  Catalogue catalogue_;

  mutable std::mutex mutex_;            // guards all below
  std::mutex verb_mutex_;               // one verb at a time: the request queue has one producer
  std::uint32_t next_request_ = 1;
  std::unique_ptr<Run> run_;
  std::unique_ptr<Run> finished_;       // the plan of the last run: the core may look at it until the next start
  std::vector<std::unique_ptr<Run>> refused_;  // few; the loop may have taken one up after we gave up waiting
  std::int64_t closing_since_ns_ = -1;
  std::string last_outcome_;
  std::string last_fault_;
  RecorderStatus last_recorder_;
  struct Event {
    std::uint64_t number = 0;
    EventRecord record;
  };
  std::deque<Event> events_;
  std::uint64_t next_event_ = 1;
  DiskCondition disk_ = DiskCondition::kOk;
  calibration::Store records_;
  LiveStreams live_;
  LiveWindow window_;
};

}  // namespace isorig::daemon
