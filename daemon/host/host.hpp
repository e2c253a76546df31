#pragma once
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calibration/store.hpp"
#include "daemon/core/core.hpp"
#include "daemon/core/live_window.hpp"
#include "daemon/host/diagnoses.hpp"
#include "daemon/host/event_history.hpp"
#include "daemon/host/storage_watch.hpp"
#include "daemon/host/verb_desk.hpp"
#include "daemon/recording/catalogue.hpp"
#include "daemon/recording/recorder.hpp"
#include "daemon/recording/trip_evidence.hpp"
#include "daemon/rig/config.hpp"
#include "daemon/rig/rig_acceptance.hpp"
#include "protocol/plan.hpp"

namespace isorig::daemon {

struct StartOptions {
  std::string protocol_text;
  std::string protocol_name = "protocol.toml";
  std::string specimen_text;  ///< empty: the rig's own
  std::string specimen_name;
  std::string operator_name;
  std::string resume_run;         ///< go on with this run from its first repetition that is not done
  bool resume_aborted = false;    ///< although an operator had ended it
  bool on_another_rig = false;    ///< although it was recorded on another rig
  bool another_specimen = false;  ///< although another specimen is mounted than it was recorded of
};

/// What an operator puts right about a run afterwards; empty: not touched.
struct Correction {
  std::string run;
  std::string by;
  std::string operator_name;
  std::string specimen_text;  ///< a whole specimen file
  std::string specimen_name;  ///< how messages call that file
  std::string text;
};

/// What a client that steps a model beside the rig has found.
struct Parting {
  std::string run;
  std::string text;
  std::string then;  ///< what the client does about it: mark, pause or abort
};

/// What surrounds the core and may take its time: compiles protocols, opens and closes runs, feeds the recorder and
/// the catalogue, answers the API. Its members may be called from any thread but the loop's.
///
/// Three locks, always taken in this order: `start_mutex_` (a run is opened; seconds), Run::recording (the recorder and
/// the catalogue of a run; as long as the disk takes), `mutex_` (what is shown; microseconds: never held over disk,
/// catalogue, log or a wait). Verbs, status and events need the last one only.
class Host {
 public:
  struct Options {
    std::filesystem::path runs_root;
    /// Where diagnoses are looked for, beside those among the runs.
    std::vector<std::filesystem::path> diagnoses;
    bool virtual_time = false;
    /// Unix time at mono_ns = 0, asked when a run is opened: a clock that was set meanwhile dates the next run.
    std::function<std::int64_t()> epoch_unix_us = [] { return std::int64_t{0}; };
    std::int64_t seed = 0;
    std::string revision;  ///< of the source this was built from
    /// Free bytes where a run is recorded; statvfs unless a test says otherwise.
    std::function<std::uint64_t(const std::filesystem::path&)> free_bytes;
    /// Waits for the loop's answer to a verb; the virtual runner lets the rig tick here. Whoever sets it has one
    /// thread.
    std::function<void()> breathe;
    /// Every event of the core as it is taken, for a log; a flood of one kind comes as one.
    std::function<void(const EventRecord&)> on_event;
    /// The live twin of a client and the muscle part in the open run: run, words, and what the client does about it.
    std::function<void(const std::string&, const std::string&, const std::string&)> on_parted;
    /// Trouble with a recording or the catalogue, for a log.
    std::function<void(const std::string&)> on_trouble;
    /// A run's folder when its end is on the disk and in the catalogue. Called under locks of ours: returns at once.
    std::function<void(const std::filesystem::path&)> on_closed;
  };
  struct Result {
    bool ok = false;
    std::string text;
    std::string run;
  };

  /// A run that a fault has ended is recorded for so long after it: the evidence's time, and a second in which its last
  /// samples arrive (a poll, the recorder's lag and a slice of it, a turn of ours: below 0.5 s).
  static constexpr std::int64_t kAfterFaultNs = TripEvidence::kAfterNs + 1'000'000'000;
  static_assert(kAfterFaultNs < Core::kRecordedAfterNs);

  Host(const RigConfig& rig, Core& core, Streams& recording, Options options);
  ~Host();

