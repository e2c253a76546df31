#include "cli/campaign/ask.hpp"

#include <nlohmann/json.hpp>

#include "cli/campaign/piece.hpp"

namespace isorig::cli::pieces {

using nlohmann::ordered_json;

ordered_json to_json(const Ask& ask) {
  return {{"command", ask.command}, {"model", ask.model}, {"threads", ask.threads}};
}

Ask ask_from_json(const ordered_json& json) {
  return {json.at("command").get<std::string>(), json.at("model").get<std::string>(),
          json.at("threads").get<unsigned>()};
}

ordered_json stamp_of(const Ask& ask) {
  ordered_json out{{"command", ask.command}, {"model", ask.model}};
  if (std::filesystem::path(ask.model).is_absolute()) out["model_sha256"] = sha256_of_file(ask.model);
  return out;
}

std::vector<std::string> words_of(const Ask& ask, const std::filesystem::path& program, const std::string& recording) {
  std::vector<std::string> words{program.string(), ask.command, recording, "--model", ask.model, "--out", "."};
  if (ask.command == "diagnose") words.insert(words.end(), {"--threads", std::to_string(ask.threads)});
  words.emplace_back("--undated");
  return words;
}

std::string numbers_file(const Ask& ask) {
  return ask.command == "diagnose" ? "diagnosis.json" : "fv.json";
}

std::string page_file(const Ask& ask) {
  return ask.command == "diagnose" ? "diagnosis-report.html" : "fv-report.html";
}

std::string difference(const Ask& there, const Ask& here) {
  std::string out;
  const auto add = [&](const char* what, const std::string& a, const std::string& b) {
    if (a != b) out += (out.empty() ? "" : "; ") + (what + (": " + a)) + " there, " + b + " here";
  };
  add("--ask", there.command, here.command);
  add("--model", there.model, here.model);
  return out;
}

}  // namespace isorig::cli::pieces
