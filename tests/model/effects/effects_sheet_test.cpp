// What an entry of the catalogue must state, and what its numbers in TOML must be.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <random>
#include <set>
#include <sstream>

#include "base/text_file.hpp"
#include "base/toml_reader.hpp"
#include "judge.hpp"
#include "model/effect_sheets.hpp"
#include "tree.hpp"

namespace isorig::test {

namespace {

class Sheet : public testing::TestWithParam<Named> {
 protected:
  const model::Physics& physics_ = *GetParam().physics;
  const model::Law& law_ = *GetParam().law;
};

bool has_unit(std::string_view name) {
  constexpr std::array units{"_s",        "_mm",      "_N",          "_psi",   "_kg",    "_mm_s",
                             "_N_mm",     "_N_h",     "_N_mm2",      "_N_mm3", "_N_mm4", "_N_mm5",
                             "_N_s_mm",   "_N_psi",   "_N_mm_psi",   "_1_kN",  "_1_mm",  "_N_s_mm2",
                             "_N_s2_mm2", "_N_s_mm3", "_N_s_mm_psi", "_deg"};
  return std::ranges::any_of(units, [&](std::string_view unit) { return name.ends_with(unit); });
}

/// Ratios, and numbers of decades or of an arm; any other name without a unit is a mistake.
bool is_a_ratio(std::string_view name) {
  constexpr std::array<std::string_view, 13> ratios{
      "exponent",     "static_excess", "decades",          "share",     "start",     "scale", "arm", "damping",
      "recording_id", "load_share",    "shortening_ratio", "sharpness", "beta_share"};
  return std::ranges::find(ratios, name) != ratios.end();
}

TEST_P(Sheet, StatesWhatItIsWhereItIsFromAndWhatRevealsIt) {
  EXPECT_GT(physics_.what.size(), 20U);
  EXPECT_TRUE(physics_.what.ends_with('.'));
  EXPECT_GE(physics_.source.size(), 7U);
  EXPECT_TRUE(physics_.source.ends_with('.'));
  EXPECT_GE(physics_.reveals.size(), 8U);
  EXPECT_TRUE(physics_.reveals.ends_with('.'));
  if (model::is_effect(physics_)) {
    EXPECT_GT(physics_.reveals.size(), 25U) << "an effect names the experiment that shows it";
  }
  EXPECT_FALSE(law_.formula.empty());
  EXPECT_NE(static_cast<bool>(law_.make), static_cast<bool>(law_.make_table)) << "one of the two makes it";
  EXPECT_EQ(model::find_physics(physics_.name), &physics_) << "two entries of one name";
  EXPECT_EQ(model::find_law(physics_, law_.name), &law_) << "two laws of one name";
}

/// `symbol` stands in `formula` by itself, not as a part of another.
bool stands_in(std::string_view formula, std::string_view symbol) {
  const auto letter = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '\'' || c == '_'; };
  for (std::size_t at = formula.find(symbol); at != std::string_view::npos; at = formula.find(symbol, at + 1)) {
    const std::size_t end = at + symbol.size();
    const bool begins = at == 0 || !letter(formula[at - 1]);
    const bool ends = end == formula.size() || !letter(formula[end]) || !letter(symbol.back());
    if (begins && ends) return true;
  }
  return false;
}

TEST_P(Sheet, EveryNumberOfAnEffectHasItsSymbolInTheEquation) {
  if (!model::is_effect(physics_)) return;
  const auto check = [&](std::string_view name, std::string_view symbol) {
    ASSERT_FALSE(symbol.empty()) << name;
    EXPECT_TRUE(stands_in(law_.formula, symbol)) << name << ": no " << symbol << " in " << law_.formula;
  };
  std::set<std::string_view> symbols;
  for (const model::Parameter& parameter : law_.parameters) {
    if (parameter.traits.filled_by == model::FilledBy::kRecordingId) continue;
    check(parameter.name, parameter.symbol);
    EXPECT_TRUE(symbols.insert(parameter.symbol).second) << parameter.symbol << " stands for two numbers";
  }
  for (const model::Coefficient& coefficient : law_.coefficients) {
    check(coefficient.name, coefficient.symbol);
    EXPECT_TRUE(symbols.insert(coefficient.symbol).second) << coefficient.symbol << " stands for two numbers";
  }
}

TEST_P(Sheet, AnEffectSaysWhereItActsAndWhatItDependsOn) {
  if (!model::is_effect(physics_)) return;
  constexpr std::array<std::string_view, 8> places{"elastic branch",  "arm",           "dashpot", "friction element",
                                                   "kinematic input", "pressure path", "mass",    "force channel"};
  constexpr std::array<std::string_view, 11> variables{"time",     "strain",  "rate",        "direction",
                                                       "pressure", "onset",   "hold",        "load",
                                                       "position", "history", "acceleration"};
  EXPECT_NE(std::ranges::find(places, physics_.traits.acts_on), places.end()) << physics_.traits.acts_on;
  EXPECT_FALSE(physics_.traits.depends_on.empty());
  for (const std::string_view variable : physics_.traits.depends_on)
    EXPECT_NE(std::ranges::find(variables, variable), variables.end()) << variable;
}

TEST_P(Sheet, EveryNumberHasAUnitBoundsAndAStart) {
  for (const model::Coefficient& coefficient : law_.coefficients)
    EXPECT_TRUE(has_unit(coefficient.name) || is_a_ratio(coefficient.name)) << coefficient.name;
  for (const model::Parameter& parameter : law_.parameters) {
    EXPECT_TRUE(has_unit(parameter.name) || is_a_ratio(parameter.name)) << parameter.name;
    EXPECT_TRUE(std::isfinite(parameter.lower) && std::isfinite(parameter.upper)) << parameter.name;
    EXPECT_LT(parameter.lower, parameter.upper) << parameter.name;
    if (parameter.logarithmic) {
      EXPECT_GT(parameter.lower, 0.0) << parameter.name;
    }
    for (const double start : parameter.starts) {
      EXPECT_GE(start, parameter.lower) << parameter.name;
      EXPECT_LE(start, parameter.upper) << parameter.name;
    }
    // What is searched must begin somewhere; the time of an event is scanned, what is given is given.
    if (!parameter.fixed && !parameter.traits.event_time) {
      EXPECT_FALSE(parameter.starts.empty()) << parameter.name;
    }
  }
}

/// The origin of a range, and a sentence on either side of it.
void expect_full(std::string_view number, const model::NumberSheet& sheet) {
  EXPECT_GE(sheet.what.size(), 15U) << number << " lacks `what`";
  EXPECT_TRUE(sheet.what.ends_with('.')) << number;
  EXPECT_FALSE(sheet.unit.empty()) << number << " lacks its unit; a ratio has \"1\"";
  EXPECT_GE(sheet.range.size(), 25U) << number << " lacks the reason of its range";
  EXPECT_TRUE(sheet.range.ends_with('.')) << number;
  constexpr std::array<std::string_view, 3> origins{"Physics: ", "Instrument: ", "Numerics: "};
  EXPECT_TRUE(std::ranges::any_of(origins, [&](std::string_view o) { return sheet.range.starts_with(o); }))
      << number << ": " << sheet.range;
  EXPECT_GE(sheet.errors.size(), 25U) << number << " lacks what makes it wrong";
  EXPECT_TRUE(sheet.errors.ends_with('.')) << number;
  // The unit is in the name as well: "N s/mm" as _N_s_mm. What is per a unit alone, 1/kN, is _1_kN.
  std::string suffix = '_' + std::string(sheet.unit);
  std::ranges::replace_if(
      suffix, [](char c) { return c == ' ' || c == '/'; }, '_');
  EXPECT_TRUE(sheet.unit == "1" ? is_a_ratio(number) : number.ends_with(suffix))
      << number << " has unit " << sheet.unit;
}

/// Four digits and no more, from 1600 to 2099.
bool has_year(std::string_view text) {
  constexpr std::string_view kDigits = "0123456789";
  for (auto at = text.find_first_of(kDigits); at != std::string_view::npos;) {
    const auto end = std::min(text.find_first_not_of(kDigits, at), text.size());
    const auto number = text.substr(at, end - at);
    if (number.size() == 4 && number >= "1600" && number < "2100") return true;
    at = text.find_first_of(kDigits, end);
  }
  return false;
}

/// Of effects alone: what a model is composed of is explained where the model is.
class EffectSheet : public Sheet {};

std::vector<Named> every_law_of_an_effect() {
  std::vector<Named> laws = every_law();
  std::erase_if(laws, [](const Named& named) { return !model::is_effect(*named.physics); });
  return laws;
}

TEST_P(EffectSheet, EveryNumberSaysWhatItIsAndWhereItsRangeIsFrom) {
  for (const model::Parameter& parameter : law_.parameters) expect_full(parameter.name, parameter.sheet);
  for (const model::Coefficient& coefficient : law_.coefficients) expect_full(coefficient.name, coefficient.sheet);
  EXPECT_TRUE(has_year(physics_.source)) << "a source has its year: " << physics_.source;
}

std::string text_of(double value) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
  return {text.data(), end};
}

