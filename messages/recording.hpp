#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace isorig::messages {

/// The recording format "isorig-recording/1": one folder with `recording.toml`, `frame.csv` and, when the rig
/// has a pneumatic part, `pressure.csv`. Both CSV files stamp with seconds on one clock; neither is sampled
/// uniformly, and their rates differ.

/// What is wrong with a recording. `kTruncated`: the last line was cut off, so the writer was interrupted.
enum class RecordingFault {
  kMissingFile,
  kUnreadable,
  kMetadata,  ///< recording.toml: not TOML, a key missing, of the wrong type or out of range
  kFormat,    ///< `format` names something else
  kHeader,    ///< a column is missing or has another name
  kEmpty,     ///< no rows
  kColumns,   ///< a row with too few or too many cells, or an empty line
  kNotNumber,
  kNotFinite,  ///< NaN, infinity, or beyond the range of a double
  kRange,      ///< beyond what any machine records (messages/csv.hpp)
  kUnits,      ///< a unit is in doubt, and recording.toml does not state it
  kTime,       ///< time runs backwards, stands still, creeps or leaps
  kTruncated,
  kInconsistent,  ///< write_recording: what was to be written could not be read back
};

/// what() is "file:line: message", or "file: message" for a fault of the whole file (line 0).
class RecordingError : public std::runtime_error {
 public:
  RecordingError(RecordingFault fault, std::filesystem::path file, std::size_t line, const std::string& message);
  [[nodiscard]] RecordingFault fault() const noexcept { return fault_; }
  [[nodiscard]] const std::filesystem::path& file() const noexcept { return file_; }
  [[nodiscard]] std::size_t line() const noexcept { return line_; }

 private:
  RecordingFault fault_;
  std::filesystem::path file_;
  std::size_t line_;
};

inline constexpr std::string_view kRecordingFormat = "isorig-recording/1";
/// What `units` may say in recording.toml: that somebody looked.
inline constexpr std::string_view kRecordingUnits = "s, mm, N, psi";

/// Which column a model is to answer with.
enum class Output { kForce, kPosition, kPressure };
[[nodiscard]] std::string_view name_of(Output output);

struct RecordingMetadata {
  std::string specimen;
  /// Unpressurized; zero of `position_mm`. Without it there is no strain: force and position can be judged, and
  /// nothing that is counted from a length.
  std::optional<double> rest_length_mm;
  /// Only a McKibben has these two; the length needs `rest_length_mm` beside it.
  std::optional<double> pressurized_rest_length_mm;
  std::optional<double> nominal_pressure_psi;
  /// All other keys and tables of recording.toml, verbatim with their comments.
  std::string further_toml;
  Output output = Output::kForce;
  /// `units` is there: the columns are what their names say, however odd the numbers look.
  bool units_stated = false;

  /// The length that strain is counted from: pressurized if there is one, else the rest length; NaN without either.
  [[nodiscard]] double reference_length_mm() const noexcept {
    return pressurized_rest_length_mm.value_or(rest_length_mm.value_or(std::numeric_limits<double>::quiet_NaN()));
  }
  /// What a pressurized specimen is stretched by at position 0; 0 where a length is not stated.
  [[nodiscard]] double elongation_at_zero_mm() const noexcept {
    return rest_length_mm ? *rest_length_mm - reference_length_mm() : 0.0;
  }
  /// Strain as in the paper: (position + rest - pressurized rest) / pressurized rest. Zero at the length the
  /// pressurized specimen has without load; without a pressurized length it is position / rest length; NaN without any.
  [[nodiscard]] double strain(double position_mm) const noexcept {
    return (position_mm + elongation_at_zero_mm()) / reference_length_mm();
  }
  [[nodiscard]] double position_mm(double strain) const noexcept {
    return strain * reference_length_mm() - elongation_at_zero_mm();
  }
};

/// Vectors of equal length; `t_s` strictly increasing, everything finite.
struct FrameSamples {
  std::vector<double> t_s;
  std::vector<double> position_mm;  ///< crosshead, relative to the unpressurized rest length; extension positive
  std::vector<double> force_N;      ///< tension positive
  [[nodiscard]] std::size_t size() const noexcept { return t_s.size(); }
};

struct PressureSamples {
  std::vector<double> t_s;
  std::vector<double> pressure_psi;  ///< gauge
  [[nodiscard]] std::size_t size() const noexcept { return t_s.size(); }
};

struct Recording {
  RecordingMetadata metadata;
  FrameSamples frame;
  std::optional<PressureSamples> pressure;

  [[nodiscard]] double strain(double position_mm) const noexcept { return metadata.strain(position_mm); }
  [[nodiscard]] std::vector<double> strain() const;  ///< of every row of `frame`
};

/// What makes it doubtful that lengths are in millimetres: a specimen shorter than one, a stroke of a few hundred-
/// thousandths of the specimen's length (metres read as millimetres), or a crosshead that goes beyond the specimen's
/// end (micrometres). "" when nothing does, or `units` is stated.
[[nodiscard]] std::string unit_in_doubt(const RecordingMetadata& metadata, const FrameSamples& frame);

/// Throws RecordingError at the first fault, a unit in doubt and an output other than the force included; nothing is
/// half-read.
[[nodiscard]] Recording read_recording(const std::filesystem::path& folder);
/// The same of any output. One whose output is the pressure may have no frame.csv (a leak, a filling); `frame` is empty
/// then.
[[nodiscard]] Recording read_recording_of_any_output(const std::filesystem::path& folder);

/// One stream alone, as recorded by an instrument with its own clock (what `isorig align` starts from).
[[nodiscard]] FrameSamples read_frame_csv(const std::filesystem::path& file);
[[nodiscard]] PressureSamples read_pressure_csv(const std::filesystem::path& file);
[[nodiscard]] RecordingMetadata read_recording_toml(const std::filesystem::path& file);

/// recording.toml alone, for who writes the CSV files in parts (messages/csv.hpp). As write_recording().
void write_recording_toml(const std::filesystem::path& file, const RecordingMetadata& metadata);

/// Tables of the export beside the recording's own files, each `<name>.csv` (docs/formats/recording.md).
inline constexpr std::string_view kRecordingTables[] = {"setpoints", "steps", "ramps", "holds", "events", "sessions"};

/// What became of the files beside a recording that was replaced, by their names in the folder.
struct Replaced {
  std::vector<std::string> removed;  ///< its tables, and a stream that the new one has not
  std::vector<std::string> left;     ///< of nobody here
};

/// Makes the folder if needed and writes the recording's files; numbers in the shortest form that reads back as the
/// same double. Of a recording that was there nothing stays; what is no part of a recording does, and both are told.
/// Nothing is replaced before everything is written aside, and from then on the folder is no recording (it has no
/// recording.toml) until it is the new one. Throws RecordingError before touching anything if the content breaks a rule
/// of the format.
std::optional<Replaced> write_recording(const std::filesystem::path& folder, const Recording& recording);

}  // namespace isorig::messages
