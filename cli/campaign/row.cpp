#include "cli/campaign/row.hpp"

#include <array>
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

constexpr std::array kFitNumbers{
    "r_squared", "points", "residual_rms", "noise", "mean_residual_extension", "mean_residual_shortening"};
constexpr std::array kParameters{"kappa", "gamma_per_s", "beta"};

std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

/// The curve of one recording and its fit, without what the row has already.
ordered_json fit_of(const ordered_json& fv) {
  if (fv.at("curves").empty()) return nullptr;
  ordered_json out{{"model", fv.at("model")}};
  for (const auto& [key, value] : fv.at("curves").at(0).items())
    if (key != "specimen" && key != "nominal_pressure_psi" && key != "recordings") out[key] = value;
  return out;
}

/// "0.0125 1.032 0.002; 0.025 1.041 0.002": strain rate, F/F0 and its standard error of every point.
std::string curve_text(const ordered_json& means) {
  std::string out;
  for (const auto& point : means) {
    out += out.empty() ? "" : "; ";
    out += text_of(point.at("strain_rate_per_s")) + " " + text_of(point.at("normalized_force"));
    if (!point.at("se").is_null()) out += " " + text_of(point.at("se"));
  }
  return out;
}

/// The columns that a fit has behind the others; all empty where there is no curve.
std::string fit_cells(const ordered_json& curve) {
  const bool there = curve.is_object(), fitted = there && curve.at("fit").is_object();
  const ordered_json fit = fitted ? curve.at("fit") : ordered_json::object();
  const ordered_json parameters = fit.value("parameters", ordered_json::object());
  std::string out = there ? "," + text_of(curve.at("model")) : ",";
  for (const char* name : kFitNumbers) out += "," + text_of(fit.value(name, ordered_json()));
  for (const char* name : kParameters) {
    const ordered_json one = parameters.value(name, ordered_json());
    if (one.is_null())
      out += ",,,,";
    else
      out += "," + text_of(one.at("value")) + "," + text_of(one.at("ci95").at(0)) + "," +
             text_of(one.at("ci95").at(1)) + (one.at("identifiable") == true ? ",yes" : ",no");
  }
  for (const char* name : {"initial_strain", "strain_step", "refusal"})
    out += "," + (there ? csv_cell(text_of(curve.value(name, ordered_json()))) : std::string());
  return out + "," + (there ? curve_text(curve.at("means")) : std::string());
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
  if (ask.command == "fv") row["fit"] = nullptr;
  const fs::path numbers = made / numbers_file(ask);
  if (exit_code == kBadRecording || !fs::exists(numbers)) return row;
  const ordered_json json = ordered_json::parse(base::read_text_file(numbers));
  if (ask.command == "fv") {
    row["verdict"] = exit_code == 0 ? "fitted" : "nothing_fitted";
    row["fit"] = fit_of(json);
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
  const bool fv = plan.ask.command == "fv";
  if (fv) out["fit"] = nullptr;
  const fs::path piece = piece_folder(plan, recording), failed = failed_folder(plan, recording);
  try {
    ordered_json json;
    if (fs::exists(piece / "piece.json")) json = ordered_json::parse(base::read_text_file(piece / "piece.json"));
    if (!json.is_null() && json.at("stamp").at("ask") == ask && json.at("stamp").at("program") == plan.program) {
      const ordered_json& row = json.at("row");
      for (const char* key : {"specimen", "pressure_psi", "repetition", "verdict", "missing"}) out[key] = row.at(key);
      if (fv) out["fit"] = row.at("fit");
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

std::string csv_header(const Ask& ask) {
  std::string out = "recording,specimen,pressure_psi,repetition,verdict,missing,state,exit_code,why,folder,page";
  if (ask.command != "fv") return out;
  out += ",model";
  for (const char* name : kFitNumbers) out += std::string(",") + name;
  for (const std::string name : kParameters)
    out += "," + name + "," + name + "_ci95_low," + name + "_ci95_high," + name + "_identifiable";
  return out + ",initial_strain,strain_step,refusal,curve";
}

std::string csv_line(const Ask& ask, const ordered_json& row) {
  std::string out;
  for (const auto& [key, value] : row.items()) {
    if (key == "fit") continue;
    out += (key == "recording" ? "" : ",") + csv_cell(key == "missing" ? names_of_missing(value) : text_of(value));
  }
  return ask.command == "fv" ? out + fit_cells(row.at("fit")) : out;
}

}  // namespace isorig::cli::pieces