/// A model of this law alone, one key a line, with `key` set to `value` (or added).
std::string toml_with(const model::Physics& physics, const model::Law& law, std::string_view key,
                      const std::string& value, int& line) {
  const model::Part part = model::make_part(physics, law);
  std::vector<std::pair<std::string, std::string>> keys{{"physics", '"' + std::string(physics.name) + '"'},
                                                        {"law", '"' + std::string(law.name) + '"'}};
  for (std::size_t i = 0; i < law.parameters.size(); ++i)
    keys.emplace_back(law.parameters[i].name, text_of(part.parameters[i]));
  for (const model::Coefficient& coefficient : law.coefficients)
    keys.emplace_back(coefficient.name, coefficient.sign == model::Sign::kNonPositive ? "-1.0" : "1.0");
  if (law.make_table) {
    keys.emplace_back("table_first", "0.0");
    keys.emplace_back("table_step", "0.5");
    keys.emplace_back("table_values", "[1.0, 2.0]");
  }
  const auto found = std::ranges::find(keys, key, &std::pair<std::string, std::string>::first);
  if (found != keys.end())
    found->second = value;
  else
    keys.emplace_back(key, value);
  std::string text = "format = \"isorig-model/1\"\n[[part]]\n";
  int at = 3;
  for (const auto& [name, number] : keys) {
    if (name == key) line = at;
    text += name + " = " + number + "\n";
    ++at;
  }
  return text;
}

