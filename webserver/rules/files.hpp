#pragma once
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "base/text_file.hpp"

/// What the verbs share.
namespace isorig::web {

inline constexpr std::size_t kFileBytes = std::size_t{1} << 20U;

/// Nothing: there is no such file, it is none that ends (a FIFO, a device), or it is longer than a protocol can be.
inline std::optional<std::string> text_of(const std::filesystem::path& path) {
  try {
    std::string text = base::read_text_file(path, kFileBytes + 1);
    if (text.size() <= kFileBytes) return text;
  } catch (const base::FileError&) {
  }
  return std::nullopt;
}

/// The text at `key`, if it is one; what a page sends may be anything.
inline std::string text_at(const nlohmann::json& body, const char* key) {
  const auto found = body.find(key);
  return found != body.end() && found->is_string() ? found->get<std::string>() : std::string();
}

}  // namespace isorig::web
