#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "messages/run_log.hpp"

namespace isorig::daemon {

/// What a recording says about its run, counted while it is read once. `isorig show` prints it; a run's page adds the
/// signals over time (cli/runs/run_evidence.hpp).
///
/// Times are rig time: the clock of the first attempt, and each further attempt laid to the end of the one before. Its
/// own clock may be of another boot, hours away to either side, and what passes until somebody resumes is no time of
/// the rig's.
struct RunTally : messages::RunVisitor {
  struct Stream {
    std::uint64_t full = 0;       ///< samples recorded each by itself
    std::uint64_t averaged = 0;   ///< samples that went into averages
    std::uint64_t intervals = 0;  ///< averages
    double worst_bound_us = 0.0;  ///< by which the time of any of them may be wrong
  };
  /// Samples that never came from the device, and records that the loop could not hand to the recorder.
  struct Losses {
    std::int64_t frame = 0, pressure = 0, dropped = 0;
  };
  /// A repetition of a session from its begin mark to its end mark.
  struct Repetition {
    isorig_msgs::session_mark_t begin;
    bool ended = false;       ///< there is an end mark
    std::int64_t end_ns = 0;  ///< of that mark
    bool complete = false;
    std::int64_t frame_missing = 0, pressure_missing = 0;  ///< within it

    [[nodiscard]] const char* state_text() const noexcept;
  };

  void header(const isorig_msgs::run_header_t& h) override;
  void session(const isorig_msgs::session_mark_t& m) override;
  void frame(const isorig_msgs::frame_batch_t& m) override;
  void pressure(const isorig_msgs::pressure_batch_t& m) override;
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override;
  void pressure_average(const isorig_msgs::pressure_average_batch_t& m) override;
  void control(const isorig_msgs::control_batch_t& m) override;
  void event(const isorig_msgs::event_t& m) override;
  void exchanges(const isorig_msgs::exchange_batch_t& m) override;

  /// An input file as it was recorded; empty when there is none of that name.
  [[nodiscard]] std::string text(std::string_view name) const;
  [[nodiscard]] Losses losses() const;  ///< of all attempts
  [[nodiscard]] std::vector<Repetition> repetitions() const;

  isorig_msgs::run_header_t last_header{};
  std::int64_t first_epoch_unix_us = 0;            ///< of the first attempt's clock
  std::vector<isorig_msgs::session_mark_t> marks;  ///< begins and ends
  std::vector<isorig_msgs::event_t> events;
  std::vector<std::int64_t> mark_shift_ns, event_shift_ns;  ///< rig time less the recorded mono_ns, of each
  std::map<std::int32_t, isorig_msgs::session_mark_t>
      lost;  ///< by attempt: its last end mark, which counts what is missing
  std::int64_t first_sample_ns = 0, last_sample_ns = 0;
  Stream frames, pressures;
  std::uint64_t exchange_count = 0;
  std::int64_t overruns = 0;  ///< within the run: the loop counts since the daemon began
  /// The controller's samples hold 2.1 s at most; how late a later one came stands in its `loop.late`.
  std::int64_t worst_wakeup_ns = 0;
  std::int32_t worst_run_ns = 0;

 protected:
  /// Rig time of a recorded one.
  [[nodiscard]] std::int64_t rig_ns(std::int64_t mono_ns);

 private:
  void samples_span(std::int64_t from_ns, std::int64_t to_ns);
  template <typename Message>
  void count_full(Stream& stream, const Message& m);
  template <typename Message>
  void count_averages(Stream& stream, const Message& m);
  bool has_samples_ = false;
  bool has_header_ = false, begins_attempt_ = false;
  std::int64_t shift_ns_ = 0, latest_ns_ = 0;
  bool has_overruns_ = false;
  std::int64_t overruns_before_ = 0, overruns_of_attempts_ = 0;
};

}  // namespace isorig::daemon
