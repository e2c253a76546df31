#include "messages/foreign/column_names.hpp"

#include <algorithm>
#include <span>

namespace isorig::foreign {
namespace {

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
    {"length", Field::kPosition, Sure::kWholeSpecimen},
    {"l\xC3\xA4nge", Field::kPosition, Sure::kWholeSpecimen},
    {"longueur", Field::kPosition, Sure::kWholeSpecimen},
    {"longitud", Field::kPosition, Sure::kWholeSpecimen},
    {"lunghezza", Field::kPosition, Sure::kWholeSpecimen},
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
/// In a name they make of it what a machine is told, or something of the machine's own. The first wherever they stand,
/// the others as words of their own: "settled load" and "zeroed force" are measured.
constexpr std::string_view kNotMeasured[] = {"setpoint", "set-point", "set point", "command",  "target",  "demand",
                                             "limit",    "offset",    "supply",    "sollwert", "consigne"};
constexpr std::string_view kNotMeasuredWords[] = {"set", "cmd", "sp", "zero", "error", "tank", "soll"};
/// Which makes a length that of the specimen before the test: the same in every row.
constexpr std::string_view kUnloaded[] = {"rest",    "gauge",  "gage",     "initial", "original", "free",
                                          "nominal", "mess",   "ruhe",     "anfangs", "ausgangs", "repos",
                                          "reposo",  "riposo", "iniziale", "inicial"};
/// A pressure above vacuum: "Absolute", "absolu", "assoluta"; "abs" as a word of its own.
constexpr std::string_view kAbsolute[] = {"absolu", "assolut"};
constexpr std::string_view kCompressive[] = {"compress", "druckkraft", "stauchung"};

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

bool has_word(const std::string& name, std::string_view word) {
  for (auto at = name.find(word); at != std::string::npos; at = name.find(word, at + 1)) {
    const auto end = at + word.size();
    if ((at == 0 || !is_letter(name[at - 1])) && (end == name.size() || !is_letter(name[end]))) return true;
  }
  return false;
}

/// Without the unit at its end: "weg_mm".
std::string stem(const std::string& name) {
  const auto at = name.rfind('_');
  return at != std::string::npos && at > 0 && find_unit(name.substr(at + 1)) ? name.substr(0, at) : name;
}

}  // namespace

std::string small(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return out;
}

bool is_other(const std::string& column) {
  const std::string name = small(column);
  return has_any(name, kOthersInside) ||
         std::ranges::any_of(kOthers, [&](auto word) { return begins_word(name, word); });
}

bool is_not_measured(const std::string& column) {
  const std::string name = small(column);
  return has_any(name, kNotMeasured) ||
         std::ranges::any_of(kNotMeasuredWords, [&](auto word) { return has_word(name, word); });
}

bool is_absolute(const Column& column) {
  for (const std::string& text : {small(column.name), small(column.unit)})
    if (has_any(text, kAbsolute) || has_word(text, "abs")) return true;
  if (!column.unit.ends_with('a')) return false;
  const auto gauge = find_unit(std::string_view(column.unit).substr(0, column.unit.size() - 1));
  return gauge && gauge->field == Field::kPressure;
}

std::optional<Word> named(const std::string& column) {
  const std::string name = small(column), bare = small(stem(column));
  if (name.find("druckkraft") != std::string::npos) return Word{"druckkraft", Field::kForce};
  // "Standardkraft" ends with its word, "Load (Filtered)" begins with it; "elastic" only has the German "Last" inside.
  for (const Word& word : kWords) {
    if (word.sure == Sure::kWholeSpecimen && has_any(name, kUnloaded)) continue;
    if (name == word.text || bare == word.text) return word;
    if (word.text.size() < 4) continue;
    const auto at = name.find(word.text);
    if (at == std::string::npos) continue;
    if (at == 0 || bare.ends_with(word.text) || !is_letter(name[at - 1])) return word;
  }
  if (bare.ends_with("weg")) return Word{"weg", Field::kPosition};
  return name.starts_with("t_") && name.size() <= 4 ? std::optional(Word{"t_", Field::kTime}) : std::nullopt;
}

bool says_compressive(const std::string& column) {
  return has_any(small(column), kCompressive);
}

}  // namespace isorig::foreign
