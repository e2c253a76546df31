#include "identify/pooling/read_diagnosis.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/toml_reader.hpp"
#include "identify/pooling/mixed_model.hpp"
#include "model/catalogue.hpp"

namespace isorig::identify::pooling {
namespace {

using nlohmann::ordered_json;
namespace fs = std::filesystem;

int repetition_in(const std::string& further_toml) {
  try {
    const auto document = base::TomlDocument::parse_text(further_toml, "recording.toml");
    const auto root = document.root();
    return root.type_of("repetition") == "integer" ? static_cast<int>(root.integer("repetition", {0, 1e9})) : 0;
  } catch (const base::ConfigError&) {
    return 0;  // verbatim keys of somebody else, that were read once already
  }
}

ordered_json parsed(const fs::path& file) {
  if (std::error_code error; fs::exists(file, error) && !fs::is_regular_file(file, error))
    throw PoolError(file.string(), "is a device, a pipe or a folder; name folders of diagnoses");
  std::ifstream in(file);
  if (!in)
    throw PoolError(file.string(), "no such file; name folders that `isorig diagnose RECORDING --out FOLDER` wrote");
  try {
    return ordered_json::parse(in);
  } catch (const ordered_json::parse_error& e) {
    throw PoolError(file.string(), "is no JSON (at byte " + std::to_string(e.byte) +
                                       "), cut off or damaged; diagnose its recording again");
  }
}

/// What a JSON library says, without its own "[json.exception.out_of_range.403] " in front.
std::string without_code(const std::string& what) {
  const std::size_t end = what.starts_with('[') ? what.find("] ") : std::string::npos;
  return end == std::string::npos ? what : what.substr(end + 2);
}

double number_or_nan(const ordered_json& value) {
  return value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN();
}

/// Standard error. An interval that ends at a bound, or at the zero of a sign, is short on that side: the other counts.
double error_of(const ordered_json& value, const ordered_json& interval) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  if (!interval.is_array() || interval.size() != 2) return kUnknown;
  const double at = number_or_nan(value), low = number_or_nan(interval[0]), high = number_or_nan(interval[1]);
  const double half = std::max(at - low, high - at);
  return half > 0.0 && std::isfinite(low) && std::isfinite(high) ? half / kZ95 : kUnknown;
}

std::vector<std::string> split(const std::string& key) {
  std::vector<std::string> out;
  std::istringstream in(key);
  for (std::string part; std::getline(in, part, '+');) out.push_back(part);
  return out;
}

std::vector<ReadEffect> missing_in(const ordered_json& json) {
  std::vector<std::string> refused;
  if (json.contains("not_modelled") && json["not_modelled"].is_object())
    refused = json["not_modelled"].at("names").get<std::vector<std::string>>();
  std::vector<ReadEffect> out;
  for (const auto& entry : json.at("missing")) {
    ReadEffect effect{entry.at("effect"), entry.at("law"), entry.at("probability"), false, {}};
    effect.refused = std::ranges::find(refused, effect.name) != refused.end();
    for (const auto& [name, number] : entry.at("parameters").items())
      effect.numbers.push_back(
          {name, number_or_nan(number.at("value")), error_of(number.at("value"), number.at("ci95"))});
    out.push_back(std::move(effect));
  }
  return out;
}

/// A part of the nominal model with its numbers.
struct Part {
  std::string name;
  std::vector<ReadNumber> numbers;
};

/// A part ends where its next number is one that it has, or another part's begins.
std::vector<Part> parts_in(const ordered_json& numbers) {
  std::vector<Part> out;
  for (const auto& entry : numbers) {
    const std::string part = entry.at("part"), number = entry.at("number");
    const auto* physics = model::find_physics(part);
    if (physics == nullptr || model::is_effect(*physics) || model::is_empirical(*physics)) continue;
    const bool same = !out.empty() && out.back().name == part &&
                      std::ranges::find(out.back().numbers, number, &ReadNumber::name) == out.back().numbers.end();
    if (!same) out.push_back({part, {}});
    out.back().numbers.push_back(
        {number, number_or_nan(entry.at("value")), error_of(entry.at("value"), entry.at("ci95"))});
  }
  return out;
}

double time_constant(const Part& part) {
  const auto found = std::ranges::find(part.numbers, "time_constant_s", &ReadNumber::name);
  return found == part.numbers.end() ? 0.0 : found->value;
}

/// Arms stand in any order: which is the second depends on how the search went, and is settled by the time constant.
std::vector<ReadNumber> nominal_numbers(const ordered_json& numbers) {
  std::vector<Part> parts = parts_in(numbers);
  std::map<std::string, std::vector<std::size_t>> of_name;
  for (std::size_t i = 0; i < parts.size(); ++i) of_name[parts[i].name].push_back(i);
  for (const auto& [name, places] : of_name) {
    std::vector<Part> alike;
    for (const std::size_t i : places) alike.push_back(parts[i]);
    std::ranges::stable_sort(alike, std::greater<>(), time_constant);
    for (std::size_t k = 0; k < places.size(); ++k) parts[places[k]] = alike[k];
  }
  std::map<std::string, int> count;
  std::vector<ReadNumber> out;
  for (const Part& part : parts) {
    if (part.name == "arm_start" || part.name == "force_zero") continue;  // states of one recording
    const int n = ++count[part.name];
    const std::string name = part.name + (n > 1 ? "_" + std::to_string(n) : "");
    for (const ReadNumber& number : part.numbers)
      out.push_back({name + "." + number.name, number.value, number.standard_error});
  }
  return out;
}

Place place_in(const ordered_json& json, const fs::path& file) {
  const auto recordings = json.find("recordings");
  if (recordings == json.end() || recordings->empty())
    throw PoolError(file.string(),
                    "does not say of which recording it is; diagnose the recording again, older versions did not say");
  Place out;
  for (const auto& one : *recordings) {
    const std::string specimen = one.value("specimen", std::string());
    if (specimen.empty())
      throw PoolError(file.string(), "its recording names no specimen; add `specimen` to its recording.toml");
    if (!one.contains("nominal_pressure_psi"))
      throw PoolError(file.string(),
                      "its recording names no pressure; add `nominal_pressure_psi` to its recording.toml");
    const double pressure_psi = one["nominal_pressure_psi"];
    if (!out.specimen.empty() && (specimen != out.specimen || pressure_psi != out.pressure_psi))
      throw PoolError(file.string(), "is of several specimens or pressures; diagnose each of its recordings alone");
    out = {specimen, pressure_psi, recordings->size() == 1 ? one.value("repetition", 0) : 0};
  }
  return out;
}

ReadDiagnosis read_checked(const Source& source, const fs::path& file, const ordered_json& json) {
  ReadDiagnosis out;
  out.folder = source.diagnosis;
  if (source.recording.empty()) {
    out.place = place_in(json, file);
  } else {
    try {
      out.place = place_of(messages::read_recording_toml(source.recording / "recording.toml"),
                           (source.recording / "recording.toml").string());
    } catch (const messages::RecordingError& e) {
      throw PoolError(e.what());
    }
  }
  if (const auto recordings = json.find("recordings"); recordings != json.end())
    for (const auto& one : *recordings)
      if (one.contains("id")) out.recording_ids.push_back(one["id"]);
  out.verdict = json.at("verdict");
  if (json.contains("cannot_judge") && json["cannot_judge"].is_object())
    out.cannot_judge = json["cannot_judge"].at("why");
  out.missing = missing_in(json);
  for (const auto& one : json.at("tried")) out.tried.push_back({split(one.at("explanation")), one.at("weight")});
  for (const auto& one : json.at("discernible"))
    if (!one.at("seen_from_N").is_number()) out.invisible.push_back(one.at("effect"));
  out.nominal = nominal_numbers(json.at("fit").at("model").at("numbers"));
  for (const ReadNumber& number : nominal_numbers(json.at("fit").at("nominal").at("numbers")))
    out.asked.push_back(number.name);
  out.page = page_in(source.diagnosis);
  return out;
}

}  // namespace

