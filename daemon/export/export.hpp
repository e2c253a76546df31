#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "daemon/export/writer.hpp"
#include "messages/run_log.hpp"

namespace isorig::daemon {

struct ExportOptions {
  ExportFormat format = ExportFormat::kCsv;
  /// CSV alone: only what the recording format fixes, for who goes on with nothing else.
  bool lean = false;
  /// Of a log that does not say what it is of (a logger's file of the live channels): recording.toml has to.
  std::string specimen{};
  double rest_length_mm = 0.0;
  /// What a note (amendments.hpp) says that the run is of, in place of what was recorded. Lengths that it does not say
  /// are not known: those of the other specimen would be wrong ones.
  struct Noted {
    std::string specimen;
    double rest_length_mm = 0.0;  ///< 0: not said
    std::function<double(double pressure_psi)> pressurized_rest_length_mm{};
  };
  std::optional<Noted> noted{};
  /// Maps device times to the host's clock again, from the recorded exchanges before and after each sample.
  bool remap = false;
  /// Provenance only: `run` in recording.toml.
  std::string run_id{};
  std::filesystem::path run_directory{};  ///< likewise
  /// What the catalogue says, where there is one.
  std::string operator_name{};
  std::string outcome{};
  bool still_written = false;  ///< a recorder writes it at this moment
  /// Told now and then which part of the work is done: the log is read twice, one of the live channels thrice.
  std::function<void(double fraction)> on_progress{};
};

/// One repetition at one pressure.
struct ExportedSession {
  std::filesystem::path folder;  ///< in the recording format; of MAT the file, of HDF5 FILE/GROUP
  std::string name;              ///< "rep-1_05-psi"
  std::int32_t session = 0;
  std::int32_t attempt = 0;
  std::int32_t repetition = 0;
  double pressure_psi = 0.0;
  bool complete = false;
  std::size_t frame_rows = 0;
  std::size_t pressure_rows = 0;
  std::size_t not_measured = 0;    ///< pressure samples left out: stale or faulty words, intervals without any
  std::size_t not_increasing = 0;  ///< rows put 2 ns behind the row before, whose time they had
  double remap_rms_us = 0.0;       ///< how far remapping moved the stamps of both streams, rms
  std::size_t kept_online = 0;     ///< rows that remapping left as they were: it would not have been better
  std::size_t clock_breaks = 0;    ///< that remapping found: a device's clock began anew or stepped
  /// What an earlier export had left of the session under other names, and is gone now.
  std::vector<std::filesystem::path> replaces{};
};

/// A session that has readings of the pressure, and not one of the frame in any attempt: no file says what it did.
struct SkippedSession {
  std::string name;  ///< that it would have had
  std::int32_t session = 0;
  std::size_t pressure_rows = 0;  ///< of the attempt that has most
  std::string why;                ///< a sentence with the name
};

struct ExportReport {
  messages::ReadReport read;
  std::vector<ExportedSession> sessions;
  std::vector<SkippedSession> skipped;
};

/// Writes each session of a run that has samples of the frame: to `out`/rep-N_PP-psi, `out`/RUN.h5 or
/// `out`/RUN/rep-N_PP-psi.mat. Seconds count from the session's first sample, of whichever stream. Full-rate samples
/// are rows as they are; an averaged interval is one row, its mean at the middle of its time. Of a session that was
/// recorded in several attempts the last counts, unless only an earlier one is complete. What is altered or cut is left
/// out; every session says in which state the recording was. A log without a header (the live channels, as a logger
/// wrote them) is taken apart by its events `session.start` and `session.end`.
///
/// Read twice: first what there is, then row by row. Memory does not grow with the run, but with `remap` it does with
/// the longest session.
ExportReport export_run(const std::filesystem::path& run_dir, const std::filesystem::path& out,
                        const ExportOptions& options);

}  // namespace isorig::daemon
