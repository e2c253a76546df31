#pragma once
#include <filesystem>

#include "base/toml_reader.hpp"
#include "protocol/limits.hpp"
#include "protocol/plan.hpp"

namespace isorig::protocol {

/// Compiles a protocol (the language: docs/protocol.md) and checks it against the rig's limits.
/// Pure: same text and limits, same plan. Throws base::ConfigError with everything that is wrong, each with
/// file:line:column, the values that led to it (also those bound by a `repeat`) and what would be right.
[[nodiscard]] Plan compile(const base::TomlDocument& document, const Limits& limits = {});

/// compile(TomlDocument::parse_file(path), limits).
[[nodiscard]] Plan compile_file(const std::filesystem::path& path, const Limits& limits = {});

}  // namespace isorig::protocol