Place place_of(const messages::RecordingMetadata& metadata, const std::string& where) {
  if (metadata.specimen.empty()) throw PoolError(where, "names no specimen; add `specimen`");
  if (!metadata.nominal_pressure_psi)
    throw PoolError(where, "names no pressure; add `nominal_pressure_psi`, which the pool is ordered by");
  return {metadata.specimen, *metadata.nominal_pressure_psi, repetition_in(metadata.further_toml)};
}

ordered_json recordings_json(const std::vector<messages::RecordingMetadata>& recordings,
                             const std::vector<double>& ids) {
  ordered_json out = ordered_json::array();
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    const auto& metadata = recordings[i];
    out.push_back({{"specimen", metadata.specimen}});
    if (metadata.nominal_pressure_psi) out.back()["nominal_pressure_psi"] = *metadata.nominal_pressure_psi;
    if (const int repetition = repetition_in(metadata.further_toml); repetition > 0)
      out.back()["repetition"] = repetition;
    if (i < ids.size()) out.back()["id"] = static_cast<std::uint64_t>(ids[i]);
  }
  return out;
}

std::string page_in(const fs::path& diagnosis) {
  for (const char* page : {"diagnosis-report.html", "report.html", "diagnosis.json"})
    if (fs::exists(diagnosis / page)) return page;
  return {};
}

ReadDiagnosis read_diagnosis(const Source& source) {
  const fs::path file = source.diagnosis / "diagnosis.json";
  const ordered_json json = parsed(file);
  try {
    if (json.at("format") != "isorig-diagnosis/1")
      throw PoolError(file.string(), "format is " + json.at("format").dump() +
                                         ", not \"isorig-diagnosis/1\"; diagnose its recording with this version");
    if (json.contains("output") && json["output"] != "force")
      throw PoolError(file.string(), "is of the " + json["output"].get<std::string>() +
                                         "; only diagnoses of forces have numbers that can be pooled");
    return read_checked(source, file, json);
  } catch (const ordered_json::exception& e) {
    throw PoolError(file.string(),
                    "is no whole diagnosis (" + without_code(e.what()) + "); diagnose its recording again");
  }
}

}  // namespace isorig::identify::pooling
