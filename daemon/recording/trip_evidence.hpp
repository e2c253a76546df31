#pragma once
#include <cstdint>
#include <deque>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "daemon/core/records.hpp"

namespace isorig::daemon {

/// What a trip of a run is kept with, apart from the recording: every sample from `kBeforeNs` before it to `kAfterNs`
/// after it, whatever the keep policy makes of them, and the chain of events, in RUN/trip-N.json and
/// RUN/trip-N-{frame,pressure,control}.csv. `isorig show` tells it as a story.
///
/// A trip is a transition to *faulted*. The files are written when its time is over, or the run, one with each call of
/// advance(): the recorder is judged by how often it comes round, and each file waits for the disk. What follows later
/// (reset, resume, abort) is added to the JSON, until the rig runs or is at rest again. The recording stays the record:
/// this is a copy for people and for a quick look, made from the same records in the same thread.
class TripEvidence {
 public:
  static constexpr std::int64_t kBeforeNs = 10'000'000'000;
  static constexpr std::int64_t kAfterNs = 5'000'000'000;
  static constexpr int kMostTrips = 99;  ///< of a run; later ones are in the recording alone

  /// `step_words`: what each step of the plan does, for the story; may be empty. `epoch_unix_us`: Unix time at
  /// mono_ns = 0, for when somebody did something; 0: not known.
  TripEvidence(std::filesystem::path run_dir, std::vector<std::string> step_words, std::int64_t epoch_unix_us = 0);

  void take(const FrameRecord& record);
  void take(const PressureRecord& record);
  void take(const ControlRecord& record);
  void take(const EventRecord& record);
  /// Every record stamped before `mono_ns` was taken. Writes one file at most. `has_room`: the disk takes the samples
  /// too, which the recording holds in any case; else the JSON alone is written, and error() says so.
  void advance(std::int64_t mono_ns, bool has_room);
  /// There will be no more: all that is left is written.
  void finish(bool has_room);
  /// finish() has something to write.
  [[nodiscard]] bool is_owed() const noexcept;

  /// Why the last evidence could not be written; empty when it was. Never a reason to stop: the recording has it all.
  [[nodiscard]] const std::string& error() const noexcept { return error_; }

 private:
  /// In the order in which they are written. The story is the last: who finds it finds the others.
  enum class File : std::uint8_t { kFrame, kPressure, kControl, kStory, kNone };

  struct Trip {
    int number = 0;
    EventRecord cause;
    RunState before = RunState::kIdle;
    std::int64_t end_ns = 0;  ///< of its samples: kAfterNs after it, or where the next trip begins
    std::int64_t goes_on_ns = std::numeric_limits<std::int64_t>::max();  ///< the run moves again, and reacts no more
    std::optional<ControlRecord> at;                                     ///< the last control record before it
    std::vector<EventRecord> chain;
    nlohmann::ordered_json reaction;  ///< what the plant did, once its time is over
    File next = File::kFrame;
    std::vector<std::string> files;  ///< of samples, that were written
    bool is_over = false;            ///< the rig runs or is at rest again
    bool is_stale = false;           ///< the chain has more than the story that was written
  };

  void write_next(Trip& trip, bool has_room);
  void write_samples(Trip& trip);
  void write_story(const Trip& trip);
  bool write_file(const std::string& name, const std::string& text);
  [[nodiscard]] std::string frame_csv(const Trip& trip) const;
  [[nodiscard]] std::string pressure_csv(const Trip& trip) const;
  [[nodiscard]] std::string control_csv(const Trip& trip) const;
  /// From `number` on, as far as the folder can be looked into: one that is away, or a disk that does not answer, seems
  /// to hold nothing.
  [[nodiscard]] int first_free(int number) const;
  /// The first moment of which samples are still needed, at `now_ns`.
  [[nodiscard]] std::int64_t kept_from(std::int64_t now_ns) const noexcept;

  /// Samples beyond what has to be kept; which files they go into is decided by their stamps.
  static constexpr std::uint32_t kTrimEvery = 64;

  std::filesystem::path run_dir_;
  std::vector<std::string> step_words_;
  std::int64_t epoch_unix_us_;
  std::deque<FrameRecord> frame_;
  std::deque<PressureRecord> pressure_;
  std::uint32_t frames_taken_ = 0, pressures_taken_ = 0;
  std::deque<ControlRecord> control_;
  std::deque<EventRecord> events_;
  std::deque<Trip> trips_;  ///< the last may still be added to; those before it have to be written, no more
  int number_ = 0;  ///< of the newest trip of the run; those of attempts before this one were looked at as it began
  std::string error_;
};

/// What came after the run was closed: the reset of a fault that had ended it. For the daemon that wrote the evidence,
/// whose time still runs. Nothing when the run had no trip, or when its last one has ended already. Throws
/// std::runtime_error when it cannot be written.
void append_to_last_trip(const std::filesystem::path& run_dir, const EventRecord& event,
                         std::int64_t epoch_unix_us = 0);

}  // namespace isorig::daemon
