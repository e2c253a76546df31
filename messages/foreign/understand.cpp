#include <algorithm>
#include <cmath>
#include <set>
#include <span>
#include <utility>

#include "base/printable.hpp"
#include "messages/foreign/mapping.hpp"

namespace isorig::foreign {
namespace {

/// How sure a name is. What may mean something else too counts where no other column is meant.
enum class Sure { kYes, kUnlessAnother, kWholeLength };

/// Words that a column's name has, in small letters; ASCII only is made small.
struct Word {
  std::string_view text;
  Field field;
  Sure sure = Sure::kYes;
};
constexpr Word kWords[] = {
    {"time", Field::kTime},
    {"zeit", Field::kTime},
    {"temps", Field::kTime},
    {"tiempo", Field::kTime},
    {"tempo", Field::kTime},
    {"t_s", Field::kTime},
    {"millis", Field::kTime},
    {"micros", Field::kTime},
    {"extension", Field::kPosition},
    {"displacement", Field::kPosition},
    {"position", Field::kPosition},
    {"crosshead", Field::kPosition},
    {"weg", Field::kPosition},
    {"verl\xC3\xA4ngerung", Field::kPosition},
    {"d\xC3\xA9placement", Field::kPosition},
    {"allongement", Field::kPosition},
    {"extensi\xC3\xB3n", Field::kPosition},
    {"desplazamiento", Field::kPosition},
    {"spostamento", Field::kPosition},
    {"estensione", Field::kPosition},
    {"elongation", Field::kPosition, Sure::kUnlessAnother},
    {"stroke", Field::kPosition, Sure::kUnlessAnother},
    {"travel", Field::kPosition, Sure::kUnlessAnother},
    {"deflection", Field::kPosition, Sure::kUnlessAnother},
    {"hub", Field::kPosition, Sure::kUnlessAnother},
    {"traverse", Field::kPosition, Sure::kUnlessAnother},
    {"auslenkung", Field::kPosition, Sure::kUnlessAnother},
    {"l\xC3\xA4ngen\xC3\xA4nderung", Field::kPosition, Sure::kUnlessAnother},
    {"course", Field::kPosition, Sure::kUnlessAnother},
    {"carrera", Field::kPosition, Sure::kUnlessAnother},
    {"alargamiento", Field::kPosition, Sure::kUnlessAnother},
    {"corsa", Field::kPosition, Sure::kUnlessAnother},
    {"allungamento", Field::kPosition, Sure::kUnlessAnother},
    {"length", Field::kPosition, Sure::kWholeLength},
    {"l\xC3\xA4nge", Field::kPosition, Sure::kWholeLength},
    {"longueur", Field::kPosition, Sure::kWholeLength},
    {"longitud", Field::kPosition, Sure::kWholeLength},
    {"lunghezza", Field::kPosition, Sure::kWholeLength},
    {"load", Field::kForce},
    {"force", Field::kForce},
    {"kraft", Field::kForce},
    {"last", Field::kForce},
    {"charge", Field::kForce},
    {"carga", Field::kForce},
    {"fuerza", Field::kForce},
    {"forza", Field::kForce},
    {"carico", Field::kForce},
    {"pressure", Field::kPressure},
    {"druck", Field::kPressure},
    {"pression", Field::kPressure},
    {"presi\xC3\xB3n", Field::kPressure},
    {"pressione", Field::kPressure},
    {"psi", Field::kPressure},
};
/// What has the unit of a field and is none, where such a word begins; the German ones in compounds too.
constexpr std::string_view kOthers[] = {"stress",    "contrainte",    "strain",    "esfuerzo", "sforzo",
                                        "modulus",   "rate",          "velocity",  "speed",    "width",
                                        "thickness", "elapsed cycle", "wavelength"};
constexpr std::string_view kOthersInside[] = {"spannung", "dehnung"};
/// Which makes a length that of the specimen before the test: the same in every row.
constexpr std::string_view kUnloaded[] = {"rest",    "gauge",  "gage",     "initial", "original", "free",
                                          "nominal", "mess",   "ruhe",     "anfangs", "ausgangs", "repos",
                                          "reposo",  "riposo", "iniziale", "inicial"};
/// A pressure above vacuum: "Absolute", "absolu", "assoluta"; "abs" as a word of its own.
constexpr std::string_view kAbsolute[] = {"absolu", "assolut"};
/// "Compressive load": counts compression as positive.
constexpr std::string_view kCompressive[] = {"compress", "druckkraft", "stauchung"};

std::string small(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return out;
}

bool has_any(const std::string& name, std::span<const std::string_view> words) {
  return std::ranges::any_of(words, [&](auto word) { return name.find(word) != std::string::npos; });
}

bool is_letter(char c) {
  return (c >= 'a' && c <= 'z') || static_cast<unsigned char>(c) >= 0x80;
}

bool begins_word(const std::string& name, std::string_view word) {
  for (auto at = name.find(word); at != std::string::npos; at = name.find(word, at + 1))
    if (at == 0 || !is_letter(name[at - 1])) return true;
  return false;
}

/// "calibrated" has no rate in it, "Druckspannung" a stress.
bool is_other(const std::string& name) {
  return has_any(name, kOthersInside) ||
         std::ranges::any_of(kOthers, [&](auto word) { return begins_word(name, word); });
}

/// By the column's name or its unit: "Absolute pressure", "p_abs", "bar abs", "psia". A recording has gauge pressure.
bool is_absolute(const Column& column) {
  for (const std::string& text : {small(column.name), small(column.unit)}) {
    if (has_any(text, kAbsolute)) return true;
    for (auto at = text.find("abs"); at != std::string::npos; at = text.find("abs", at + 1))
      if ((at == 0 || !is_letter(text[at - 1])) && (at + 3 == text.size() || !is_letter(text[at + 3]))) return true;
  }
  if (!column.unit.ends_with('a')) return false;
  const auto gauge = find_unit(std::string_view(column.unit).substr(0, column.unit.size() - 1));
  return gauge && gauge->field == Field::kPressure;
}

/// Without the unit at its end: "weg_mm".
std::string stem(const std::string& name) {
  const auto at = name.rfind('_');
  return at != std::string::npos && at > 0 && find_unit(name.substr(at + 1)) ? name.substr(0, at) : name;
}

std::optional<Word> named(const std::string& column) {
  const std::string name = small(column), bare = small(stem(column));
  if (name.find("druckkraft") != std::string::npos) return Word{"druckkraft", Field::kForce};
  // "Standardkraft" ends with its word, "Load (Filtered)" begins with it; "elastic" only has the German "Last" inside.
  for (const Word& word : kWords) {
    if (word.sure == Sure::kWholeLength && has_any(name, kUnloaded)) continue;
    if (name == word.text || bare == word.text) return word;
    if (word.text.size() < 4) continue;
    const auto at = name.find(word.text);
    if (at == std::string::npos) continue;
    if (at == 0 || bare.ends_with(word.text) || !is_letter(name[at - 1])) return word;
  }
  if (bare.ends_with("weg")) return Word{"weg", Field::kPosition};
  return name.starts_with("t_") && name.size() <= 4 ? std::optional(Word{"t_", Field::kTime}) : std::nullopt;
}

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
  return {text, "--column " + name + "=" + (among.empty() ? "NAME" : "'" + key_of(table, among.front()) + "'"),
          [table = Table{table.line, table.columns, {}}, field](std::string_view answer, Mapping& mapping) {
            if (!column_called(table, answer)) return false;
            mapping.column[field] = answer;
            return true;
          }};
}

Question ask_unit(const Table& table, Field field, std::size_t column, const std::string& stated) {
  const std::string key = key_of(table, column);
  const std::string what = stated.empty() ? " has no unit"
                                          : " is in \"" + base::printable(stated) + "\", which is no unit of a " +
                                                std::string(name_of(field));
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
  Understood found;
  std::map<Field, std::vector<std::size_t>> candidates;
  std::vector<std::size_t> absolute, in_counts, less_sure, whole_length;
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    const std::string name = small(table.columns[c].name);
    if (is_other(name)) continue;
    const auto word = named(table.columns[c].name);
    const bool pressure = word && word->field == Field::kPressure;
    if (pressure && is_absolute(table.columns[c])) {
      absolute.push_back(c);
      continue;
    }
    const std::string text = unit_text(table, mapping, c);
    const auto unit = find_unit(text);
    // A unit of something else says that the name is not meant so: "Extension (%)".
    if (word && (unit ? unit->field == word->field : text.empty()))
      (word->sure == Sure::kYes             ? candidates[word->field]
       : word->sure == Sure::kUnlessAnother ? less_sure
                                            : whole_length)
          .push_back(c);
    if (pressure && small(text) == "counts") in_counts.push_back(c);
  }
  // Of which sensor they are only a person knows; left out without a question the pressure would be lost.
  if (candidates[Field::kPressure].empty()) candidates[Field::kPressure] = in_counts;
  for (const auto* others : {&less_sure, &whole_length})
    if (candidates[Field::kPosition].empty()) candidates[Field::kPosition] = *others;
  const bool bare = std::ranges::all_of(table.columns, [](const Column& c) { return c.name.empty(); });
  std::set<Field> open;
  std::set<std::size_t> taken;
  const auto ask = [&](Field field, Question question) {
    open.insert(field);
    found.questions.push_back(std::move(question));
  };
  const auto known = [&](Field field) {
    return open.contains(field) || std::ranges::find(found.sources, field, &Source::field) != found.sources.end();
  };
  for (const Field field : kFields) {
    // A pressure answers to a position, and to no force.
    if (field == Field::kForce && mapping.output == messages::Output::kPressure && !known(Field::kPosition)) continue;
    std::optional<std::size_t> column;
    // A column that is not in this table is of another file.
    if (const auto told = mapping.column.find(field); told != mapping.column.end())
      column = column_called(table, told->second);
    if (!column && candidates[field].size() == 1) column = candidates[field].front();
    if (!column && candidates[field].size() > 1) ask(field, ask_column(table, field, candidates[field], {}));
    if (field == Field::kPressure) {
      if (!column && candidates[field].empty() && !absolute.empty()) column = absolute.front();
      if (column && is_absolute(table.columns[*column])) {
        found.refusal = "column " + shown(table, *column) +
                        " is absolute, and a recording has gauge pressure: take the atmospheric pressure off the "
                        "column and name it so, or name another with --column pressure=NAME";
        continue;
      }
    }
    if (!column) continue;
    taken.insert(*column);
    const std::string text = unit_text(table, mapping, *column);
    const auto unit = find_unit(text);
    if (!unit || unit->field != field) {
      ask(field, ask_unit(table, field, *column, text));
      continue;
    }
    Source source{field, *column, *unit};
    if (field == Field::kPosition || field == Field::kForce) {
      const bool by_name = has_any(small(table.columns[*column].name), kCompressive);
      const auto told = mapping.compression_positive.find(field);
      const bool compression = told == mapping.compression_positive.end() ? by_name : told->second;
      source.sign = compression ? -1.0 : 1.0;
      if (by_name && told == mapping.compression_positive.end())
        found.notes.push_back("column " + shown(table, *column) + " counts compression as positive, by its name: the " +
                              std::string(name_of(field)) + " is turned round (--positive " +
                              std::string(name_of(field)) + "=tension if not)");
    }
    const auto word = named(table.columns[*column].name);
    if (field == Field::kPosition && word && word->sure == Sure::kWholeLength) found.whole_length = *column;
    found.sources.push_back(source);
  }
  found.timed = known(Field::kTime);
  const bool position = known(Field::kPosition), force = known(Field::kForce), pressure = known(Field::kPressure);
  if (!bare && !position && !force && !found.timed && !pressure) return found;
  if (!found.timed) ask(Field::kTime, ask_column(table, Field::kTime, {}, taken));
  if (force && !position) {
    ask(Field::kPosition, ask_column(table, Field::kPosition, {}, taken));
  } else if (position && !force) {
    if (!mapping.output)
      ask(Field::kForce, ask_force_or_output(table, taken, pressure));
    else if (mapping.output == messages::Output::kForce)
      ask(Field::kForce, ask_column(table, Field::kForce, {}, taken));
    else if (found.loaded = true; !mapping.load_N)
      ask(Field::kForce, ask_load());
  } else if (bare && !position && !pressure) {
    const bool moves = mapping.output == messages::Output::kPosition;
    ask(moves ? Field::kPosition : Field::kPressure,
        ask_column(table, moves ? Field::kPosition : Field::kPressure, {}, taken));
  }
  found.framed = known(Field::kPosition) || known(Field::kForce);
  found.gauged = known(Field::kPressure);
  return found;
}

}  // namespace isorig::foreign
