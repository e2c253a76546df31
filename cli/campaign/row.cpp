#include "cli/campaign/row.hpp"

#include <fstream>

#include "base/formatted.hpp"
#include "base/number_text.hpp"
#include "base/text_file.hpp"
#include "base/toml_reader.hpp"
#include "cli/campaign/piece.hpp"

namespace isorig::cli::pieces {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

}  // namespace

std::string text_of(const ordered_json& value) {
  if (value.is_null()) return "";
  if (value.is_string()) return value.get<std::string>();
  if (value.is_number_integer()) return std::to_string(value.get<long long>());
  return base::number_text(value.get<double>(), 15);
}

std::string names_of_missing(const ordered_json& missing) {
  std::string out;
  for (const auto& one : missing)
    out += (out.empty() ? "" : "; ") + one.at("effect").get<std::string>() + " " +
           base::formatted("%.2f", one.at("probability").get<double>());
  return out;
}

ordered_json subject_of(const Ask& ask, const std::string& recording) {
  ordered_json out{{"specimen", nullptr}, {"pressure_psi", nullptr}, {"repetition", nullptr}};
  try {
    const auto document =
        base::TomlDocument::parse_file(fs::path(recording) / recordings_in(ask).front() / "recording.toml");
    const auto said = document.root();
    if (said.has("specimen")) out["specimen"] = said.string("specimen");
    if (said.has("nominal_pressure_psi")) out["pressure_psi"] = said.number("nominal_pressure_psi");
    if (said.has("repetition")) out["repetition"] = said.integer("repetition");
  } catch (const base::ConfigError&) {  // the command has said what is wrong with it
  }
  return out;
}

ordered_json row_of_answer(const Ask& ask, const fs::path& made, const std::string& recording, int exit_code) {
  ordered_json row = subject_of(ask, recording);
  row["verdict"] = exit_code == kBadRecording ? "bad_recording" : "";
  row["missing"] = ordered_json::array();
  row["page"] = fs::exists(made / page_file(ask)) ? ordered_json(page_file(ask)) : ordered_json(nullptr);
  const fs::path numbers = made / numbers_file(ask);
  if (exit_code == kBadRecording || !fs::exists(numbers)) return row;
  const ordered_json json = ordered_json::parse(base::read_text_file(numbers));
  if (ask.command == "fv") {
    row["verdict"] = exit_code == 0 ? "fitted" : "nothing_fitted";
    return row;
  }
  row["verdict"] = json.at("verdict");
  for (const auto& one : json.at("missing"))
    row["missing"].push_back({{"effect", one.at("effect")}, {"probability", one.at("probability")}});
  return row;
}

ordered_json row_now(const Plan& plan, const ordered_json& ask, const std::string& recording) {
  ordered_json out{{"recording", recording}, {"specimen", nullptr},  {"pressure_psi", nullptr},
                   {"repetition", nullptr},  {"verdict", ""},        {"missing", ordered_json::array()},
                   {"state", "waiting"},     {"exit_code", nullptr}, {"why", nullptr},
                   {"folder", nullptr},      {"page", nullptr}};
  const fs::path piece = piece_folder(plan, recording), failed = failed_folder(plan, recording);
  try {
    ordered_json json;
    if (fs::exists(piece / "piece.json")) json = ordered_json::parse(base::read_text_file(piece / "piece.json"));
    if (!json.is_null() && json.at("stamp").at("ask") == ask && json.at("stamp").at("program") == plan.program) {
      const ordered_json& row = json.at("row");
      for (const char* key : {"specimen", "pressure_psi", "repetition", "verdict", "missing"}) out[key] = row.at(key);
      const int code = json.at("exit_code");
      out["state"] = row.at("verdict") == "bad_recording" ? "bad_recording" : "made";
      out["exit_code"] = code;
      out["folder"] = piece.lexically_relative(plan.folder).string();
      if (row.at("page").is_string())
        out["page"] = (piece.lexically_relative(plan.folder) / row.at("page").get<std::string>()).string();
    } else if (fs::exists(failed / "failure.json")) {
      json = ordered_json::parse(base::read_text_file(failed / "failure.json"));
      out["state"] = "failed";
      out["why"] = json.at("why");
      out["folder"] = failed.lexically_relative(plan.folder).string();
    }
  } catch (const std::exception& e) {
    out["state"] = "failed";
    out["why"] = e.what();
  }
  return out;
}

std::string csv_header() {
  return "recording,specimen,pressure_psi,repetition,verdict,missing,state,exit_code,why,folder,page";
}

std::string csv_line(const ordered_json& row) {
  std::string out;
  for (const auto& [key, value] : row.items())
    out += (key == "recording" ? "" : ",") + csv_cell(key == "missing" ? names_of_missing(value) : text_of(value));
  return out;
}

}  // namespace isorig::cli::pieces
