#include "cli/runs/import_files.hpp"

#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>

#include "base/number_text.hpp"
#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/runs/import_constant.hpp"
#include "cli/runs/overwriting.hpp"
#include "daemon/version.hpp"
#include "identify/diagnose/guard/plausible.hpp"
#include "identify/fv/align.hpp"
#include "messages/csv.hpp"
#include "messages/foreign/decoded_text.hpp"
#include "model/composed.hpp"

namespace isorig::cli {
namespace {

using foreign::Field;
using foreign::Mapping;
using messages::Output;

std::string sha256_of(std::string_view bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int length = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), digest.data(), &length, EVP_sha256(), nullptr) != 1)
    throw std::runtime_error("SHA-256 could not be computed");
  std::string text;
  for (unsigned int i = 0; i < length; ++i) {
    constexpr std::string_view kDigits = "0123456789abcdef";
    (text += kDigits[digest[i] >> 4U]) += kDigits[digest[i] & 0xFU];
  }
  return text;
}

std::string toml_string(std::string_view text) {
  std::string out = "\"";
  for (const char c : base::printable(text)) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + '"';
}

std::string_view word_of(char mark) {
  return mark == '\t' ? "tab" : mark == ' ' ? "blank" : mark == ';' ? ";" : mark == '.' ? "." : ",";
}

/// A recording that is to be written, with where it comes from.
struct Ready {
  std::filesystem::path folder;
  messages::Recording recording;
  messages::FurtherColumns further;
  std::vector<std::string> said;
};

struct Origin {
  const ImportFile* file;
  const foreign::Test* test;
};

/// [import] and its tables: enough to make the recording again, and to see what was concluded.
std::string provenance(const std::vector<Origin>& origins, const Mapping& mapping, const ImportOptions& options,
                       const std::string& clock, const std::vector<std::string>& notes) {
  const auto from_column = [](const Origin& origin) {
    return std::ranges::find(origin.test->sources, Field::kForce, &foreign::Source::field) !=
           origin.test->sources.end();
  };
  const bool frame = std::ranges::any_of(origins, [](const Origin& origin) { return origin.test->frame.has_value(); });
  const std::string force = std::ranges::any_of(origins, from_column) ? "column" : frame ? "constant load" : "none";
  const auto list = [](const char* key, const std::vector<std::string>& lines) {
    std::string text = std::string(key) + " = [";
    for (const auto& line : lines) text += "\n  " + toml_string(line) + ",";
    return text + "]\n";
  };
  std::string text = "\n[import]\nformat = \"isorig-import/1\"\ncommand = " + toml_string(command_line()) +
                     "\nisorig = " + toml_string(daemon::kVersion) + "\nclock = " + toml_string(clock) +
                     "\nposition_at_zero_mm = " + base::exact_number_text(mapping.position_at_zero_mm()) +
                     "\nforce = \"" + force + "\"\n" + list("told", options.told) + list("notes", notes);
  for (const Origin& origin : origins) {
    text += "\n[[import.source]]\nfile = " + toml_string(origin.file->path.filename().string()) + "\nsha256 = \"" +
            origin.file->sha256 + "\"\nencoding = \"" + origin.file->encoding + "\"\ndelimiter = \"" +
            std::string(word_of(origin.file->parsed.delimiter)) + "\"\ndecimal = \"" +
            std::string(word_of(origin.file->parsed.decimal)) + "\"\nline = " + std::to_string(origin.test->line) +
            "\nheader = [";
    constexpr std::size_t kMost = 100;
    for (std::size_t i = 0; i < std::min(kMost, origin.file->parsed.header.size()); ++i)
      text += "\n  " + toml_string(origin.file->parsed.header[i]) + ",";
    const foreign::Table table{origin.test->line, origin.test->columns, {}};
    text += "]\nnot_kept = [";
    for (const std::size_t c : origin.test->not_kept)
      text += (c == origin.test->not_kept.front() ? "" : ", ") + toml_string(foreign::shown(table, c));
    text += "]\n";
    for (const auto& kept : origin.test->kept)
      text += "\n[[import.source.further]]\ncolumn = " + toml_string(kept.column.name) +
              "\nname = " + toml_string(origin.test->columns[kept.index].name) +
              "\nnumber = " + std::to_string(kept.index + 1) +
              "\nunit = " + toml_string(origin.test->columns[kept.index].unit) + "\n";
    for (const auto& source : origin.test->sources) {
      const auto& name = origin.test->columns[source.column].name;
      text += "\n[[import.source.column]]\nfield = \"" + std::string(foreign::name_of(source.field)) +
              "\"\nname = " + toml_string(name) + "\nnumber = " + std::to_string(source.column + 1) + "\nunit = \"" +
              std::string(source.unit.name) + "\"\n";
      if (source.field == Field::kPosition || source.field == Field::kForce)
        text += std::string("positive = \"") + (source.sign < 0.0 ? "compression" : "tension") + "\"\n";
    }
  }
  return text;
}

