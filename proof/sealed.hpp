#pragma once
#include <filesystem>
#include <string>
#include <string_view>

namespace isorig::proof {

/// SHA-256 in lower-case hexadecimal.
[[nodiscard]] std::string sha256(std::string_view bytes);
void write_text(const std::filesystem::path& file, std::string_view text);

/// labels.json beside labels.sha256: the second can be published while the first is kept back.
void seal(const std::filesystem::path& labels, const std::filesystem::path& hash_file, std::string_view text);

/// The labels, if they are those that were sealed; throws std::runtime_error otherwise.
[[nodiscard]] std::string unseal(const std::filesystem::path& labels, const std::filesystem::path& hash_file);

/// The hash published in a file of the form that sha256sum writes.
[[nodiscard]] std::string published_hash(const std::filesystem::path& hash_file);

}  // namespace isorig::proof