  /// Compiles, checks against the limits, opens the run and starts it. Throws base::ConfigError when protocol or
  /// specimen are wrong, std::runtime_error when the run cannot be opened; nothing has moved then. One at a time:
  /// another one waits, and is refused when the first has begun.
  /// On a rig that has to be armed nothing is opened yet, and nothing written: that is what go() does.
  Result start(const StartOptions& options);
  /// From now on: the process is ending.
  void refuse_starts() noexcept { ending_ = true; }
  /// What `start` would do, without doing it: specimen, rig, duration at worst, warnings. Throws as start() does.
  [[nodiscard]] nlohmann::json preview(const StartOptions& options);
  /// The second act: the armed run is opened, or the paused one goes on, after a countdown.
  /// `by`: who asks, for the events.
  Result go(const std::string& by = {});
  /// The rig file's limits are as they should be, says this operator.
  Result accept_rig(const std::string& operator_name, uid_t uid);
  /// What has changed in the rig file since it was accepted, for a log; empty when nothing has.
  [[nodiscard]] std::string rig_changes() const;
  /// Puts right what is known of a run: {run, by, operator, specimen (TOML text), text}. The recording stays as it was.
  Result amend(const Correction& correction);
  /// A client's twin parts from the muscle in the open run: whoever is to be told is told. Waits for nothing.
  Result parted(const Parting& parting);
  /// Waits for the loop's answer, 2 s at most.
  Result verb(Request::Verb verb);
  /// The same for a thread that may not wait: the number to ask with, 0 when the loop takes no requests.
  [[nodiscard]] std::uint32_t submit(Request::Verb verb);
  [[nodiscard]] std::uint32_t submit(const Request& request);
  [[nodiscard]] std::optional<Result> answer_to(std::uint32_t number);
  /// Waits no longer: what has not begun by now does not begin, what only stops is done all the same. An answer that
  /// has just come counts.
  [[nodiscard]] Result without_answer(std::uint32_t number, Request::Verb verb);

  /// The recorder thread's turn: drains the queues, follows the events, closes a run that has ended. Never throws: what
  /// disk or catalogue refuse is a program stop, and is tried again in the next turn.
  void turn(std::int64_t now_ns) noexcept;
  /// On the way out: what is queued is written, a run that is still open is marked interrupted. Tries again until
  /// `give_up` says so; false when something could not be written.
  bool shut_down(const std::function<bool()>& give_up = {});

  [[nodiscard]] bool run_open() const;
  /// The disk of the runs is written to, whether it was found to hang or not. False when that takes more than a second.
  [[nodiscard]] bool disk_answers(std::int64_t now_ns);
  /// No run is open, armed or about to be, and the rig is not being set up.
  [[nodiscard]] bool is_between_runs() const;
  [[nodiscard]] std::string run_id() const;
  /// What the open run takes from where it began when each of its steps takes its longest; 0 if none is open.
  [[nodiscard]] double longest_s() const;
  /// Of the last run that was closed: done, aborted, failed, interrupted.
  [[nodiscard]] std::string last_outcome() const;
  [[nodiscard]] std::filesystem::path run_directory() const;
  /// What went wrong in the last run, in words; empty when nothing did.
  [[nodiscard]] std::string last_fault() const;
  [[nodiscard]] RecorderStatus recorder_status() const;

  [[nodiscard]] nlohmann::json status_json() const;
  [[nodiscard]] nlohmann::json events_json(std::uint64_t after) const;
  /// The limits, and of an open run every step with its expected start and duration.
  [[nodiscard]] nlohmann::json plan_json() const;