std::string understood_text(const Origin& origin) {
  std::string text;
  for (const auto& source : origin.test->sources) {
    const auto& column = origin.test->columns[source.column];
    text += (text.empty() ? "" : ", ") + std::string(foreign::name_of(source.field)) + " from " +
            (column.name.empty() ? "#" + std::to_string(source.column + 1) : "\"" + column.name + "\"") + " (" +
            std::string(source.unit.name) + (source.sign < 0.0 ? ", compression positive: turned round" : "") + ")";
  }
  const auto& frame = origin.test->frame;
  const bool from_column =
      std::ranges::find(origin.test->sources, Field::kForce, &foreign::Source::field) != origin.test->sources.end();
  if (frame && !from_column) text += ", force a constant load of " + base::number_text(frame->force_N.front()) + " N";
  return text;
}

/// Units and signs that the numbers contradict. The advice names what import can be told.
void refuse_odd(const Ready& ready, const ImportOptions& options) {
  if (options.as_stated) return;
  constexpr const char* kAdvice =
      "\n  say what is right with --unit COLUMN=UNIT, --positive force=compression, --rest-length-mm, or, if all is as "
      "stated, --as-stated";
  const auto& recording = ready.recording;
  auto unsure = recording.metadata;
  unsure.units_stated = false;
  const std::string name = ready.folder.string();
  if (const auto doubt = messages::unit_in_doubt(unsure, recording.frame); !doubt.empty())
    throw ImportRefused(name + ": " + doubt.substr(0, doubt.find("; is one of")) + "; is a unit wrong?" + kAdvice);
  // What is predicted of a position or a pressure has no spring whose sign could be told.
  if (recording.frame.size() >= 10 && recording.metadata.output == Output::kForce) {
    try {
      identify::refuse_implausible(recording, name, model::nominal_model("slse1"),
                                   identify::channel_quality(recording.frame.t_s, recording.frame.position_mm));
    } catch (const std::invalid_argument& e) {
      throw ImportRefused(e.what() + std::string(kAdvice));
    }
  }
  if (const auto odd = identify::odd_pressure(recording)) throw ImportRefused(name + ": " + odd->text + kAdvice);
}

messages::RecordingMetadata metadata_of(const Mapping& mapping) {
  if (mapping.pressurized_rest_length_mm && !mapping.rest_length_mm)
    throw ImportRefused(
        "--pressurized-rest-length-mm needs --rest-length-mm beside it: positions are counted from the unpressurized "
        "length");
  if (mapping.whole_length && !mapping.rest_length_mm)
    throw ImportRefused(
        "--zero-mm whole-length needs --rest-length-mm beside it: the position is the length without the rest length");
  messages::RecordingMetadata metadata;
  metadata.specimen = *mapping.specimen;
  metadata.rest_length_mm = mapping.rest_length_mm;
  metadata.pressurized_rest_length_mm = mapping.pressurized_rest_length_mm;
  metadata.nominal_pressure_psi = mapping.nominal_pressure_psi;
  metadata.units_stated = true;
  metadata.output = mapping.output.value_or(Output::kForce);
  return metadata;
}

/// Shares of the time that making a recording of long files takes.
constexpr double kConverted = 0.1, kAligned = 0.7, kChecked = 0.8;
void tell(const ImportOptions& options, double fraction, const char* doing) {
  if (options.on_progress) options.on_progress(fraction, doing);
}

