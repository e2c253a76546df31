#pragma once
#include <span>
#include <string_view>

#include "base/toml_reader.hpp"

namespace isorig::base {

/// Hears what readers ask of the documents that they read: which keys there are, of which kind. The JSON Schemas
/// (cli/protocols/schema_of_readers.hpp) are made of it, so that they cannot differ from what is read.
class TomlObserver {
 public:
  enum class Kind { kAny, kNumber, kInteger, kBoolean, kString, kNumbers, kStrings, kTable, kTables };
  struct Asked {
    std::string_view key;
    Kind kind = Kind::kAny;
    bool required = false;
    Range range{};
    std::span<const std::string_view> choices{};
  };

  TomlObserver();  ///< hears this thread's readers until it is destroyed; one at a time
  virtual ~TomlObserver();
  TomlObserver(const TomlObserver&) = delete;
  TomlObserver& operator=(const TomlObserver&) = delete;

  virtual void root(const std::string& document, const void* table) = 0;
  virtual void asked(const void* table, const Asked& what) = 0;
  /// A table in `table`, or the element `index` of a list of tables.
  virtual void inside(const void* table, std::string_view key, const void* child, int index) = 0;
  /// Any key is allowed there: its rest is ignored, or its keys are names.
  virtual void open(const void* table) = 0;

  [[nodiscard]] static TomlObserver* of_this_thread();
};

}  // namespace isorig::base
