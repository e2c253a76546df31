#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "base/printable.hpp"
#include "messages/foreign/column_names.hpp"
#include "messages/foreign/mapping.hpp"

namespace isorig::foreign {
namespace {

std::string key_of(const Table& table, std::size_t column) {
  const auto& name = table.columns[column].name;
  const bool once = std::ranges::count(table.columns, name, &Column::name) == 1;
  return name.empty() || !once ? "#" + std::to_string(column + 1) : name;
}

std::optional<std::size_t> column_called(const Table& table, std::string_view key) {
  for (std::size_t c = 0; c < table.columns.size(); ++c)
    if (key_of(table, c) == key) return c;
  return std::nullopt;
}

/// As the mapping has it, else the file: the units row or brackets, else the end of the name ("force_N").
std::string unit_text(const Table& table, const Mapping& mapping, std::size_t column) {
  if (const auto told = mapping.unit.find(key_of(table, column)); told != mapping.unit.end()) return told->second;
  const Column& c = table.columns[column];
  if (!c.unit.empty()) return c.unit;
  const auto at = c.name.rfind('_');
  if (at == std::string::npos || !find_unit(c.name.substr(at + 1))) return {};
  return c.name.substr(at + 1);
}

/// A time of day says its unit by its form.
bool is_clock(const Table& table, std::size_t column) {
  return !table.rows.empty() && clock_s(table.rows.front().cells[column]).has_value();
}

Question ask_column(const Table& table, Field field, const std::vector<std::size_t>& candidates,
                    const std::set<std::size_t>& taken) {
  const std::string name(name_of(field));
  std::string text = candidates.empty() ? "no column is known to be the " + name + "; which is it:"
                                        : "which column is the " + name + ":";
  std::vector<std::size_t> among = candidates;
  if (among.empty())
    for (std::size_t c = 0; c < table.columns.size(); ++c)
      if (!taken.contains(c)) among.push_back(c);
  for (std::size_t k = 0; k < among.size(); ++k) text += (k == 0 ? " " : ", ") + shown(table, among[k]);
  // Of names that nothing is known of none is proposed.
  const bool named = std::ranges::any_of(table.columns, [](const Column& c) { return !c.name.empty(); });
  const bool proposed = !among.empty() && (among.size() == 1 || !candidates.empty() || !named);
  return {text, "--column " + name + "=" + (proposed ? "'" + key_of(table, among.front()) + "'" : "NAME"),
          [table = Table{table.line, table.columns, {}}, field](std::string_view answer, Mapping& mapping) {
            if (!column_called(table, answer)) return false;
            mapping.column[field] = answer;
            return true;
          }};
}

Question ask_unit(const Table& table, Field field, std::size_t column, const std::string& stated) {
  const std::string key = key_of(table, column);
  std::string what = stated.empty() ? " has no unit"
                                    : " is in \"" + base::printable(stated) + "\", which is no unit of a " +
                                          std::string(name_of(field));
  if (const Column& c = table.columns[column]; c.unit_line > 0 && stated == c.unit)
    what += " (line " + std::to_string(c.unit_line) + ", column " + std::to_string(column + 1) + ")";
  return {"column " + shown(table, column) + what + "; in which unit is the " + std::string(name_of(field)) + ": " +
              units_of(field),
          "--unit '" + key + "=" + std::string(unit_of(field)) + "'",
          [key, field](std::string_view answer, Mapping& mapping) {
            const auto unit = find_unit(answer);
            if (!unit || unit->field != field) return false;
            mapping.unit[key] = answer;
            return true;
          }};
}

/// Without a column of the force either one has a name that says nothing, or the force is no output.
Question ask_force_or_output(const Table& table, const std::set<std::size_t>& taken, bool pressure) {
  Question question = ask_column(table, Field::kForce, {}, taken);
  const std::string outputs = std::string("position (under a constant load)") + (pressure ? " or pressure" : "");
  question.text = taken.size() < table.columns.size()
                      ? question.text + "; or, if none is, what is a model to predict: " + outputs
                      : "no column is left to be the force; what is a model to predict: " + outputs;
  question.answer += ", or --output position" + std::string(pressure ? ", or --output pressure" : "");
  question.take = [column = question.take, pressure](std::string_view answer, Mapping& mapping) {
    const auto output = output_of(answer);
    const bool known = output == messages::Output::kPosition || (output == messages::Output::kPressure && pressure);
    if (!known) return column(answer, mapping);
    mapping.output = output;
    return true;
  };
  return question;
}

Question ask_load() {
  return {
      "no column is the force: which constant load pulls the specimen longer, in N or as a mass (0.98 N, 100 g; 0 "
      "where none does)?",
      "--load-N F, or --load-kg M",
      [](std::string_view answer, Mapping& mapping) { return take_load(answer, mapping); }};
}

/// Columns by what their names and units say they are.
struct Candidates {
  std::map<Field, std::vector<std::size_t>> of;
  std::vector<std::size_t> absolute_pressure;
  std::map<Field, std::vector<std::size_t>> not_measured;  ///< named as the field, and as what is told to a machine
};

/// Of a signal that a person has to turn into the quantity, and who asks for its unit gets no answer.
bool is_electrical(std::string_view unit) {
  return unit == "V" || unit == "mV" || unit == "mA" || unit == "A" || unit == "%";
}

/// Whether what is in a unit that is not known ("klbf", "Newton", "kgf/cm2") may be the field all the same. But of a
/// pressure a quotient says that the name is not meant so ("mm/mm"), as do an angle and a time of day.
bool may_be_of(Field field, const std::string& unit) {
  if (is_electrical(unit)) return false;
  if (field == Field::kPressure) return true;
  const std::string text = small(unit);
  return text.find_first_of("/:%") == std::string::npos && text.find("\xC2\xB0") == std::string::npos &&
         !text.starts_with("deg") && !text.starts_with("rad");
}

Candidates candidates_by_name(const Table& table, const Mapping& mapping) {
  Candidates found;
  std::map<Field, std::vector<std::size_t>> in_other_units;
  std::vector<std::size_t> less_sure, whole_length;
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    if (is_other(table.columns[c].name)) continue;
    const auto word = named(table.columns[c].name);
    const bool pressure = word && word->field == Field::kPressure;
    if (pressure && is_absolute(table.columns[c])) {
      found.absolute_pressure.push_back(c);
      continue;
    }
    const std::string text = unit_text(table, mapping, c);
    const auto unit = find_unit(text);
    if (word && word->field != Field::kTime && is_not_measured(table.columns[c].name)) {
      found.not_measured[word->field].push_back(c);
      continue;
    }
    // A unit of something else says that the name is not meant so: "Extension (%)".
    if (word && (unit ? unit->field == word->field : text.empty()))
      (word->sure == Sure::kYes             ? found.of[word->field]
       : word->sure == Sure::kUnlessAnother ? less_sure
                                            : whole_length)
          .push_back(c);
    if (word && word->sure == Sure::kYes && !text.empty() && !unit && may_be_of(word->field, text))
      in_other_units[word->field].push_back(c);
  }
  for (const auto* others : {&less_sure, &whole_length})
    if (found.of[Field::kPosition].empty()) found.of[Field::kPosition] = *others;
  // Counts of a sensor, "kgf/cm2": what they are only a person knows; left out without a question the column would be
  // lost.
  for (const auto& [field, columns] : in_other_units)
    if (found.of[field].empty()) found.of[field] = columns;
  return found;
}

/// What is understood so far, and what a person was asked.
class Understanding {
 public:
  Understanding(const Table& table, const Mapping& mapping)
      : table_(table), mapping_(mapping), candidates_(candidates_by_name(table, mapping)) {}