void expect_refused(const model::Physics& physics, const model::Law& law, std::string_view key,
                    const std::string& value) {
  int line = 0;
  const std::string text = toml_with(physics, law, key, value, line);
  try {
    (void)model::parse_model(text, "model.toml");
    ADD_FAILURE() << "taken: " << key << " = " << value;
  } catch (const base::ConfigError& error) {
    ASSERT_EQ(error.diagnostics().size(), 1U) << error.what();
    const base::Diagnostic& found = error.diagnostics().front();
    EXPECT_EQ(found.file, "model.toml");
    EXPECT_EQ(found.line, static_cast<std::uint32_t>(line)) << error.what();
    EXPECT_GE(found.column, 1U);
    EXPECT_TRUE(std::string(error.what()).starts_with("model.toml:" + std::to_string(line) + ":")) << error.what();
    EXPECT_NE(found.message.find(std::string(key)), std::string::npos) << error.what();
  }
}

TEST_P(Sheet, RefusesWhatIsOutOfRangeOfWrongSignOfWrongTypeOrUnknown) {
  int line = 0;
  EXPECT_NO_THROW((void)model::parse_model(toml_with(physics_, law_, "fixed", "true", line), "model.toml"));
  for (const model::Parameter& parameter : law_.parameters) {
    const double width = parameter.upper - parameter.lower;
    expect_refused(physics_, law_, parameter.name, text_of(parameter.lower - 1e-3 * width));
    expect_refused(physics_, law_, parameter.name, text_of(parameter.upper + 1e-3 * width));
    expect_refused(physics_, law_, parameter.name, "nan");
    expect_refused(physics_, law_, parameter.name, "inf");
    expect_refused(physics_, law_, parameter.name, "\"1.0\"");
  }
  for (const model::Coefficient& coefficient : law_.coefficients) {
    if (coefficient.sign == model::Sign::kNonNegative) expect_refused(physics_, law_, coefficient.name, "-1e-9");
    if (coefficient.sign == model::Sign::kNonPositive) expect_refused(physics_, law_, coefficient.name, "1e-9");
    expect_refused(physics_, law_, coefficient.name, "nan");
    expect_refused(physics_, law_, coefficient.name, "-inf");
    expect_refused(physics_, law_, coefficient.name, "[1.0]");
  }
  expect_refused(physics_, law_, "stiffnes_N_mm", "1.0");
  expect_refused(physics_, law_, "fixed", "1");
  if (!law_.make_table) return;
  expect_refused(physics_, law_, "table_values", "[]");
  expect_refused(physics_, law_, "table_values", "[1.0, nan]");
  expect_refused(physics_, law_, "table_step", "0.0");
  expect_refused(physics_, law_, "table_first", "nan");
}

