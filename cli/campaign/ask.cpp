#include "cli/campaign/ask.hpp"

#include <nlohmann/json.hpp>

#include "cli/campaign/piece.hpp"

namespace isorig::cli::pieces {

using nlohmann::ordered_json;

ordered_json to_json(const Ask& ask) {
  ordered_json out{{"command", ask.command}, {"model", ask.model}, {"threads", ask.threads}};
  if (ask.is_case()) out.update({{"judged", ask.judged}, {"options", ask.options}});
  if (!ask.control.empty()) out["control"] = ask.control;
  return out;
}

Ask ask_from_json(const ordered_json& json) {
  return {json.at("command").get<std::string>(),
          json.at("model").get<std::string>(),
          json.at("threads").get<unsigned>(),
          json.value("judged", std::string()),
          json.value("options", std::vector<std::string>()),
          json.value("control", std::string())};
}

std::vector<std::string> input_files(const Ask& ask) {
  std::vector<std::string> out;
  if (std::filesystem::path(ask.model).is_absolute()) out.push_back(ask.model);
  if (!ask.control.empty()) out.push_back(ask.control);
  return out;
}

ordered_json stamp_of(const Ask& ask) {
  const bool is_file = std::filesystem::path(ask.model).is_absolute();
  return stamp_of(ask, is_file ? sha256_of_file(ask.model) : std::string(),
                  ask.control.empty() ? std::string() : sha256_of_file(ask.control));
}

ordered_json stamp_of(const Ask& ask, const std::string& model_sha256, const std::string& control_sha256) {
  ordered_json out{{"command", ask.command}, {"model", ask.model}};
  if (!model_sha256.empty()) out["model_sha256"] = model_sha256;
  if (!ask.control.empty()) out.update({{"control", ask.control}, {"control_sha256", control_sha256}});
  if (ask.is_case()) out["options"] = ask.options;
  return out;
}

std::vector<std::string> words_of(const Ask& ask, const std::filesystem::path& program, const std::string& recording,
                                  const std::vector<std::string>& model) {
  if (ask.is_case()) {
    std::vector<std::string> words{program.string(),
                                   ask.command,
                                   recording,
                                   "--cases",
                                   ask.model,
                                   "--isorig",
                                   ask.judged,
                                   "--threads",
                                   std::to_string(ask.threads),
                                   "--"};
    words.insert(words.end(), ask.options.begin(), ask.options.end());
    return words;
  }
  std::vector<std::string> words{program.string(), ask.command, recording};
  words.insert(words.end(), model.begin(), model.end());
  words.insert(words.end(), {"--out", "."});
  if (ask.command == "diagnose") words.insert(words.end(), {"--threads", std::to_string(ask.threads)});
  words.emplace_back("--undated");
  return words;
}

std::vector<std::string> recordings_in(const Ask& ask) {
  return ask.is_case() ? std::vector<std::string>{"train", "heldout"} : std::vector<std::string>{""};
}

std::string caller_of(const Ask& ask) {
  return ask.is_case() ? "isorig-proof" : "isorig campaign";
}

std::string subjects_of(const Ask& ask) {
  return ask.is_case() ? "cases" : "recordings";
}

std::string numbers_file(const Ask& ask) {
  return ask.command == "fv" ? "fv.json" : "diagnosis.json";
}

std::string page_file(const Ask& ask) {
  return ask.command == "fv" ? "fv-report.html" : "diagnosis-report.html";
}

std::string difference(const Ask& there, const Ask& here) {
  std::string out;
  const auto add = [&](const char* what, const std::string& a, const std::string& b) {
    if (a != b) out += (out.empty() ? "" : "; ") + (what + (": " + a)) + " there, " + b + " here";
  };
  add("--ask", there.command, here.command);
  // A study's results are of the study's own folder; what was made with other options is made anew.
  if (!here.is_case()) add("--model", there.model, here.model);
  const auto named = [](const std::string& control) { return control.empty() ? std::string("none") : control; };
  add("--control", named(there.control), named(here.control));
  return out;
}

}  // namespace isorig::cli::pieces