  /// The column that is the field, its unit and its sign, or a question about them.
  void assign(Field field) {
    // A pressure answers to a position, and to no force.
    if (field == Field::kForce && mapping_.output == messages::Output::kPressure && !known(Field::kPosition)) return;
    const std::optional<std::size_t> column = column_of(field);
    if (!column) return;
    if (field == Field::kPressure && is_absolute(table_.columns[*column])) {
      found_.refusal = "column " + shown(table_, *column) +
                       " is absolute, and a recording has gauge pressure: take the atmospheric pressure off the "
                       "column and name it so, or name another with --column pressure=NAME";
      return;
    }
    taken_.insert(*column);
    std::string text = unit_text(table_, mapping_, *column);
    if (field == Field::kTime && text.empty() && is_clock(table_, *column)) text = kClock;
    const auto unit = find_unit(text);
    if (!unit || unit->field != field) {
      ask(field, ask_unit(table_, field, *column, text));
      return;
    }
    Source source{field, *column, *unit};
    if (field == Field::kPosition || field == Field::kForce) source.sign = sign_of(field, *column);
    const auto word = named(table_.columns[*column].name);
    if (field == Field::kPosition && word && word->sure == Sure::kWholeSpecimen) found_.whole_length = *column;
    found_.sources.push_back(source);
  }

  /// Asks for what a recording cannot do without and no column was found to be.
  Understood with_questions() {
    found_.timed = known(Field::kTime);
    const bool bare = std::ranges::all_of(table_.columns, [](const Column& c) { return c.name.empty(); });
    const bool position = known(Field::kPosition), force = known(Field::kForce), pressure = known(Field::kPressure);
    if (!bare && !position && !force && !found_.timed && !pressure) return std::move(found_);
    if (!found_.timed) ask(Field::kTime, ask_column(table_, Field::kTime, {}, taken_));
    if (force && !position) {
      ask(Field::kPosition, ask_column(table_, Field::kPosition, {}, taken_));
    } else if (position && !force) {
      ask_what_answers(pressure);
    } else if (bare && !position && !pressure) {
      const auto field = mapping_.output == messages::Output::kPosition ? Field::kPosition : Field::kPressure;
      ask(field, ask_column(table_, field, {}, taken_));
    }
    found_.framed = known(Field::kPosition) || known(Field::kForce);
    found_.gauged = known(Field::kPressure);
    return std::move(found_);
  }

