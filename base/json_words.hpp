#pragma once
#include <exception>
#include <string>
#include <string_view>

namespace isorig::base {

/// What was wrong with a JSON file, without the JSON library's own names for it ("[json.exception.parse_error.101]
/// ..."). Any other exception's words stay as they are.
[[nodiscard]] inline std::string json_words(const std::exception& e) {
  const std::string_view said = e.what();
  constexpr std::string_view kLibrary = "[json.exception.";
  const auto end = said.find("] ");
  if (!said.starts_with(kLibrary) || end == said.npos) return std::string(said);
  std::string words(said.substr(end + 2));
  const bool syntax = said.starts_with("[json.exception.parse_error");
  if (syntax && words.starts_with("parse error at ")) words.erase(0, std::string_view("parse error ").size());
  return (syntax ? "not valid JSON: " : "valid JSON, but not as isorig writes it: ") + words;
}

}  // namespace isorig::base
