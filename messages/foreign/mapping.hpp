#pragma once
#include <array>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "messages/foreign/tables.hpp"
#include "messages/recording.hpp"

namespace isorig::foreign {

enum class Field { kTime, kPosition, kForce, kPressure };
inline constexpr std::array<Field, 4> kFields{Field::kTime, Field::kPosition, Field::kForce, Field::kPressure};
/// "time", "position", "force", "pressure".
[[nodiscard]] std::string_view name_of(Field field);
/// Of a recording: "s", "mm", "N", "psi".
[[nodiscard]] std::string_view unit_of(Field field);
[[nodiscard]] std::optional<Field> field_of(std::string_view name);

/// value in the recording's unit = factor * (number - zero)
struct Unit {
  std::string_view name;
  Field field;
  double factor;
  double zero = 0.0;
};
/// A time of day is no number (clock_s); its "unit".
inline constexpr std::string_view kClock = "clock";
/// Exact by definition: inch and foot (25.4 mm, 304.8 mm), pound-force and kilogram-force (4.4482216152605 N, 9.80665
/// N), and psi, an lbf per square inch (BIPM, SI brochure 2019; NIST SP 811, 2008). `elvh_counts`: the bridge value of
/// the rig's pressure sensor (messages/elvh.hpp).
[[nodiscard]] std::optional<Unit> find_unit(std::string_view text);
/// All of a field, for a question: "mm, cm, m, um, in, ft".
[[nodiscard]] std::string units_of(Field field);

/// "force", "position", "pressure": what a model is to predict.
[[nodiscard]] std::optional<messages::Output> output_of(std::string_view name);

/// As of any force (messages/csv.hpp).
inline constexpr double kMostLoad_N = 1e6;
/// In place of the position of a file's zero: its column is the whole specimen's length, whatever specimen it is.
inline constexpr std::string_view kWholeLength = "whole-length";

/// What a person knows of a file and the file does not say: from the command line, the wizard or "isorig-mapping/1".
struct Mapping {
  Dialect dialect;
  std::map<Field, std::string> column;         ///< its name, or "#2" for the second
  std::map<std::string, std::string> unit;     ///< of a column, by the same
  std::map<Field, bool> compression_positive;  ///< position and force
  std::optional<messages::Output> output;      ///< not told: the force, where there is one
  std::optional<double> load_N;                ///< constant, tension positive, where no column is the force
  std::optional<std::string> specimen;
  bool no_rest_length = false;  ///< it was said that there is none, or none that is known
  std::optional<double> rest_length_mm, pressurized_rest_length_mm, nominal_pressure_psi;
  std::optional<double> zero_mm;  ///< position that the file calls zero
  bool whole_length = false;      ///< in place of zero_mm: the file has the length of the whole specimen

  [[nodiscard]] bool zero_is_told() const noexcept { return zero_mm || whole_length; }
  [[nodiscard]] double position_at_zero_mm() const noexcept {
    return whole_length ? -rest_length_mm.value_or(0.0) : zero_mm.value_or(0.0);
  }
};

/// Throws base::ConfigError.
[[nodiscard]] Mapping read_mapping(const std::filesystem::path& file);
/// For the next files of the same kind: everything but the specimen's name. read_mapping() takes a name nevertheless,
/// as mappings of earlier versions have one.
[[nodiscard]] std::string mapping_text(const Mapping& mapping);

/// A column that a field is read from.
struct Source {
  Field field;
  std::size_t column = 0;
  Unit unit;
  double sign = 1.0;
};

/// What is not clear, and how to say it.
struct Question {
  std::string text;    ///< "which column is the force: \"Load\" (N) or \"Force 2\" (N)?"
  std::string answer;  ///< the option of the command line that says it: "--column force=NAME"
  /// Takes an answer into the mapping; false when it is none of those that there are.
  std::function<bool(std::string_view, Mapping&)> take;
};

struct Understood {
  std::vector<Source> sources;  ///< empty: a table of something else (results), without a time
  std::vector<Question> questions;
  std::vector<std::string> notes;       ///< what was concluded from names
  std::string refusal;                  ///< why the table cannot be taken at all; "" if it can
  bool timed = false;                   ///< a column is the time, or may be once a question is answered
  bool framed = false, gauged = false;  ///< likewise position or force; the pressure
  bool loaded = false;                  ///< the force is the load that was told, or is asked for
  /// The column of the position where it is a length by its name: that of the whole specimen, which is no position
  /// before its rest length is taken off.
  std::optional<std::size_t> whole_length;
};

/// Which column is what, by units and names (English, German, French, Spanish, Italian). Nothing is guessed: a unit
/// that neither file nor mapping states, two columns that may be meant, or a name that says nothing is a question. A
/// force needs a position and a position a force, or a constant load where the output is not the force.
[[nodiscard]] Understood understand(const Table& table, const Mapping& mapping);

/// Whether a mapping's name of a column ("Load", "#2") means one of this table.
[[nodiscard]] bool has_column(const Table& table, std::string_view key);

/// A force as a person types it: "0.98", "0.98 N", "100 g", "0.1 kg" (standard gravity). False where it is none.
[[nodiscard]] bool take_load(std::string_view text, Mapping& mapping);

/// "Load" (N), or #2 (no name).
[[nodiscard]] std::string shown(const Table& table, std::size_t column);

}  // namespace isorig::foreign
