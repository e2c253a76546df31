#include "messages/recording.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <sstream>
#include <system_error>

#include "base/number_text.hpp"
#include "base/printable.hpp"
#include "base/quantile.hpp"
#include "base/toml_reader.hpp"
#include "base/whole_file.hpp"
#include "messages/csv.hpp"
#include "messages/further_columns.hpp"

namespace isorig::messages {
namespace {

using Fault = RecordingFault;
constexpr std::array<std::string_view, 7> kOwnKeys{
    "format", "specimen", "rest_length_mm", "pressurized_rest_length_mm", "nominal_pressure_psi", "units", "output"};
constexpr base::Range kLength{0.0, 1e4, true};
constexpr base::Range kPressure{-1e3, 1e3};

std::array<CsvColumnView, 3> columns_of(const FrameSamples& f) {
  return {{{"t_s", f.t_s}, {"position_mm", f.position_mm}, {"force_N", f.force_N}}};
}

std::array<CsvColumnView, 2> columns_of(const PressureSamples& p) {
  return {{{"t_s", p.t_s}, {"pressure_psi", p.pressure_psi}}};
}

/// The text without the lines of our own keys; all else, comments included, stays as it was written.
std::string further_text(const std::string& text) {
  const toml::table root = toml::parse(text);
  std::vector<std::pair<std::uint32_t, std::uint32_t>> cut;
  for (const auto key : kOwnKeys) {
    if (const auto* node = root.get(key)) cut.emplace_back(node->source().begin.line, node->source().end.line);
  }
  std::string kept;
  std::istringstream in(text);
  std::string line;
  for (std::uint32_t number = 1; std::getline(in, line); ++number) {
    const bool own =
        std::any_of(cut.begin(), cut.end(), [&](const auto& c) { return number >= c.first && number <= c.second; });
    if (!own) kept += line + '\n';
  }
  return kept.find_first_not_of(" \t\r\n") == std::string::npos ? std::string{} : kept;
}

RecordingMetadata parse_metadata(const std::string& text, const std::filesystem::path& file) {
  try {
    const auto document = base::TomlDocument::parse_text(text, file.string());
    const auto root = document.root();
    root.ignore_rest();
    if (root.type_of("format") == "string" && root.string("format") != kRecordingFormat) {
      throw RecordingError(
          Fault::kFormat, file, root.where("format").line,
          "`format` is \"" + root.string("format") + "\"; this reads \"" + std::string(kRecordingFormat) + "\"");
    }
    RecordingMetadata metadata;
    static_cast<void>(root.string("format"));
    metadata.specimen = root.string("specimen");
    if (root.has("rest_length_mm")) metadata.rest_length_mm = root.number("rest_length_mm", kLength);
    if (root.has("pressurized_rest_length_mm")) {
      if (!metadata.rest_length_mm)
        throw RecordingError(Fault::kMetadata, file, root.where("pressurized_rest_length_mm").line,
                             "`pressurized_rest_length_mm` is stated without `rest_length_mm`, which positions are "
                             "counted from; state both, or neither for what is no McKibben");
      metadata.pressurized_rest_length_mm = root.number("pressurized_rest_length_mm", kLength);
    }
    if (root.has("nominal_pressure_psi"))
      metadata.nominal_pressure_psi = root.number("nominal_pressure_psi", kPressure);
    if (root.has("units")) metadata.units_stated = root.choice("units", {kRecordingUnits}) == kRecordingUnits;
    if (root.has("output")) {
      const std::string output = root.choice("output", {"force", "position", "pressure"});
      metadata.output = output == "position"   ? Output::kPosition
                        : output == "pressure" ? Output::kPressure
                                               : Output::kForce;
    }
    document.finish();
    metadata.further_toml = further_text(text);
    return metadata;
  } catch (const base::ConfigError& e) {
    std::string message;
    for (const auto& d : e.diagnostics()) {
      if (!message.empty()) message += "; line " + std::to_string(d.line) + ": ";
      message += d.message;
    }
    throw RecordingError(Fault::kMetadata, file, e.diagnostics().front().line, message);
  }
}

std::string toml_string(const std::string& value) {
  std::ostringstream out;
  out << toml::value<std::string>(value);
  return out.str();
}

std::string toml_number(double value) {
  char digits[32];
  const auto end = std::to_chars(digits, digits + sizeof digits, value).ptr;
  std::string text(digits, end);
  return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
}

std::string metadata_text(const RecordingMetadata& metadata) {
  std::string text = "format = \"" + std::string(kRecordingFormat) + "\"\n";
  text += "specimen = " + toml_string(metadata.specimen) + '\n';
  if (metadata.rest_length_mm) text += "rest_length_mm = " + toml_number(*metadata.rest_length_mm) + '\n';
  if (metadata.pressurized_rest_length_mm) {
    text += "pressurized_rest_length_mm = " + toml_number(*metadata.pressurized_rest_length_mm) + '\n';
  }
  if (metadata.nominal_pressure_psi) {
    text += "nominal_pressure_psi = " + toml_number(*metadata.nominal_pressure_psi) + '\n';
  }
  if (metadata.output != Output::kForce) text += "output = \"" + std::string(name_of(metadata.output)) + "\"\n";
  if (metadata.units_stated) text += "units = \"" + std::string(kRecordingUnits) + "\"\n";
  text += metadata.further_toml;
  if (!text.ends_with('\n')) text += '\n';
  return text;
}

}  // namespace

RecordingError::RecordingError(RecordingFault fault, std::filesystem::path file, std::size_t line,
                               const std::string& message)
    : std::runtime_error(base::printable(file.string()) + (line > 0 ? ":" + std::to_string(line) : std::string{}) +
                         ": " + base::printable(message)),
      fault_(fault),
      file_(std::move(file)),
      line_(line) {}

std::vector<double> Recording::strain() const {
  std::vector<double> out(frame.position_mm.size());
  std::transform(frame.position_mm.begin(), frame.position_mm.end(), out.begin(),
                 [this](double position_mm) { return metadata.strain(position_mm); });
  return out;
}

FrameSamples read_frame_csv(const std::filesystem::path& file) {
  FrameSamples frame;
  read_number_csv(file, std::array<CsvColumn, 3>{
                            {{"t_s", &frame.t_s}, {"position_mm", &frame.position_mm}, {"force_N", &frame.force_N}}});
  return frame;
}

PressureSamples read_pressure_csv(const std::filesystem::path& file) {
  PressureSamples pressure;
  read_number_csv(file, std::array<CsvColumn, 2>{{{"t_s", &pressure.t_s}, {"pressure_psi", &pressure.pressure_psi}}});
  return pressure;
}

RecordingMetadata read_recording_toml(const std::filesystem::path& file) {
  return parse_metadata(read_whole_file(file), file);
}

std::string unit_in_doubt(const RecordingMetadata& metadata, const FrameSamples& frame) {
  if (metadata.units_stated || frame.size() < 2) return {};
  const auto doubt = [](const std::string& what) {
    return what +
           "; is one of the two in another unit? position_mm, rest_length_mm and pressurized_rest_length_mm are in "
           "millimetres: "
           "convert them, or, if they are, say so in recording.toml: units = \"" +
           std::string(kRecordingUnits) + "\"";
  };
  const auto text = [](double value) { return base::number_text(value, 3); };
  if (!metadata.rest_length_mm) return {};  // nothing to compare a position with
  const double rest_mm = *metadata.rest_length_mm;
  const double length_mm = std::min(rest_mm, metadata.reference_length_mm());
  const auto [low, high] = std::ranges::minmax(frame.position_mm);
  const double stroke_mm = high - low;
  const std::string of = " of a specimen that is " + text(length_mm) + " mm long";
  constexpr double kShortest_mm = 1.0, kSmallestShare = 5e-4, kLargestShare = 10.0;
  if (length_mm < kShortest_mm) return doubt("positions from " + text(low) + " to " + text(high) + " mm" + of);
  if (low <= -rest_mm || high > kLargestShare * rest_mm) {
    return doubt("positions from " + text(low) + " to " + text(high) + " mm" + of);
  }
  if (stroke_mm >= kSmallestShare * length_mm) return {};
  // A crosshead that stands still says nothing of units: noise spans some ten times its usual step.
  std::vector<double> steps;
  double quantum_mm = stroke_mm;
  for (std::size_t i = 1; i < frame.size(); ++i) {
    steps.push_back(std::abs(frame.position_mm[i] - frame.position_mm[i - 1]));
    if (steps.back() > 0.0) quantum_mm = std::min(quantum_mm, steps.back());
  }
  if (stroke_mm <= 20.0 * std::max(base::quantile(std::move(steps), 0.5), quantum_mm)) return {};
  return doubt("a stroke of " + text(stroke_mm) + " mm, " + text(100.0 * stroke_mm / length_mm) + " %" + of);
}

namespace {

/// The recordings that lie in a folder which is none itself, in the order of their names.
std::vector<std::filesystem::path> recordings_in(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> inside;
  std::error_code error;
  if (std::filesystem::exists(std::filesystem::symlink_status(folder / "recording.toml", error))) return inside;
  for (auto at = std::filesystem::directory_iterator(folder, error);
       !error && at != std::filesystem::directory_iterator(); at.increment(error)) {
    std::error_code ignored;
    if (std::filesystem::is_regular_file(at->path() / "recording.toml", ignored)) inside.push_back(at->path());
  }
  std::sort(inside.begin(), inside.end());
  return inside;
}

}  // namespace

std::string_view name_of(Output output) {
  switch (output) {
    case Output::kForce:
      return "force";
    case Output::kPosition:
      return "position";
    case Output::kPressure:
      return "pressure";
  }
  return "";
}

Recording read_recording(const std::filesystem::path& folder) {
  Recording recording = read_recording_of_any_output(folder);
  if (recording.metadata.output == Output::kForce) return recording;
  throw RecordingError(Fault::kMetadata, folder / "recording.toml", 0,
                       "`output` is \"" + std::string(name_of(recording.metadata.output)) +
                           "\", and this analyses forces alone; `isorig diagnose` and `isorig predict` answer for the "
                           "outputs \"position\" and \"pressure\"");
}

Recording read_recording_of_any_output(const std::filesystem::path& folder) {
  std::error_code ignored;
  if (!std::filesystem::is_directory(folder, ignored)) {
    throw RecordingError(Fault::kMissingFile, folder, 0,
                         "not a recording: no such folder (a recording is a folder with recording.toml, frame.csv "
                         "and, if it has one, pressure.csv)");
  }
  if (const auto inside = recordings_in(folder); !inside.empty()) {
    throw RecordingError(Fault::kMissingFile, folder, 0,
                         "not a recording, but a folder of " + std::to_string(inside.size()) + " (" +
                             inside.front().filename().string() + (inside.size() > 1 ? ", ..." : "") +
                             "); name the ones that are meant: " + (folder / "*").string() + " for all");
  }
  if (std::filesystem::is_regular_file(folder / "run.toml", ignored) &&
      !std::filesystem::exists(std::filesystem::symlink_status(folder / "recording.toml", ignored))) {
    throw RecordingError(Fault::kMissingFile, folder, 0,
                         "a run, and not a recording: `isorig export " + folder.string() +
                             " --out DIR` writes its recordings; then name DIR/*");
  }
  Recording recording;
  recording.metadata = read_recording_toml(folder / "recording.toml");
  const bool frame_there = recording.metadata.output != Output::kPressure ||
                           std::filesystem::exists(std::filesystem::symlink_status(folder / "frame.csv", ignored));
  if (frame_there) recording.frame = read_frame_csv(folder / "frame.csv");
  if (const auto doubt = unit_in_doubt(recording.metadata, recording.frame); !doubt.empty()) {
    throw RecordingError(Fault::kUnits, folder / "frame.csv", 0, doubt);
  }
  // symlink_status: a dangling link is a fault, not a recording without pressure.
  if (std::filesystem::exists(std::filesystem::symlink_status(folder / "pressure.csv", ignored))) {
    recording.pressure = read_pressure_csv(folder / "pressure.csv");
  } else if (recording.metadata.output == Output::kPressure) {
    throw RecordingError(Fault::kMissingFile, folder / "pressure.csv", 0,
                         "no such file, and recording.toml says that the pressure is the output");
  }
  return recording;
}

namespace {

/// The text of recording.toml; throws when it could not be read back.
std::string checked_metadata_text(const RecordingMetadata& metadata, const std::filesystem::path& file) {
  std::string text = metadata_text(metadata);
  try {
    static_cast<void>(parse_metadata(text, file));
  } catch (const RecordingError& e) {
    throw RecordingError(Fault::kInconsistent, file, e.line(), std::string("not written: ") + e.what());
  }
  return text;
}

/// The rules that a reader holds further columns to.
void check_further(const std::filesystem::path& file, std::span<const CsvColumnView> own,
                   std::span<const FurtherColumn> further) {
  std::vector<std::string_view> names;
  for (const auto& column : own) names.push_back(column.name);
  const auto refuse = [&](const std::string& what) {
    throw RecordingError(Fault::kInconsistent, file, 0, "not written: " + what);
  };
  const auto breaks = [](std::string_view cell) { return cell.find_first_of(",\"\r\n") != std::string_view::npos; };
  for (const FurtherColumn& column : further) {
    if (column.name.find_first_not_of(" \t") == std::string::npos) refuse("a further column has no name");
    if (std::ranges::find(names, column.name) != names.end()) refuse("two columns are called `" + column.name + "`");
    names.push_back(column.name);
    if (column.cells.size() != own[0].values.size())
      refuse("`" + column.name + "` has " + std::to_string(column.cells.size()) + " rows, `" +
             std::string(own[0].name) + "` has " + std::to_string(own[0].values.size()));
    if (breaks(column.name) || std::ranges::any_of(column.cells, breaks))
      refuse("`" + column.name + "` has a comma, a quote or a line end in it");
  }
}

[[noreturn]] void refuse_to_write(const base::WriteError& e) {
  throw RecordingError(Fault::kUnreadable, e.file(), 0,
                       "cannot be written: " + e.reason() + "; check the disk's space and permissions");
}

void remove_old(const std::filesystem::path& file) {
  std::error_code failed;
  std::filesystem::remove(file, failed);
  if (failed)
    throw RecordingError(Fault::kUnreadable, file, 0,
                         "of the recording that is to be replaced, cannot be removed: " + failed.message());
}

bool is_stream(std::string_view name) {
  return name == "frame.csv" || name == "pressure.csv";
}

/// Of the folder's recording, if it has one, all goes but the streams that are to be replaced; so do `streams`,
/// whatever they are of. Its tables go while it still is a recording: without recording.toml nothing says whose they
/// are.
std::optional<Replaced> take_apart(const std::filesystem::path& folder, const std::vector<std::string>& streams) {
  std::error_code ignored;
  const auto there = [&](const std::string& name) {
    return std::filesystem::exists(std::filesystem::symlink_status(folder / name, ignored));
  };
  const bool was_recording = there("recording.toml");
  Replaced replaced;
  for (const auto table : kRecordingTables) {
    const std::string name = std::string(table) + ".csv";
    if (was_recording && there(name) && !std::filesystem::is_directory(folder / name, ignored))
      replaced.removed.push_back(name);
  }
  for (const auto& name : replaced.removed) remove_old(folder / name);
  if (was_recording) remove_old(folder / "recording.toml");
  for (const auto& name : streams) {
    if (!there(name)) continue;
    remove_old(folder / name);
    replaced.removed.push_back(name);
  }
  if (!was_recording) return std::nullopt;
  for (const auto& entry : std::filesystem::directory_iterator(folder, ignored)) {
    const std::string name = entry.path().filename().string();
    const std::string stem = name.substr(0, name.find(".part-"));  // what is to come is written aside
    if (!is_stream(stem) && stem != "recording.toml") replaced.left.push_back(name);
  }
  std::ranges::sort(replaced.left);
  return replaced;
}

}  // namespace

void write_recording_toml(const std::filesystem::path& file, const RecordingMetadata& metadata) {
  const std::string text = checked_metadata_text(metadata, file);
  try {
    base::write_whole_file(file, text);
  } catch (const base::WriteError& e) {
    refuse_to_write(e);
  }
}

std::optional<Replaced> write_recording(const std::filesystem::path& folder, const Recording& recording) {
  return write_recording(folder, recording, {});
}

std::optional<Replaced> write_recording(const std::filesystem::path& folder, const Recording& recording,
                                        const FurtherColumns& further) {
  const std::string metadata = checked_metadata_text(recording.metadata, folder / "recording.toml");
  if (recording.metadata.output == Output::kPressure && !recording.pressure)
    throw RecordingError(Fault::kInconsistent, folder / "pressure.csv", 0,
                         "not written: the pressure is the output, and there is none");
  const bool of_pressure_alone =
      recording.metadata.output == Output::kPressure && recording.pressure && recording.frame.size() == 0;
  if (!of_pressure_alone) {
    check_columns(folder / "frame.csv", columns_of(recording.frame));
    check_further(folder / "frame.csv", columns_of(recording.frame), further.frame);
  }
  if (recording.pressure) {
    check_columns(folder / "pressure.csv", columns_of(*recording.pressure));
    check_further(folder / "pressure.csv", columns_of(*recording.pressure), further.pressure);
  }

  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  if (failed) throw RecordingError(Fault::kUnreadable, folder, 0, "cannot be made: " + failed.message());
  std::vector<std::string> gone;
  if (of_pressure_alone) gone.emplace_back("frame.csv");
  if (!recording.pressure) gone.emplace_back("pressure.csv");
  for (const auto& name : gone)
    if (std::filesystem::is_directory(folder / name, failed))
      throw RecordingError(Fault::kUnreadable, folder / name, 0,
                           "is a folder where the recording has no file; move it");
  try {
    base::WholeFiles streams, head;
    if (!of_pressure_alone)
      streams.add(folder / "frame.csv",
                  with_further_columns(number_csv_text(columns_of(recording.frame)), further.frame));
    if (recording.pressure)
      streams.add(folder / "pressure.csv",
                  with_further_columns(number_csv_text(columns_of(*recording.pressure)), further.pressure));
    head.add(folder / "recording.toml", metadata);
    auto replaced = take_apart(folder, gone);
    streams.put();
    head.put();
    return replaced;
  } catch (const base::WriteError& e) {
    refuse_to_write(e);
  }
}

}  // namespace isorig::messages