  /// For calibration and self-test (host_calibration.cpp). Averages over the last `window_s`, whatever the rig does.
  [[nodiscard]] nlohmann::json readings_json(double window_s) const;
  /// What is in force, and every record there is.
  [[nodiscard]] nlohmann::json calibrations_json() const;
  /// What a self-test cannot see from outside: devices, limits, real-time properties, disk.
  [[nodiscard]] nlohmann::json selftest_json() const;
  /// host_runs.cpp: the newest runs with what was noted at them, and a run's own page. Both read the disk; the second
  /// throws std::runtime_error when there is no such run or page.
  [[nodiscard]] nlohmann::json runs_json() const;
  [[nodiscard]] nlohmann::json report_json(const std::string& id) const;
  /// host_check.cpp: what a protocol would do within this rig's limits, with every step as columns. Throws
  /// base::ConfigError with everything that is wrong in it.
  [[nodiscard]] nlohmann::json check_json(const std::string& protocol_text, const std::string& protocol_name) const;
  /// Those among the runs and in Options::diagnoses.
  [[nodiscard]] const Diagnoses& diagnoses() const noexcept { return diagnoses_; }
  /// Keeps a record and puts it in force at once. When the loop does not take it, it is put in force before the next
  /// run starts. Throws base::ConfigError when the record is wrong.
  Result add_calibration(const std::string& record_toml);
  /// Calibrations whose date is over, a line each.
  [[nodiscard]] std::vector<std::string> overdue() const;

 private:
  struct Run;
  struct Prepared;

  Result ask(Request request);
  void breathe() const;
  void trouble(const std::string& text) const;

  /// host_runs.cpp: a folder of the catalogue that is a link leads out of the runs' folder. "" or what to do.
  [[nodiscard]] static std::string why_not_a_folder(const RunRow& run);

  /// host_start.cpp
  Result await_closed_run();
  std::optional<Result> prepare(const StartOptions& options, Prepared& prepared);
  std::optional<Result> take_saved_run(const StartOptions& options, Prepared& prepared);
  void reserve_folder(Prepared& prepared);
  void describe_run(const Status& now, Prepared& prepared);
  Result begin(const Status& now, Prepared& prepared, Request::Verb verb);
  Result put_in_force();
  void note_rig_changes();
  [[nodiscard]] static std::string outcome_text(const Run& run, Outcome outcome);

  void turn_or_throw(std::int64_t now_ns);
  std::shared_ptr<Run> take_events();
  void drop_queued();
  void look_at_storage(std::int64_t now_ns, bool run_open);
  void tell_core_of_storage(const std::string& why);
  void tell_core(const std::string& recorder_fault);
  void close_when_over(Run& run, std::int64_t now_ns);
  bool close_run(Run& run, const std::string& outcome, bool complete, std::int64_t now_ns);
  [[nodiscard]] std::string calibration_text() const;
  [[nodiscard]] std::vector<std::pair<std::string, std::string>> provenance(const std::string& operator_name,
                                                                            const Status& now) const;

  const RigConfig& rig_;
  Core& core_;
  Streams& recording_;
  Options options_;
  Catalogue catalogue_;  // has a lock of its own, and waits for the disk
  const Diagnoses diagnoses_;
  VerbDesk desk_;

  std::atomic<bool> ending_{false};
  std::mutex start_mutex_;                                   // one run, or one calibration, at a time
  std::vector<std::shared_ptr<const protocol::Plan>> lent_;  // guarded by it: what the loop may look at

  std::unique_ptr<Prepared> armed_;  // guarded by it: what go() opens

  std::int64_t next_storage_look_ns_ = 0;  // the recorder thread's, as is what it told the loop last
  std::string storage_told_;
  std::optional<StorageWatch> storage_;  // none in virtual time

  std::mutex tell_mutex_;  // the core's queue of recorder faults has one producer
  std::string told_;       // guarded by it

  mutable std::mutex mutex_;  // guards all below
  std::shared_ptr<Run> run_;
  std::string finished_id_;
  std::filesystem::path finished_directory_;
  std::int64_t finished_epoch_unix_us_ = 0;
  std::string last_outcome_;
  std::string last_fault_;
  RecorderStatus recorder_status_;
  EventHistory events_;
  std::optional<RigAcceptance> acceptance_;    // none in virtual time
  calibration::Store records_;                 ///< those in force
  std::optional<calibration::Store> waiting_;  ///< ... and those that are kept, when the loop has not taken them yet
  LiveStreams live_;
  LiveWindow window_;
};

}  // namespace isorig::daemon