 private:
  void ask(Field field, Question question) {
    open_.insert(field);
    found_.questions.push_back(std::move(question));
  }
  [[nodiscard]] bool known(Field field) const {
    return open_.contains(field) || std::ranges::find(found_.sources, field, &Source::field) != found_.sources.end();
  }

  /// As the mapping tells, else the only candidate; of several a person is asked.
  std::optional<std::size_t> column_of(Field field) {
    // A column that is not in this table is of another file.
    if (const auto told = mapping_.column.find(field); told != mapping_.column.end())
      if (const auto column = column_called(table_, told->second)) return column;
    const auto& candidates = candidates_.of[field];
    if (candidates.size() == 1) return candidates.front();
    if (candidates.size() > 1) ask(field, ask_column(table_, field, candidates, {}));
    const auto& absolute = candidates_.absolute_pressure;
    if (field == Field::kPressure && candidates.empty() && !absolute.empty()) return absolute.front();
    if (candidates.empty()) doubt(field);
    return std::nullopt;
  }

  /// Nothing is named as the field but what is no measurement. A recording may be without pressure, and not without
  /// position and force.
  void doubt(Field field) {
    const auto doubted = candidates_.not_measured.find(field);
    if (doubted == candidates_.not_measured.end()) return;
    if (field != Field::kPressure) return ask(field, ask_column(table_, field, {}, taken_));
    for (const std::size_t column : doubted->second)
      found_.notes.push_back("column " + shown(table_, column) +
                             " is no pressure that was measured, by its name, and stays as in the file (--column "
                             "pressure='" +
                             key_of(table_, column) + "' if it is)");
  }

  /// -1 where the column counts compression as positive; noted where only its name says so.
  double sign_of(Field field, std::size_t column) {
    const bool by_name = says_compressive(table_.columns[column].name);
    if (const auto told = mapping_.compression_positive.find(field); told != mapping_.compression_positive.end())
      return told->second ? -1.0 : 1.0;
    if (!by_name) return 1.0;
    const std::string name(name_of(field));
    found_.notes.push_back("column " + shown(table_, column) + " counts compression as positive, by its name: the " +
                           name + " is turned round (--positive " + name + "=tension if not)");
    return -1.0;
  }

  /// There is a position and no force: either a column is the force after all, or the position is the output.
  void ask_what_answers(bool pressure) {
    if (!mapping_.output)
      ask(Field::kForce, ask_force_or_output(table_, taken_, pressure));
    else if (mapping_.output == messages::Output::kForce)
      ask(Field::kForce, ask_column(table_, Field::kForce, {}, taken_));
    else if (found_.loaded = true; !mapping_.load_N)
      ask(Field::kForce, ask_load());
  }

  const Table& table_;
  const Mapping& mapping_;
  Candidates candidates_;
  Understood found_;
  std::set<Field> open_;  ///< of which a question is open
  std::set<std::size_t> taken_;
};

}  // namespace

bool take_load(std::string_view text, Mapping& mapping) {
  const auto first = text.find_first_not_of(' ');
  if (first == std::string_view::npos) return false;
  text.remove_prefix(first);
  text = text.substr(0, text.find_last_not_of(' ') + 1);
  const auto digits = std::min(text.find_first_not_of("+-.0123456789"), text.size());
  std::string_view unit_name = text.substr(digits);
  unit_name.remove_prefix(std::min(unit_name.find_first_not_of(' '), unit_name.size()));
  const auto unit = find_unit(unit_name.empty() ? "N" : unit_name == "g" ? "gf" : unit_name);
  const auto value = number_of(text.substr(0, digits), '.');
  if (!value || !unit || unit->field != Field::kForce) return false;
  const double load_N = unit->factor * *value;
  if (!(std::fabs(load_N) <= kMostLoad_N)) return false;
  mapping.load_N = load_N;
  return true;
}

bool has_column(const Table& table, std::string_view key) {
  return column_called(table, key).has_value();
}

std::string shown(const Table& table, std::size_t column) {
  const Column& c = table.columns[column];
  const std::string number = "#" + std::to_string(column + 1);
  if (c.name.empty()) return number + " (no name)";
  const bool once = std::ranges::count(table.columns, c.name, &Column::name) == 1;
  return "\"" + base::printable(c.name) + "\"" + (once ? "" : " " + number) +
         (c.unit.empty() ? "" : " (" + base::printable(c.unit) + ")");
}

Understood understand(const Table& table, const Mapping& mapping) {
  Understanding understanding(table, mapping);
  for (const Field field : kFields) understanding.assign(field);
  return understanding.with_questions();
}

}  // namespace isorig::foreign