/// Puts the pressure's time on the frame's clock; says how, for people and for the recording.
std::string put_on_one_clock(const messages::FrameSamples& frame, messages::PressureSamples& pressure,
                             const ImportOptions& options) {
  if (options.one_clock) {
    if (pressure.t_s.front() > frame.t_s.back() || pressure.t_s.back() < frame.t_s.front())
      throw ImportRefused("the two files have no moment in common: the frame goes from " +
                          base::number_text(frame.t_s.front(), 9) + " to " + base::number_text(frame.t_s.back(), 9) +
                          " s, the pressure from " + base::number_text(pressure.t_s.front(), 9) + " to " +
                          base::number_text(pressure.t_s.back(), 9) +
                          " s; are their clocks not one? Without --one-clock they are aligned by their strokes");
    return "one, as told (--one-clock)";
  }
  identify::AlignOptions how;
  how.on_progress = [&](double done) {
    tell(options, kConverted + (kAligned - kConverted) * done, "aligning the clocks");
  };
  const auto result = identify::align(frame, pressure, how);
  if (!result.aligned)
    throw ImportRefused("the two files have clocks of their own, and cannot be aligned: " + result.refusal +
                        "\n  if they count from the same moment, say so: --one-clock");
  const auto& a = result.alignment;
  for (double& t : pressure.t_s) t = a.frame_time_s(t);
  return "two, aligned by " + std::to_string(a.events.size()) + " strokes: offset " +
         base::number_text(a.offset_s.value, 6) + " +- " + base::number_text(a.offset_s.standard_error, 2) + " s at " +
         base::number_text(a.reference_s, 6) + " s, skew " + base::number_text(1e6 * a.skew.value, 3) + " ppm" +
         (a.skew_known ? "" : " (not known)") + "; worst error " + base::number_text(a.worst_error_s, 2) +
         " s (1 sigma)";
}

Ready ready_of(std::filesystem::path folder, const std::vector<Origin>& origins, const Mapping& mapping,
               const ImportOptions& options) {
  Ready ready{.folder = std::move(folder), .recording = {}, .further = {}, .said = {}};
  std::string clock = "one: a file has one";
  std::vector<std::string> notes;
  ready.recording.metadata = metadata_of(mapping);
  for (const Origin& origin : origins) {
    if (origin.test->frame) ready.recording.frame = *origin.test->frame;
    notes.insert(notes.end(), origin.test->notes.begin(), origin.test->notes.end());
    const auto constant =
        check_constant_columns(origin.file->path, *origin.test, ready.recording.metadata.output, options.as_stated);
    notes.insert(notes.end(), constant.begin(), constant.end());
  }
  for (const Origin& origin : origins) {
    if (!origin.test->pressure) continue;
    ready.recording.pressure = origin.test->pressure;
    if (!origin.test->frame && origins.size() > 1)
      clock = put_on_one_clock(ready.recording.frame, *ready.recording.pressure, options);
  }
  ready.recording.metadata.further_toml = provenance(origins, mapping, options, clock, notes);
  const auto& frame = ready.recording.frame;
  const auto& t_s = frame.t_s.empty() ? ready.recording.pressure->t_s : frame.t_s;
  const Output output = ready.recording.metadata.output;
  ready.said.push_back(
      ready.folder.string() + ": " +
      (frame.t_s.empty() ? "no frame" : std::to_string(frame.size()) + " rows of frame") + ", " +
      (ready.recording.pressure ? std::to_string(ready.recording.pressure->size()) + " of pressure" : "no pressure") +
      ", " + base::number_text(t_s.back() - t_s.front(), 6) + " s" +
      (output == Output::kForce ? "" : "; the output is the " + std::string(messages::name_of(output))));
  for (const Origin& origin : origins) {
    auto& further = origin.test->frame ? ready.further.frame : ready.further.pressure;
    for (const auto& kept : origin.test->kept) further.push_back(kept.column);
  }
  for (const Origin& origin : origins) {
    ready.said.push_back("  " + origin.file->path.filename().string() + ":" + std::to_string(origin.test->line) + ": " +
                         understood_text(origin));
    const foreign::Table table{origin.test->line, origin.test->columns, {}};
    std::string kept, not_kept;
    for (const auto& each : origin.test->kept)
      kept += (kept.empty() ? "" : ", ") + foreign::shown(table, each.index) + " as " + each.column.name;
    for (const std::size_t c : origin.test->not_kept)
      not_kept += (not_kept.empty() ? "" : ", ") + foreign::shown(table, c);
    if (!kept.empty()) ready.said.push_back("  kept as in the file: " + kept);
    if (!not_kept.empty()) ready.said.push_back("  not kept, as they hold more than numbers or none: " + not_kept);
  }
  if (origins.size() > 1) ready.said.push_back("  clocks: " + clock);
  for (const auto& note : notes) ready.said.push_back("  note: " + note);
  return ready;
}

}  // namespace

