#pragma once
#include <toml++/toml.h>

#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "base/toml_reader.hpp"

/// What toml_document.cpp and toml_reader.cpp share; apart, so that no other file reads toml++'s headers.
namespace isorig::base {

struct TomlDocument::Impl {
  std::string name;
  std::string text;
  toml::table root;
  std::vector<Diagnostic> diagnostics;
  std::size_t further = 0;  ///< that were not kept
  std::map<const toml::table*, std::set<std::string, std::less<>>> asked;
  std::set<const toml::table*> open;

  Diagnostic at(const toml::source_region& region, std::string message) const {
    return {name, region.begin.line, region.begin.column, std::move(message)};
  }

  /// Keeps it, unless there are too many already.
  void note(Diagnostic diagnostic);

  /// Every key that no reader asked for, with the nearest one that a reader did ask for.
  void find_unread(const toml::table& table, std::vector<Diagnostic>& out) const;
  void find_unread(const toml::array& array, std::vector<Diagnostic>& out) const;
};

}  // namespace isorig::base
