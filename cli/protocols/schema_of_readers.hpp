#pragma once
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace isorig::cli {

/// Reads a text as one kind of file; may throw base::ConfigError.
using ReadText = std::function<void(const std::string& text, const std::string& name)>;

/// A JSON Schema (draft 7) of what `readers` read. They are given `seeds`, and then, for every key that they ask for,
/// the same document with that key: a number, a string, each of the words that are allowed, an empty table and so on,
/// until nothing new is asked. A key is required if it was wherever its table was; ranges and words are those of the
/// readers. What is allowed is what some branch of a reader takes. A word that another one could stand in place of (the
/// kind of a step, a driver) has conditions: what was demanded and asked for in all readings in which it stood there.
/// The schema completes and finds wrong names, values out of range and wrong types; `isorig check` and `isorigd
/// --check` find the rest.
[[nodiscard]] nlohmann::ordered_json schema_of(const std::string& title, const std::vector<ReadText>& readers,
                                               const std::vector<std::string>& seeds);

}  // namespace isorig::cli
