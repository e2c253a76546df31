#pragma once
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace isorig::base {

/// One thing wrong in a text from outside: where, and what would be right.
struct Diagnostic {
  std::string file;
  std::uint32_t line = 0;
  std::uint32_t column = 0;
  std::string message;
  /// "file:line:column: message", or "file: message" where it is of the whole file; always one line of printable text
  [[nodiscard]] std::string text() const;
};

/// All that is wrong with a configuration, at once. what() holds every line.
class ConfigError : public std::runtime_error {
 public:
  explicit ConfigError(std::vector<Diagnostic> diagnostics);
  [[nodiscard]] const std::vector<Diagnostic>& diagnostics() const noexcept { return diagnostics_; }

 private:
  std::vector<Diagnostic> diagnostics_;
};

struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool open_min = false;  ///< true: strictly greater than min
};
inline constexpr Range kPositive{0.0, std::numeric_limits<double>::infinity(), true};
inline constexpr Range kNonNegative{0.0};

class TomlTable;

/// A parsed TOML file. Readers collect what is wrong in it; finish() throws it all as one ConfigError.
/// A key that no reader asked for is an error, with the nearest known key as a suggestion.
class TomlDocument {
 public:
  /// Throws ConfigError when the file is missing or not TOML.
  static TomlDocument parse_file(const std::filesystem::path& path);
  static TomlDocument parse_text(std::string_view text, std::string name);

  TomlDocument(TomlDocument&&) noexcept;
  TomlDocument& operator=(TomlDocument&&) noexcept;
  ~TomlDocument();

  [[nodiscard]] TomlTable root() const;
  [[nodiscard]] const std::string& name() const;
  [[nodiscard]] const std::string& text() const;

  /// Reports every key that was not read (unless `ignore_rest` was called on its table), then throws
  /// ConfigError if anything at all was wrong.
  void finish() const;
  /// The same without throwing: what is wrong so far, sorted by place.
  [[nodiscard]] std::vector<Diagnostic> diagnostics() const;

  struct Impl;

 private:
  explicit TomlDocument(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// A view of one table; valid while its document lives. Getters never throw on bad content: they note a
/// diagnostic and return the fallback, so that one pass finds every error.
class TomlTable {
 public:
  [[nodiscard]] bool has(std::string_view key) const;  ///< does not count as reading it
  [[nodiscard]] std::vector<std::string> keys() const;

  /// Required forms: a missing key is an error, and the returned value is then meaningless.
  [[nodiscard]] double number(std::string_view key, Range range = {}) const;
  [[nodiscard]] std::int64_t integer(std::string_view key, Range range = {}) const;
  [[nodiscard]] bool boolean(std::string_view key) const;
  [[nodiscard]] std::string string(std::string_view key) const;
  [[nodiscard]] std::vector<double> numbers(std::string_view key, Range range = {}) const;
  [[nodiscard]] std::vector<std::string> strings(std::string_view key) const;
  /// One of `allowed`; anything else is an error that lists them.
  [[nodiscard]] std::string choice(std::string_view key, std::initializer_list<std::string_view> allowed) const;

  /// Optional forms.
  [[nodiscard]] double number_or(std::string_view key, double fallback, Range range = {}) const;
  [[nodiscard]] std::int64_t integer_or(std::string_view key, std::int64_t fallback, Range range = {}) const;
  [[nodiscard]] bool boolean_or(std::string_view key, bool fallback) const;
  [[nodiscard]] std::string string_or(std::string_view key, std::string_view fallback) const;
  [[nodiscard]] std::string choice_or(std::string_view key, std::string_view fallback,
                                      std::initializer_list<std::string_view> allowed) const;

  /// Sub-tables. Required: missing is an error and an empty table comes back.
  [[nodiscard]] TomlTable table(std::string_view key) const;
  [[nodiscard]] std::optional<TomlTable> table_if(std::string_view key) const;
  /// Array of tables (or of inline tables); absent gives an empty vector.
  [[nodiscard]] std::vector<TomlTable> tables(std::string_view key) const;

  /// What kind of value stands there: "string", "integer", "float", "boolean", "array", "table", "" (absent).
  [[nodiscard]] std::string_view type_of(std::string_view key) const;

  /// An error was noted at the value of `key`: the fallback stands for it, and nothing follows from that.
  [[nodiscard]] bool is_wrong(std::string_view key) const;
  void ignore_rest() const;  ///< further keys are allowed here
  /// Notes an error at `key` (or at the table itself, when the key is empty or absent).
  void error(std::string_view key, std::string message) const;
  /// Where the table or a key's value stands, for messages made later.
  [[nodiscard]] Diagnostic where(std::string_view key = {}) const;

  struct Node;
  TomlTable(TomlDocument::Impl* document, const void* table) : document_(document), table_(table) {}

 private:
  TomlDocument::Impl* document_;
  const void* table_;  // const toml::table*, kept out of this header; null for a missing table
};

}  // namespace isorig::base
