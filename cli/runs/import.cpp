#include <signal.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>

#include "base/lock_file.hpp"
#include "base/number_text.hpp"
#include "base/printable.hpp"
#include "base/toml_reader.hpp"
#include "base/whole_file.hpp"
#include "cli/command.hpp"
#include "cli/rig/acts.hpp"
#include "cli/runs/import_files.hpp"
#include "cli/screen/progress.hpp"
#include "identify/report/page.hpp"

/// isorig import: files of other programs become recordings; what they do not say is asked, and remembered.
namespace isorig::cli {
namespace {

using foreign::Field;
using foreign::Mapping;

struct ImportCommandOptions {
  std::vector<std::string> files, column, unit, positive;
  std::string out, mapping, delimiter, decimal, specimen;
  std::string rest_length_mm, zero_mm;
  std::optional<double> pressurized_rest_length_mm, nominal_pressure_psi, load_N, load_kg;
  std::string output;
  bool one_clock = false, as_stated = false, replace = false;
};

/// "NAME=VALUE", at the last "=": names of columns may have some.
std::pair<std::string, std::string> halves(const std::string& text, const char* option) {
  const auto at = text.rfind('=');
  if (at == std::string::npos || at == 0 || at + 1 == text.size())
    throw CLI::ValidationError(option, "\"" + text + "\" has to be NAME=VALUE");
  return {text.substr(0, at), text.substr(at + 1)};
}

/// What no column of a file says, by the option that says it.
struct Fact {
  std::string_view option;
  std::optional<std::string> (*text)(const Mapping&);  ///< for people; nothing where it was not told
};

std::optional<std::string> quantity(const char* name, const std::optional<double>& value, const char* unit) {
  if (!value) return std::nullopt;
  return std::string(name) + ' ' + base::exact_number_text(*value) + ' ' + unit;
}

constexpr Fact kFacts[] = {
    {"--output",
     [](const Mapping& m) {
       return m.output ? std::optional("output " + std::string(messages::name_of(*m.output))) : std::nullopt;
     }},
    {"--load-N", [](const Mapping& m) { return quantity("load", m.load_N, "N"); }},
    {"--specimen",
     [](const Mapping& m) { return m.specimen ? std::optional("specimen " + *m.specimen) : std::nullopt; }},
    {"--rest-length-mm",
     [](const Mapping& m) {
       return m.no_rest_length ? std::optional<std::string>("no rest length")
                               : quantity("rest length", m.rest_length_mm, "mm");
     }},
    {"--pressurized-rest-length-mm",
     [](const Mapping& m) { return quantity("pressurized rest length", m.pressurized_rest_length_mm, "mm"); }},
    {"--nominal-pressure-psi",
     [](const Mapping& m) { return quantity("nominal pressure", m.nominal_pressure_psi, "psi"); }},
    {"--zero-mm",
     [](const Mapping& m) {
       return m.whole_length ? std::optional<std::string>("position by the whole length")
                             : quantity("zero of the position at", m.zero_mm, "mm");
     }},
};

/// What is known besides the files themselves, and from where.
struct Told {
  Mapping mapping;
  std::vector<NamedColumn> named;                 ///< every column that the mapping or an option names
  std::map<std::string_view, std::string> where;  ///< of each fact, by its option

