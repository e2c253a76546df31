// An effect is known by its own file and one line of registration: what the diagnosis has to know of it stands there
// as traits (model/process.hpp). No other file of identify/ may name an effect, one of its laws' parameters, or its
// accessor.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>

#include "model/catalogue.hpp"
#include "tree.hpp"

namespace isorig::identify {
namespace {

/// The file without its comments: those may give examples.
std::string code_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string out;
  for (std::string line; std::getline(in, line);) out += line.substr(0, line.find("//")) + '\n';
  return out;
}

/// Recordings whose output is no force have a model of their own; its laws answer to names of the recording format.
bool is_response(const std::filesystem::path& file) {
  return file.parent_path().filename() == "response";
}

std::vector<std::filesystem::path> sources(const char* room) {
  std::vector<std::filesystem::path> out;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(test::source_path() + room))
    if (!is_response(entry.path()) && (entry.path().extension() == ".cpp" || entry.path().extension() == ".hpp"))
      out.push_back(entry.path());
  return out;
}

bool has_word(const std::string& text, const std::string& word) {
  const auto letter = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; };
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) {
    const bool begins = at == 0 || !letter(text[at - 1]);
    const std::size_t end = at + word.size();
    if (begins && (end == text.size() || !letter(text[end]))) return true;
  }
  return false;
}

TEST(EffectNames, NoFileOfIdentifyNamesAnEffect) {
  const auto files = sources("/identify");
  ASSERT_GT(files.size(), 50u);
  std::set<std::string> names;
  for (const model::Physics* effect : model::effects()) names.insert(std::string(effect->name));
  ASSERT_GE(names.size(), 19u);
  names.erase("slack");  // a word of its own; as a string below
  for (const auto& file : files) {
    const std::string code = code_of(file);
    for (const std::string& name : names) EXPECT_FALSE(has_word(code, name)) << file << " names " << name;
    EXPECT_EQ(code.find("\"slack\""), std::string::npos) << file;
    EXPECT_EQ(code.find("model::effect::"), std::string::npos) << file;
    EXPECT_EQ(code.find("model/effects/"), std::string::npos) << file;
  }
}

TEST(EffectNames, NoFileOfTheDiagnosisNamesALawOrAParameterOfAnEffect) {
  std::set<std::string> quoted;
  for (const model::Physics* effect : model::effects()) {
    for (const model::Law& law : effect->laws) {
      // Elements share some words: "linear", "position".
      for (const model::Parameter& parameter : law.parameters) quoted.insert('"' + std::string(parameter.name) + '"');
      if (law.name.find('_') != std::string_view::npos) quoted.insert('"' + std::string(law.name) + '"');
    }
  }
  for (const auto& file : sources("/identify/diagnose")) {
    const std::string code = code_of(file);
    for (const std::string& word : quoted) {
      if (word == "\"duration_s\"" || word == "\"share\"") continue;  // keys of diagnosis.json
      // Variables over which an effect is drawn (`shape.of` of diagnosis.json); laws have numbers of these names, too.
      const bool variable = word == "\"position_mm\"" || word == "\"time_s\"" || word == "\"travel_mm\"";
      if (variable && file.filename() == "shape.cpp") continue;
      EXPECT_EQ(code.find(word), std::string::npos) << file << " names " << word;
    }
  }
}

/// What the traits say must make sense in the catalogue.
TEST(EffectTraits, NameOnlyWhatThereIs) {
  for (const model::Physics* effect : model::effects()) {
    const model::PhysicsTraits& traits = effect->traits;
    if (!traits.refines.empty()) {
      EXPECT_NE(model::find_physics(traits.refines), nullptr) << effect->name;
    }
    for (const auto name : traits.contains) EXPECT_NE(model::find_physics(name), nullptr) << effect->name;
    for (const auto name : traits.needs_any_of) EXPECT_NE(model::find_physics(name), nullptr) << effect->name;
    for (const model::Law& law : effect->laws) {
      EXPECT_EQ(model::is_event(law), law.traits.event_force_step != 0.0) << effect->name;
      EXPECT_EQ(model::is_event(law), !traits.event_name.empty()) << effect->name;
      if (law.traits.replaces_arm) {
        ASSERT_FALSE(law.parameters.empty());
        EXPECT_EQ(law.parameters[0].name, "time_constant_s") << law.name;
      }
      for (const model::Parameter& parameter : law.parameters) {
        const model::ParameterTraits& of = parameter.traits;
        EXPECT_EQ(of.resolution == model::Resolution::kNone, of.resolution_factor == 0.0) << parameter.name;
        for (const auto name : {of.lower_bound_is, of.upper_bound_is})
          EXPECT_TRUE(name.empty() || model::find_physics(name) != nullptr) << parameter.name;
        if (of.filled_by != model::FilledBy::kNothing) {
          EXPECT_TRUE(parameter.fixed) << parameter.name;
        }
      }
    }
  }
}

}  // namespace
}  // namespace isorig::identify