/// What a diagnosis writes and a prediction reads is the same model to the last bit.
TEST_P(Sheet, WrittenAndReadAgainPredictsTheSame) {
  const Case* each = case_of(physics_.name, law_.name);
  ASSERT_NE(each, nullptr);
  Track track = closed_track(3);
  const auto rows = every(track, 3);
  std::mt19937 random(17);
  std::uniform_real_distribution<double> factor(0.9, 1.1);
  for (const auto& parameters : each->parameters) {
    model::ModelSpec spec = model_of(*each, parameters);
    spec.name = "a \"tricky\" name \\ of\ttwo\nlines";
    for (model::Part& part : spec.parts) {
      for (std::size_t i = 0; i < part.parameters.size(); ++i) {
        const model::Parameter& parameter = part.law->parameters[i];
        part.parameters[i] = std::clamp(part.parameters[i] * factor(random), parameter.lower, parameter.upper);
      }
      for (double& coefficient : part.coefficients) coefficient *= factor(random) / 3.0;
      for (double& value : part.table.values) value *= factor(random);
    }
    spec.parts.back().fixed = true;
    const std::string text = model::model_text(spec, "One line.\nAnother.");
    const model::ModelSpec read = model::parse_model(text, "model.toml");
    EXPECT_EQ(model::model_text(read, "One line.\nAnother."), text);
    EXPECT_EQ(read.name, spec.name);
    EXPECT_TRUE(read.parts.back().fixed);
    EXPECT_EQ(model_force(read, track, rows), model_force(spec, track, rows));
  }
}

INSTANTIATE_TEST_SUITE_P(Catalogue, Sheet, testing::ValuesIn(every_law()),
                         [](const auto& law) { return test_name(law.param); });
INSTANTIATE_TEST_SUITE_P(Catalogue, EffectSheet, testing::ValuesIn(every_law_of_an_effect()),
                         [](const auto& law) { return test_name(law.param); });

TEST(EffectSheets, TheDocumentIsWhatTheCommandPrints) {
  const std::string file = base::read_text_file(test::source_path() + "/docs/effect-sheets.md");
  EXPECT_TRUE(file == model::effect_sheets_document())
      << "write it again: build/bin/isorig effects --markdown > docs/effect-sheets.md";
}

TEST(EffectSheets, ATextHasEveryNumberWithItsUnitRangeAndReason) {
  for (const model::Physics* physics : model::effects()) {
    const std::string text = model::sheet_text(*physics);
    for (const model::Law& law : physics->laws) {
      EXPECT_NE(text.find("law `" + std::string(law.name) + "`"), std::string::npos) << law.name;
      for (const model::Parameter& p : law.parameters) {
        EXPECT_NE(text.find("`" + std::string(p.name) + "`"), std::string::npos) << p.name;
        EXPECT_NE(text.find("], " + model::range_text(p)), std::string::npos) << p.name;
        EXPECT_NE(text.find("Range: " + std::string(p.sheet.range)), std::string::npos) << p.name;
      }
      for (const model::Coefficient& c : law.coefficients) {
        EXPECT_NE(text.find("`" + std::string(c.name) + "`"), std::string::npos) << c.name;
        EXPECT_NE(text.find("[" + std::string(c.sheet.unit) + "], " + std::string(model::range_text(c))),
                  std::string::npos)
            << c.name;
      }
    }
  }
}

void expect_error(const std::string& text, std::string_view place, std::string_view words) {
  try {
    (void)model::parse_model(text, "m.toml");
    ADD_FAILURE() << "taken:\n" << text;
  } catch (const base::ConfigError& error) {
    const std::string said = error.what();
    EXPECT_NE(said.find(place), std::string::npos) << said;
    EXPECT_NE(said.find(words), std::string::npos) << said;
  }
}

TEST(ModelToml, NamesWhatThereIsWhenANameIsUnknown) {
  const std::string head = "format = \"isorig-model/1\"\n";
  expect_error(head + "[[part]]\nphysics = \"unobtainium\"\n", "m.toml:3:", "coulomb_friction");
  expect_error(head + "[[part]]\nphysics = \"coulomb_friction\"\nlaw = \"dhal\"\n", "m.toml:4:", "dahl, jenkins");
  expect_error(head, "m.toml", "at least one [[part]]");
  expect_error("format = \"isorig-model/9\"\n[[part]]\nphysics = \"spring\"\n", "m.toml:1:", "isorig-model/1");
  expect_error("[[part]]\nphysics = \"spring\"\n", "m.toml", "format");
  expect_error("", "m.toml", "format");
  expect_error("format = \n", "m.toml:1:", "");
}

TEST(ModelToml, HasRoomForThirtyTwoCoefficientsAndNoMore) {
  std::string text = "format = \"isorig-model/1\"\n";
  for (int i = 0; i < 32; ++i) text += "[[part]]\nphysics = \"spring\"\n";
  EXPECT_EQ(model::parse_model(text, "m.toml").coefficient_count(), 32U);
  expect_error(text + "[[part]]\nphysics = \"spring\"\n", "m.toml", "32 coefficients");
}

}  // namespace
}  // namespace isorig::test