ImportFile read_import_file(const std::filesystem::path& path, const foreign::Dialect& dialect) {
  const std::string bytes = messages::read_whole_file(path);
  if (bytes.empty()) throw messages::RecordingError(messages::RecordingFault::kEmpty, path, 1, "the file is empty");
  const auto text = foreign::decode(bytes, path);
  return {path, sha256_of(bytes), std::string(text.name), foreign::parse_tables(text.utf8, path, dialect)};
}

std::vector<std::string> check_named_columns(const std::vector<ImportFile>& files,
                                             const std::vector<NamedColumn>& named) {
  std::vector<std::string> columns, notes;
  for (const ImportFile& file : files)
    for (const auto& table : file.parsed.tables)
      for (std::size_t c = 0; c < table.columns.size(); ++c)
        if (auto text = foreign::shown(table, c); std::ranges::find(columns, text) == columns.end())
          columns.push_back(std::move(text));
  std::string listed;
  for (const auto& column : columns) listed += (listed.empty() ? "" : ", ") + column;
  for (const NamedColumn& each : named) {
    const bool there = std::ranges::any_of(files, [&](const ImportFile& file) {
      return std::ranges::any_of(file.parsed.tables, [&](const auto& t) { return foreign::has_column(t, each.key); });
    });
    if (there) continue;
    std::string said = each.where + ": no column is called \"" + each.key + "\"";
    if (!each.optional) throw ImportRefused(said.append("; there are ").append(listed));
    notes.push_back(said.append("; it was left aside"));
  }
  return notes;
}

ImportPlan understand_files(const std::vector<ImportFile>& files, const Mapping& mapping) {
  ImportPlan plan;
  for (const ImportFile& file : files) {
    ImportPlan::Of of{.file = file, .tests = {}, .notes = {}};
    std::vector<ImportQuestion> questions;
    bool timed = false;
    for (std::size_t i = 0; i < file.parsed.tables.size(); ++i)
      timed = timed || foreign::understand(file.parsed.tables[i], mapping).timed;
    std::string columns;
    for (std::size_t i = 0; i < file.parsed.tables.size(); ++i) {
      const auto& table = file.parsed.tables[i];
      auto understood = foreign::understand(table, mapping);
      for (std::size_t c = 0; c < table.columns.size(); ++c)
        columns += (columns.empty() ? "" : ", ") + foreign::shown(table, c);
      if (timed && !understood.timed) {  // results of the tests
        of.notes.push_back(file.path.string() + ":" + std::to_string(table.line) +
                           ": a table without a time was left out");
        continue;
      }
      if (!understood.refusal.empty())
        throw ImportRefused(file.path.string() + ":" + std::to_string(table.line) + ": " + understood.refusal);
      for (auto& question : understood.questions)
        questions.push_back({file.path.string() + ":" + std::to_string(table.line), std::move(question)});
      plan.framed = plan.framed || understood.framed;
      plan.gauged = plan.gauged || understood.gauged;
      plan.loaded = plan.loaded || understood.loaded;
      if (!understood.sources.empty()) of.tests.emplace_back(i, std::move(understood));
    }
    if (of.tests.empty() && questions.empty())
      throw ImportRefused(file.path.string() +
                          ": no column is known to be a time, a position, a force or a pressure; it has " + columns +
                          "\n  name them: --column time=NAME --column position=NAME --column force=NAME");
    // The same question of every test of a file is asked once.
    for (auto& question : questions) {
      const bool there = std::ranges::any_of(plan.questions, [&](const ImportQuestion& q) {
        return q.question.answer == question.question.answer && q.question.text == question.question.text;
      });
      if (!there) plan.questions.push_back(std::move(question));
    }
    plan.files.push_back(std::move(of));
  }
  const auto ask = [&](const char* text, const char* option, auto take) {
    plan.questions.push_back({files.front().path.string(), {text, option, std::move(take)}});
  };
  if (!mapping.output && !plan.framed && plan.gauged)
    ask("there is a pressure, and no position and force: is the pressure what a model is to predict, as of a leak or a "
        "filling (pressure)? Else name the frame's file too",
        "--output pressure", [](std::string_view answer, Mapping& m) {
          if (answer != messages::name_of(Output::kPressure)) return false;
          m.output = Output::kPressure;
          return true;
        });
  if (!mapping.specimen)
    ask("what is the specimen called?", "--specimen NAME", [](std::string_view answer, Mapping& m) {
      if (!answer.empty()) m.specimen = answer;
      return !answer.empty();
    });
  const bool of_pressure_alone = mapping.output == Output::kPressure && !plan.framed;
  if (!mapping.rest_length_mm && !mapping.no_rest_length && !of_pressure_alone)
    ask("how long is the specimen without pressure and load, in mm? (\"none\": it has no such length)",
        "--rest-length-mm L", [](std::string_view answer, Mapping& m) {
          m.no_rest_length = answer == "none";
          m.rest_length_mm = rest_length_of(answer);
          return m.no_rest_length || m.rest_length_mm;
        });
  // Without a rest length the zero is anything; with one, strains are counted from it.
  for (const auto& of : plan.files)
    for (const auto& [index, understood] : of.tests)
      if (understood.whole_length && mapping.rest_length_mm && !mapping.zero_is_told()) {
        plan.questions.push_back(
            {of.file.path.string(),
             {"column " + foreign::shown(of.file.parsed.tables[index], *understood.whole_length) +
                  " is a length by its name: the specimen's whole length (whole-length), or at which position, in mm "
                  "from the unpressurized rest length, is its zero?",
              "--zero-mm whole-length, or --zero-mm 0 where it is what the specimen got longer by",
              [](std::string_view answer, Mapping& m) { return take_zero(answer, m); }}});
        return plan;
      }
  return plan;
}