  /// Facts that are known now and were not before are from here.
  void facts_are_from(const std::string& place) {
    for (const Fact& fact : kFacts)
      if (fact.text(mapping)) where.emplace(fact.option, place);
  }
  /// A mapping may be of another specimen, whose length and zero would go unseen into the next recording.
  [[nodiscard]] std::vector<std::string> lines(bool framed) const {
    std::vector<std::string> out;
    for (const Fact& fact : kFacts)
      if (const auto text = fact.text(mapping)) out.push_back(*text + " (" + where.at(fact.option) + ")");
    if (framed && !mapping.zero_is_told())
      out.emplace_back("zero of the position at the unpressurized rest length (not told otherwise)");
    return out;
  }
};

/// A mapping file, and over it what the command line says.
Told told_by(const ImportCommandOptions& o) {
  Told told;
  auto& [mapping, named, where] = told;
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
  const auto by_option = [&told](std::string_view option, bool given) {
    if (given) told.where.emplace(option, option);
  };
  by_option("--output", !o.output.empty());
  by_option("--load-N", o.load_N.has_value());
  if (o.load_kg) told.where.emplace("--load-N", "--load-kg " + base::exact_number_text(*o.load_kg));
  by_option("--specimen", !o.specimen.empty());
  by_option("--rest-length-mm", !o.rest_length_mm.empty());
  by_option("--pressurized-rest-length-mm", o.pressurized_rest_length_mm.has_value());
  by_option("--nominal-pressure-psi", o.nominal_pressure_psi.has_value());
  by_option("--zero-mm", !o.zero_mm.empty());
  if (!o.rest_length_mm.empty()) {
    mapping.no_rest_length = o.rest_length_mm == "none";
    mapping.rest_length_mm = mapping.no_rest_length ? std::nullopt : rest_length_of(o.rest_length_mm);
    if (!mapping.no_rest_length && !mapping.rest_length_mm)
      throw CLI::ValidationError("--rest-length-mm",
                                 "\"" + o.rest_length_mm + "\" has to be a length up to 10000 mm, or none");
  }
  over(o.pressurized_rest_length_mm, mapping.pressurized_rest_length_mm);
  over(o.nominal_pressure_psi, mapping.nominal_pressure_psi);
  if (!o.zero_mm.empty() && !take_zero(o.zero_mm, mapping))
    throw CLI::ValidationError("--zero-mm",
                               "\"" + o.zero_mm + "\" has to be a position within 10000 mm, or whole-length");
  if (!o.output.empty()) mapping.output = foreign::output_of(o.output);
  over(o.load_N, mapping.load_N);
  if (o.load_kg) mapping.load_N = foreign::find_unit("kgf")->factor * *o.load_kg;
  told.facts_are_from("from " + o.mapping);
  return told;
}

volatile std::sig_atomic_t import_interrupted = 0;

/// While one of these lives, Ctrl-C ends the reading of an answer and not the program, so that the answers before it
/// can be kept. Without SA_RESTART, which std::signal() sets: the read has to return.
class AnswersUntilCtrlC {
 public:
  AnswersUntilCtrlC() {
    struct sigaction action {};
    action.sa_handler = [](int) { import_interrupted = 1; };
    ::sigaction(SIGINT, &action, &former_);
  }
  ~AnswersUntilCtrlC() { ::sigaction(SIGINT, &former_, nullptr); }
  AnswersUntilCtrlC(const AnswersUntilCtrlC&) = delete;
  AnswersUntilCtrlC& operator=(const AnswersUntilCtrlC&) = delete;

