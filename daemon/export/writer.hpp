#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "daemon/export/table.hpp"
#include "messages/recording.hpp"

namespace isorig::daemon {

enum class ExportFormat : std::uint8_t { kCsv, kHdf5, kMat };

/// What a file that holds a whole export calls itself.
inline constexpr const char* kExportFormat = "isorig-export/1";

/// Rows that a writer gets at once, at most. HDF5's chunks are of this size.
inline constexpr std::size_t kBlockRows = 16'384;

/// The streams of a session, in this order everywhere.
enum class Stream : std::uint8_t { kFrame, kPressure, kSetpoints };
inline constexpr std::size_t kStreams = 3;

/// What is known of a session before its first row is written.
struct SessionHead {
  std::string name;  ///< "rep-1_05-psi"
  std::array<TableSchema, kStreams> schema;
  std::array<std::size_t, kStreams> rows{};  ///< that will come
};

/// And when its last one has been.
struct SessionTail {
  messages::RecordingMetadata metadata;
  Attributes attributes;      ///< the same for formats that have attributes
  std::vector<Table> tables;  ///< sessions, steps, ramps, holds, events
};

/// One session at a time or several: each is opened, filled and finished. What was not finished leaves nothing behind.
/// Throws std::runtime_error (messages::RecordingError) when something cannot be written.
class SessionWriter {
 public:
  SessionWriter() = default;
  virtual ~SessionWriter() = default;
  SessionWriter(const SessionWriter&) = delete;
  SessionWriter& operator=(const SessionWriter&) = delete;
  virtual void rows(Stream stream, const Table& block) = 0;
  virtual void finish(const SessionTail& tail) = 0;
};

class ExportWriter {
 public:
  ExportWriter() = default;
  virtual ~ExportWriter() = default;
  ExportWriter(const ExportWriter&) = delete;
  ExportWriter& operator=(const ExportWriter&) = delete;
  virtual std::unique_ptr<SessionWriter> open(const SessionHead& head) = 0;
  /// The folder or file that a session of this name becomes; of a group FILE/GROUP, as h5ls takes it.
  [[nodiscard]] virtual std::filesystem::path path_of(const std::string& session) const = 0;
  /// Removes what an earlier export left of this session of this run under another name; not what says that it is of
  /// another session or run, or of none. Returns whether there was such a thing. After close().
  virtual bool drop(const std::string& name, const std::string& run, std::int32_t session) = 0;
  /// Everything is written. `texts`: the run's input files, by name.
  virtual void close(const Attributes& run, const Table& sessions,
                     const std::vector<std::pair<std::string, std::string>>& texts) = 0;
};

/// Does with `to` what it is asked to in threads of its own, a session in one of them: a failure is thrown by a later
/// call, at the latest by close(). HDF5 bears one thread.
std::unique_ptr<ExportWriter> make_background_writer(std::unique_ptr<ExportWriter> to, std::size_t threads);

/// CSV: a folder for each session in the recording format; `lean`: its three files and their own columns alone.
std::unique_ptr<ExportWriter> make_csv_writer(const std::filesystem::path& out, bool lean);
/// One file, `out`/`name`.h5, with a group for each session (docs/formats/hdf5.md).
std::unique_ptr<ExportWriter> make_hdf5_writer(const std::filesystem::path& out, const std::string& name);
/// A file for each session, `out`/rep-N_PP-psi.mat, of MATLAB's level 5 (docs/formats/mat.md).
std::unique_ptr<ExportWriter> make_mat_writer(const std::filesystem::path& out);

}  // namespace isorig::daemon