bool take_zero(std::string_view text, Mapping& mapping) {
  constexpr double kFarthest_mm = 1e4;
  const auto value = foreign::number_of(text, '.');
  const bool whole = text == foreign::kWholeLength;
  if (!whole && (!value || std::fabs(*value) > kFarthest_mm)) return false;
  mapping.whole_length = whole;
  mapping.zero_mm = whole ? std::nullopt : value;
  return true;
}

std::optional<double> rest_length_of(std::string_view text) {
  constexpr double kShortest_mm = 1e-3, kLongest_mm = 1e4;
  const auto value = foreign::number_of(text, '.');
  return value && *value >= kShortest_mm && *value <= kLongest_mm ? value : std::nullopt;
}

namespace {

void refuse_to_overwrite(const ImportPlan& plan, const std::filesystem::path& folder, bool replace) {
  constexpr std::string_view kNames[] = {"recording.toml", "frame.csv", "pressure.csv"};
  std::vector<std::string> tables;
  for (const auto table : messages::kRecordingTables) tables.push_back(std::string(table) + ".csv");
  std::vector<std::string_view> also(tables.begin(), tables.end());
  also.emplace_back("mapping.toml");
  std::vector<std::filesystem::path> read;
  for (const auto& of : plan.files) read.push_back(of.file.path);
  const auto why = why_not_to_overwrite(folder, {.names = kNames, .also = also, .read = read, .replace = replace});
  if (!why.empty()) throw ImportRefused(why);
}

/// An earlier import had more tests, or one alone: what is left of it is taken for this one's by who names all.
void say_others(const std::filesystem::path& out, const std::vector<Ready>& ready, std::vector<std::string>& said) {
  const auto is_new = [&](const std::filesystem::path& folder) {
    std::error_code error;
    return std::ranges::any_of(
        ready, [&](const Ready& each) { return std::filesystem::equivalent(each.folder, folder, error); });
  };
  std::vector<std::filesystem::path> folders{out};
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(out, error)) folders.push_back(entry.path());
  std::ranges::sort(folders);
  for (const auto& folder : folders)
    if (std::filesystem::is_regular_file(folder / "recording.toml", error) && !is_new(folder))
      said.push_back("note: " + folder.string() +
                     " is a recording that was there before, and none of this import; remove it if it is of a former "
                     "one");
}

}  // namespace