 private:
  struct sigaction former_ {};
};

/// Asks at the terminal until `take` takes an answer. False when nobody answers any more.
bool asked(const ImportQuestion& question, Mapping& mapping) {
  std::cout << base::printable_lines(question.file) << ": " << base::printable_lines(question.question.text) << '\n';
  for (int attempt = 0; attempt < 3; ++attempt) {
    std::cout << "> " << std::flush;
    std::string answer;
    if (import_interrupted != 0 || !std::getline(std::cin, answer)) return false;
    if (question.question.take(answer, mapping)) return true;
    std::cout << "that is none of them\n";
  }
  return false;
}

/// Answers whatever is not clear, at a terminal, and counts the answers; says what would have to be said elsewhere.
/// Empty when it stays unclear.
std::optional<ImportPlan> settled(const std::vector<std::string>& files, Told& told, std::size_t& answers) {
  const bool someone = someone_is_there();
  std::vector<ImportFile> read;
  {
    FilesProgress progress("import, reading", {files.begin(), files.end()});
    for (std::size_t i = 0; i < files.size(); ++i) {
      progress.at(i, 0.0, files[i]);
      read.push_back(read_import_file(files[i], told.mapping.dialect));
    }
  }
  for (const auto& note : check_named_columns(read, told.named))
    std::printf("note: %s\n", base::printable_lines(note).c_str());
  const AnswersUntilCtrlC until;
  while (true) {
    ImportPlan plan = understand_files(read, told.mapping);
    if (import_interrupted == 0 && plan.questions.empty()) return plan;
    if (!someone) {
      for (const auto& q : plan.questions)
        std::cerr << base::printable_lines(q.file + ": " + q.question.text)
                  << "\n  say it: " << base::printable_lines(q.question.answer) << '\n';
      return std::nullopt;
    }
    if (!asked(plan.questions.front(), told.mapping)) {
      std::cerr << (import_interrupted != 0 ? "\nisorig import: interrupted; no recording was made\n"
                                            : "isorig import: not answered; no recording was made\n");
      return std::nullopt;
    }
    ++answers;
    told.facts_are_from("answered");
  }
}

/// As a shell takes it for one word.
std::string one_word(std::string_view text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

/// Of an import that was not made: nobody has to give the answers again.
void keep_answers(const ImportCommandOptions& o, const Mapping& mapping) {
  const std::filesystem::path folder = o.out;
  std::error_code error;
  // A mapping that is there is of recordings that were made with it.
  const bool another = std::filesystem::exists(folder / "mapping.toml", error);
  const auto file = folder / (another ? "mapping-answers.toml" : "mapping.toml");
  const std::string text = foreign::mapping_text(mapping);
  try {
    std::filesystem::create_directories(folder);
    base::write_whole_file(file, text);
  } catch (const std::exception& e) {
    std::printf("the answers could not be kept (%s); as a mapping.toml they are:\n%s",
                base::printable_lines(e.what()).c_str(), base::printable_lines(text).c_str());
    return;
  }
  std::string again = "--mapping " + one_word(file.string());
  if (mapping.specimen) again += " --specimen " + one_word(*mapping.specimen);
  std::printf("the answers are kept; give the same command and this, and their questions are not asked again: %s\n",
              base::printable_lines(again).c_str());
}

/// Throws what read_import_file(), understand_files() and make_recordings() throw.
bool import_files(const ImportCommandOptions& o, Told& told, std::size_t& answers) {
  const auto plan = settled(o.files, told, answers);
  if (!plan) return false;
  if ((o.load_N || o.load_kg) && !plan->loaded)
    throw ImportRefused(
        "a load is told, and no force is made of it: it is for files with a position and without a column of the "
        "force, "
        "and for --output position or pressure");
  std::string facts;
  for (const auto& line : told.lines(plan->framed)) facts += (facts.empty() ? "" : ", ") + line;
  std::printf("%s\n", base::printable_lines(facts).c_str());
  const base::FolderLock alone(o.out);
  std::optional<Progress> progress(std::in_place, "import");
  const auto made =
      make_recordings(*plan, told.mapping,
                      {.out = o.out,
                       .told = told.lines(plan->framed),
                       .one_clock = o.one_clock,
                       .as_stated = o.as_stated,
                       .replace = o.replace,
                       .on_progress = [&](double done, const char* doing) { progress->at(done, doing); }});
  progress.reset();
  for (const auto& line : made.said) std::printf("%s\n", base::printable_lines(line).c_str());
  const auto mapping = std::filesystem::path(o.out) / "mapping.toml";
  base::write_whole_file(mapping, foreign::mapping_text(told.mapping));
  std::printf("what was asked and told is in %s: --mapping uses it again, for another specimen too\n", mapping.c_str());
  return true;
}

int import_or_refuse(const ImportCommandOptions& o) {
  Told told = told_by(o);
  std::size_t answers = 0;
  try {
    if (import_files(o, told, answers)) return kOk;
  } catch (const messages::RecordingError& e) {
    std::cerr << e.what() << '\n';
  } catch (const ImportRefused& e) {
    std::cerr << base::printable_lines(e.what()) << '\n';
  } catch (...) {
    if (answers > 0) keep_answers(o, told.mapping);
    throw;
  }
  if (answers > 0) keep_answers(o, told.mapping);
  if (import_interrupted != 0) {
    std::fflush(stdout);
    std::raise(SIGINT);  // a shell's loop over files ends with it
  }
  return kBadInput;
}

Command add_import(CLI::App& app) {
  auto o = std::make_shared<ImportCommandOptions>();
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
  sub->add_option("--output", o->output,
                  "What a model is to predict; asked where no column is the force. The pressure needs no frame's file")
      ->check(CLI::IsMember({"force", "position", "pressure"}));
  auto* load = sub->add_option("--load-N", o->load_N,
                               "Constant load where no column is the force, tension positive (position, pressure)");
  load->check(within(-foreign::kMostLoad_N, foreign::kMostLoad_N));
  sub->add_option("--load-kg", o->load_kg, "The same as a mass under standard gravity, 9.80665 m/s2")
      ->check(within(-1e5, 1e5))
      ->excludes(load);
  sub->add_option("--specimen", o->specimen, "Name of the specimen");
  sub->add_option("--rest-length-mm", o->rest_length_mm,
                  "Its length without pressure and load; none where there is none (then there are no strains)");
  sub->add_option("--pressurized-rest-length-mm", o->pressurized_rest_length_mm,
                  "Its length under pressure without load, of a McKibben")
      ->check(within(1e-3, 1e4));
  sub->add_option("--nominal-pressure-psi", o->nominal_pressure_psi, "The pressure that was set, gauge")
      ->check(within(-1e3, 1e3));
  sub->add_option(
      "--zero-mm", o->zero_mm,
      "Position, from the unpressurized rest length, that the file calls zero; whole-length where its column "
      "is the length of the whole specimen");
  sub->add_option("--delimiter", o->delimiter, "Between columns, where it is not plain")
      ->check(CLI::IsMember({";", ",", "tab", "blank"}));
  sub->add_option("--decimal", o->decimal, "Mark of the decimals, where it is not plain")
      ->check(CLI::IsMember({".", ","}));
  sub->add_flag("--one-clock", o->one_clock,
                "Both files count from the same moment; they are not aligned by their strokes");
  sub->add_flag("--as-stated", o->as_stated, "The numbers are as the units say, however odd they look");
  sub->add_flag("--replace", o->replace, "Replace recordings that are there already");
  return {sub, [o] { return import_or_refuse(*o); }};
}

const Registration kImport(36, add_import);

}  // namespace
}  // namespace isorig::cli
