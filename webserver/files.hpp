#pragma once
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

/// What the verbs share.
namespace isorig::web {

inline constexpr std::size_t kFileBytes = std::size_t{1} << 20U;

/// Nothing: there is no such file, or it is longer than a protocol can be.
inline std::optional<std::string> text_of(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return std::nullopt;
  std::string text(kFileBytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > kFileBytes) return std::nullopt;
  return text;
}

/// The text at `key`, if it is one; what a page sends may be anything.
inline std::string text_at(const nlohmann::json& body, const char* key) {
  const auto found = body.find(key);
  return found != body.end() && found->is_string() ? found->get<std::string>() : std::string();
}

}  // namespace isorig::web