Imported make_recordings(const ImportPlan& plan, const Mapping& mapping, const ImportOptions& options) {
  struct File {
    const ImportPlan::Of* of;
    std::vector<foreign::Test> tests;
  };
  std::vector<File> frames, gauges;
  Imported out;
  tell(options, 0.0, "taking over the numbers");
  for (const auto& of : plan.files) {
    File file{&of, {}};
    for (const auto& [table, understood] : of.tests) {
      file.tests.push_back(foreign::convert(of.file.parsed.tables[table], understood.sources, of.file.parsed.decimal,
                                            mapping.position_at_zero_mm(), of.file.path,
                                            understood.loaded ? mapping.load_N : std::nullopt));
      file.tests.back().notes.insert(file.tests.back().notes.begin(), understood.notes.begin(), understood.notes.end());
      if (!file.tests.back().frame && !file.tests.back().pressure)
        throw ImportRefused(of.file.path.string() + ":" + std::to_string(file.tests.back().line) +
                            ": a time, and neither position and force nor a pressure; name the columns with --column");
    }
    out.said.insert(out.said.end(), of.notes.begin(), of.notes.end());
    const bool with_frame = std::ranges::any_of(file.tests, [](const auto& test) { return test.frame.has_value(); });
    (with_frame ? frames : gauges).push_back(std::move(file));
  }
  const Output output = mapping.output.value_or(Output::kForce);
  if (frames.empty() && output != Output::kPressure)
    throw ImportRefused(plan.files.front().file.path.string() +
                        ": there is a pressure, and no position and force; name the frame's file too, or say that the "
                        "pressure is what a model is to predict: --output pressure");
  if (!plan.gauged && output == Output::kPressure)
    throw ImportRefused(plan.files.front().file.path.string() +
                        ": the pressure is the output, and no column is known to be one; name it with --column "
                        "pressure=NAME");
  std::vector<Ready> ready;
  if (!gauges.empty() && !frames.empty()) {
    if (frames.size() != 1 || gauges.size() != 1 || frames[0].tests.size() != 1 || gauges[0].tests.size() != 1)
      throw ImportRefused(
          "a pressure log belongs to one test: name one file of the frame with one test in it, and one pressure log");
    if (frames[0].tests[0].pressure)
      throw ImportRefused(
          "both files have a pressure; name one of them, or say which column is the pressure (--column pressure=NAME)");
    ready.push_back(ready_of(options.out,
                             {{&frames[0].of->file, &frames[0].tests[0]}, {&gauges[0].of->file, &gauges[0].tests[0]}},
                             mapping, options));
  } else {
    const auto& whole = frames.empty() ? gauges : frames;
    std::size_t count = 0;
    for (const auto& file : whole) count += file.tests.size();
    for (const auto& file : whole) {
      for (std::size_t k = 0; k < file.tests.size(); ++k) {
        if (output == Output::kPressure && !file.tests[k].pressure)
          throw ImportRefused(file.of->file.path.string() + ":" + std::to_string(file.tests[k].line) +
                              ": a test without the pressure, which is the output");
        if (output != Output::kPressure && !file.tests[k].frame)
          throw ImportRefused(file.of->file.path.string() + ":" + std::to_string(file.tests[k].line) +
                              ": a test without position and force");
        std::filesystem::path folder = options.out;
        if (count > 1) {
          const std::string stem =
              whole.size() > 1 ? file.of->file.path.stem().string() + (file.tests.size() > 1 ? "-" : "") : "";
          folder /= stem + (file.tests.size() > 1 ? "test-" + std::to_string(k + 1) : "");
        }
        ready.push_back(ready_of(folder, {{&file.of->file, &file.tests[k]}}, mapping, options));
      }
    }
  }
  tell(options, kAligned, "checking the numbers");
  for (std::size_t i = 0; i < ready.size(); ++i) {
    refuse_odd(ready[i], options);
    for (std::size_t k = 0; k < i; ++k)
      if (ready[k].folder == ready[i].folder)
        throw ImportRefused("two files are called " + ready[i].folder.filename().string() + "; import them one by one");
    refuse_to_overwrite(plan, ready[i].folder, options.replace);
  }
  tell(options, kChecked, "writing");
  for (const auto& each : ready) {
    const auto replaced = messages::write_recording(each.folder, each.recording, each.further);
    out.said.insert(out.said.end(), each.said.begin(), each.said.end());
    if (!replaced) continue;
    for (const auto& line : said_of(*replaced)) out.said.push_back("  " + line);
  }
  if (options.replace || ready.size() > 1) say_others(options.out, ready, out.said);
  return out;
}

}  // namespace isorig::cli
