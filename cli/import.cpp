#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>

#include "base/printable.hpp"
#include "base/toml_reader.hpp"
#include "cli/acts.hpp"
#include "cli/command.hpp"
#include "cli/import_files.hpp"
#include "identify/report/page.hpp"

/// isorig import: files of other programs become recordings; what they do not say is asked, and remembered.
namespace isorig::cli {
namespace {

using foreign::Field;
using foreign::Mapping;

struct Options {
  std::vector<std::string> files, column, unit, positive;
  std::string out, mapping, delimiter, decimal, specimen;
  std::string rest_length_mm;
  std::optional<double> pressurized_rest_length_mm, nominal_pressure_psi, zero_mm;
  bool one_clock = false, as_stated = false, replace = false;
};

/// "NAME=VALUE", at the last "=": names of columns may have some.
std::pair<std::string, std::string> halves(const std::string& text, const char* option) {
  const auto at = text.rfind('=');
  if (at == std::string::npos || at == 0 || at + 1 == text.size())
    throw CLI::ValidationError(option, "\"" + text + "\" has to be NAME=VALUE");
  return {text.substr(0, at), text.substr(at + 1)};
}

/// A mapping file, and over it what the command line says; every column that either names goes to `named`.
Mapping told(const Options& o, std::vector<NamedColumn>& named) {
  Mapping mapping;
  if (!o.mapping.empty()) mapping = foreign::read_mapping(o.mapping);
  for (const auto& [field, column] : mapping.column) named.push_back({column, o.mapping, true});
  for (const auto& [column, unit] : mapping.unit) named.push_back({column, o.mapping, true});
  for (const auto& text : o.column) {
    const auto at = text.find('=');  // the field's name has none
    const auto field = foreign::field_of(text.substr(0, at));
    if (!field || at == std::string::npos || at + 1 == text.size())
      throw CLI::ValidationError(
          "--column", "\"" + text + "\" has to be time|position|force|pressure=NAME, or =#2 for the second column");
    mapping.column[*field] = text.substr(at + 1);
    named.push_back({mapping.column[*field], "--column " + text});
  }
  for (const auto& text : o.unit) {
    const auto [column, unit] = halves(text, "--unit");
    if (!foreign::find_unit(unit))
      throw CLI::ValidationError("--unit", "unknown unit \"" + unit + "\"; time: " + foreign::units_of(Field::kTime) +
                                               "; length: " + foreign::units_of(Field::kPosition) +
                                               "; force: " + foreign::units_of(Field::kForce) +
                                               "; pressure: " + foreign::units_of(Field::kPressure));
    mapping.unit[column] = unit;
    named.push_back({column, "--unit " + text});
  }
  for (const auto& text : o.positive) {
    const auto [name, way] = halves(text, "--positive");
    const auto field = foreign::field_of(name);
    const bool known = way == "tension" || way == "compression";
    if (!known || (field != Field::kPosition && field != Field::kForce))
      throw CLI::ValidationError("--positive", "\"" + text + "\" has to be position|force=tension|compression");
    mapping.compression_positive[*field] = way == "compression";
  }
  const auto mark = [](const std::string& text) { return text == "tab" ? '\t' : text == "blank" ? ' ' : text[0]; };
  if (!o.delimiter.empty()) mapping.dialect.delimiter = mark(o.delimiter);
  if (!o.decimal.empty()) mapping.dialect.decimal = o.decimal[0];
  if (!o.specimen.empty()) mapping.specimen = o.specimen;
  const auto over = [](const std::optional<double>& from, std::optional<double>& to) {
    if (from) to = from;
  };
  if (!o.rest_length_mm.empty()) {
    mapping.no_rest_length = o.rest_length_mm == "none";
    mapping.rest_length_mm = mapping.no_rest_length ? std::nullopt : rest_length_of(o.rest_length_mm);
    if (!mapping.no_rest_length && !mapping.rest_length_mm)
      throw CLI::ValidationError("--rest-length-mm",
                                 "\"" + o.rest_length_mm + "\" has to be a length up to 10000 mm, or none");
  }
  over(o.pressurized_rest_length_mm, mapping.pressurized_rest_length_mm);
  over(o.nominal_pressure_psi, mapping.nominal_pressure_psi);
  over(o.zero_mm, mapping.zero_mm);
  return mapping;
}

/// Asks at the terminal until `take` takes an answer. False when nobody answers any more.
bool asked(const ImportQuestion& question, Mapping& mapping) {
  std::cout << base::printable_lines(question.file) << ": " << base::printable_lines(question.question.text) << '\n';
  for (int attempt = 0; attempt < 3; ++attempt) {
    std::cout << "> " << std::flush;
    std::string answer;
    if (!std::getline(std::cin, answer)) return false;
    if (question.question.take(answer, mapping)) return true;
    std::cout << "that is none of them\n";
  }
  return false;
}

/// Answers whatever is not clear, at a terminal; says what would have to be said elsewhere. Empty when it stays
/// unclear.
std::optional<ImportPlan> settled(const std::vector<std::string>& files, Mapping& mapping,
                                  const std::vector<NamedColumn>& named) {
  const bool someone = someone_is_there();
  std::vector<ImportFile> read;
  for (const auto& file : files) read.push_back(read_import_file(file, mapping.dialect));
  for (const auto& note : check_named_columns(read, named))
    std::printf("note: %s\n", base::printable_lines(note).c_str());
  while (true) {
    ImportPlan plan = understand_files(read, mapping);
    if (plan.questions.empty()) return plan;
    if (!someone) {
      for (const auto& q : plan.questions)
        std::cerr << base::printable_lines(q.file + ": " + q.question.text)
                  << "\n  say it: " << base::printable_lines(q.question.answer) << '\n';
      return std::nullopt;
    }
    if (!asked(plan.questions.front(), mapping)) {
      std::cerr << "isorig import: not answered; nothing was written\n";
      return std::nullopt;
    }
  }
}

int import_files(const Options& o) {
  std::vector<NamedColumn> named;
  Mapping mapping = told(o, named);
  try {
    const auto plan = settled(o.files, mapping, named);
    if (!plan) return kBadInput;
    const auto made = make_recordings(
        *plan, mapping, {.out = o.out, .one_clock = o.one_clock, .as_stated = o.as_stated, .replace = o.replace});
    for (const auto& line : made.said) std::printf("%s\n", base::printable_lines(line).c_str());
    identify::report::write_text_file(std::filesystem::path(o.out) / "mapping.toml", foreign::mapping_text(mapping));
    std::printf("what was asked and told is in %s: --mapping uses it again\n",
                (std::filesystem::path(o.out) / "mapping.toml").c_str());
    return kOk;
  } catch (const messages::RecordingError& e) {
    std::cerr << e.what() << '\n';
  } catch (const ImportRefused& e) {
    std::cerr << base::printable_lines(e.what()) << '\n';
  }
  return kBadInput;
}

Command add_import(CLI::App& app) {
  auto o = std::make_shared<Options>();
  auto* sub = app.add_subcommand(
      "import", "Make recordings of other programs' files: Bluehill CSV, a microcontroller's log, any table");
  sub->add_option("FILE", o->files,
                  "Text files with tables; a frame's and a pressure log's together are put on one clock")
      ->required();
  sub->add_option("--out", o->out, "Folder of the recording; of several tests, folders in it")->required();
  sub->add_option("--mapping", o->mapping, "What was told or asked before: mapping.toml of an earlier import");
  sub->add_option("--column", o->column, "time|position|force|pressure=NAME of a column, or =#2 for the second")
      ->allow_extra_args(false);
  sub->add_option("--unit", o->unit, "COLUMN=UNIT where the file does not say it: ms, mm, m, in, N, lbf, psi, kPa, ...")
      ->allow_extra_args(false);
  sub->add_option("--positive", o->positive, "position|force=compression where that is positive in the file")
      ->allow_extra_args(false);
  sub->add_option("--specimen", o->specimen, "Name of the specimen");
  sub->add_option("--rest-length-mm", o->rest_length_mm,
                  "Its length without pressure and load; none where there is none (then there are no strains)");
  sub->add_option("--pressurized-rest-length-mm", o->pressurized_rest_length_mm,
                  "Its length under pressure without load, of a McKibben")
      ->check(CLI::Range(1e-3, 1e4));
  sub->add_option("--nominal-pressure-psi", o->nominal_pressure_psi, "The pressure that was set, gauge")
      ->check(CLI::Range(-1e3, 1e3));
  sub->add_option("--zero-mm", o->zero_mm, "Position, from the unpressurized rest length, that the file calls zero")
      ->check(CLI::Range(-1e4, 1e4));
  sub->add_option("--delimiter", o->delimiter, "Between columns, where it is not plain")
      ->check(CLI::IsMember({";", ",", "tab", "blank"}));
  sub->add_option("--decimal", o->decimal, "Mark of the decimals, where it is not plain")
      ->check(CLI::IsMember({".", ","}));
  sub->add_flag("--one-clock", o->one_clock,
                "Both files count from the same moment; they are not aligned by their strokes");
  sub->add_flag("--as-stated", o->as_stated, "The numbers are as the units say, however odd they look");
  sub->add_flag("--replace", o->replace, "Replace recordings that are there already");
  return {sub, [o] { return import_files(*o); }};
}

const Registration kImport(30, add_import);

}  // namespace
}  // namespace isorig::cli
