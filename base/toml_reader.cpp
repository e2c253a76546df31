#include "base/toml_reader.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <map>
#include <set>

#include "base/nearest.hpp"
#include "base/printable.hpp"
#include "base/text_file.hpp"
#include "base/toml_budget.hpp"

namespace isorig::base {
namespace {

std::string join(const std::vector<Diagnostic>& diagnostics) {
  std::string all;
  for (const auto& d : diagnostics) {
    if (!all.empty()) all += '\n';
    all += d.text();
  }
  return all;
}

std::string number_text(double value) {
  if (std::abs(value) < 1e15 && value == std::floor(value)) {
    return std::to_string(static_cast<std::int64_t>(value));
  }
  char digits[32];
  return {digits, std::to_chars(digits, digits + sizeof digits, value).ptr};
}

std::string range_text(Range range) {
  const bool low = std::isfinite(range.min), high = std::isfinite(range.max);
  if (low && high) {
    return std::string(range.open_min ? "above " : "from ") + number_text(range.min) + " to " + number_text(range.max);
  }
  if (low) return (range.open_min ? "greater than " : "at least ") + number_text(range.min);
  if (high) return "at most " + number_text(range.max);
  return "finite";
}

bool inside(double value, Range range) {
  return std::isfinite(value) && (range.open_min ? value > range.min : value >= range.min) && value <= range.max;
}

/// With its article.
std::string_view type_name(const toml::node& node) {
  switch (node.type()) {
    case toml::node_type::string:
      return "a string";
    case toml::node_type::integer:
      return "an integer";
    case toml::node_type::floating_point:
      return "a float";
    case toml::node_type::boolean:
      return "a boolean";
    case toml::node_type::array:
      return "an array";
    case toml::node_type::table:
      return "a table";
    default:
      return "a date or time";
  }
}

}  // namespace

std::string Diagnostic::text() const {
  if (line == 0) return printable(file + ": " + message);  // of the whole file
  return printable(file) + ":" + std::to_string(line) + ":" + std::to_string(column) + ": " + printable(message);
}

ConfigError::ConfigError(std::vector<Diagnostic> diagnostics)
    : std::runtime_error(join(diagnostics)), diagnostics_(std::move(diagnostics)) {}

namespace {

/// Nobody reads more of them; a damaged file of megabytes would have as many.
constexpr std::size_t kMaxDiagnostics = 200;
constexpr std::size_t kMaxMessageBytes = 600;

/// A value may be as long as its file.
void shorten(std::string& message) {
  if (message.size() <= kMaxMessageBytes) return;
  std::size_t cut = kMaxMessageBytes - 3;
  while (cut > 0 && (static_cast<unsigned char>(message[cut]) & 0xc0U) == 0x80) --cut;
  message.resize(cut);
  message += "...";
}

}  // namespace

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

  void note(Diagnostic diagnostic) {
    if (diagnostics.size() >= kMaxDiagnostics) {
      ++further;
      return;
    }
    shorten(diagnostic.message);
    diagnostics.push_back(std::move(diagnostic));
  }

  void find_unread(const toml::table& table, std::vector<Diagnostic>& out) const {
    const auto known = asked.find(&table);
    const bool is_open = open.contains(&table);
    for (const auto& [key, node] : table) {
      const std::string name_of_key(key.str());
      if (known == asked.end() || !known->second.contains(name_of_key)) {
        if (is_open) continue;
        if (out.size() > kMaxDiagnostics) return;
        std::string message = "unknown key `" + name_of_key + "`";
        std::string best;
        std::size_t best_distance = 1 + name_of_key.size() / 2;
        if (known != asked.end() && name_of_key.size() <= 64) {
          for (const auto& candidate : known->second) {
            const auto distance = edit_distance(name_of_key, candidate);
            if (distance < best_distance && !table.contains(candidate)) {
              best_distance = distance;
              best = candidate;
            }
          }
        }
        if (!best.empty()) {
          message += "; did you mean `" + best + "`?";
        } else if (known != asked.end() && !known->second.empty()) {
          message += "; known here:";
          for (const auto& candidate : known->second) message += " " + candidate;
        }
        shorten(message);
        out.push_back(at(key.source(), message));
        continue;
      }
      if (const auto* sub = node.as_table()) {
        if (asked.contains(sub)) find_unread(*sub, out);
      } else if (const auto* array = node.as_array()) {
        find_unread(*array, out);
      }
    }
  }

  void find_unread(const toml::array& array, std::vector<Diagnostic>& out) const {
    for (const auto& element : array) {
      if (const auto* sub = element.as_table()) {
        if (asked.contains(sub)) find_unread(*sub, out);
      } else if (const auto* inner = element.as_array()) {
        find_unread(*inner, out);
      }
    }
  }
};

TomlDocument::TomlDocument(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
TomlDocument::TomlDocument(TomlDocument&&) noexcept = default;
TomlDocument& TomlDocument::operator=(TomlDocument&&) noexcept = default;
TomlDocument::~TomlDocument() = default;

TomlDocument TomlDocument::parse_file(const std::filesystem::path& path) {
  if (auto why = why_not_a_file(path); !why.empty()) throw ConfigError({{path.string(), 0, 0, std::move(why)}});
  std::ifstream in(path, std::ios::binary);
  if (!in || std::filesystem::is_directory(path)) {
    throw ConfigError({{path.string(), 0, 0, "cannot be opened; check the path and its permissions"}});
  }
  // One byte more than is taken: a device without an end is not read to its end.
  std::string text(kMaxTomlBytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  return parse_text(text, path.string());
}

TomlDocument TomlDocument::parse_text(std::string_view text, std::string name) {
  if (auto over = over_budget(text))
    throw ConfigError({{std::move(name), over->line, over->column, std::move(over->message)}});
  auto impl = std::make_unique<Impl>();
  impl->name = std::move(name);
  impl->text = std::string(text);
  try {
    impl->root = toml::parse(impl->text, impl->name);
  } catch (const toml::parse_error& e) {
    throw ConfigError({impl->at(e.source(), "not valid TOML: " + std::string(e.description()))});
  }
  return TomlDocument(std::move(impl));
}

TomlTable TomlDocument::root() const {
  impl_->asked[&impl_->root];
  return {impl_.get(), &impl_->root};
}

const std::string& TomlDocument::name() const {
  return impl_->name;
}
const std::string& TomlDocument::text() const {
  return impl_->text;
}

std::vector<Diagnostic> TomlDocument::diagnostics() const {
  auto all = impl_->diagnostics;
  impl_->find_unread(impl_->root, all);
  std::stable_sort(all.begin(), all.end(), [](const Diagnostic& a, const Diagnostic& b) {
    return std::pair(a.line, a.column) < std::pair(b.line, b.column);
  });
  if (all.size() > kMaxDiagnostics || impl_->further > 0) {
    all.resize(std::min(all.size(), kMaxDiagnostics));
    all.push_back({impl_->name, 0, 0, "and further faults; correct these first"});
  }
  return all;
}

void TomlDocument::finish() const {
  auto all = diagnostics();
  if (!all.empty()) throw ConfigError(std::move(all));
}

namespace {

const toml::table* as_table(const void* table) {
  return static_cast<const toml::table*>(table);
}

const toml::node* find(TomlDocument::Impl* document, const void* table, std::string_view key) {
  if (table == nullptr) return nullptr;
  document->asked[as_table(table)].emplace(key);
  return as_table(table)->get(key);
}

}  // namespace

bool TomlTable::has(std::string_view key) const {
  return table_ != nullptr && as_table(table_)->contains(key);
}

std::vector<std::string> TomlTable::keys() const {
  std::vector<std::string> out;
  if (table_ != nullptr) {
    for (const auto& [key, node] : *as_table(table_)) out.emplace_back(key.str());
  }
  return out;
}

Diagnostic TomlTable::where(std::string_view key) const {
  if (table_ == nullptr) return {document_->name, 0, 0, {}};
  if (!key.empty()) {
    if (const auto* node = as_table(table_)->get(key)) return document_->at(node->source(), {});
  }
  return document_->at(as_table(table_)->source(), {});
}

void TomlTable::error(std::string_view key, std::string message) const {
  if (table_ == nullptr) return;  // the missing table itself was reported
  auto diagnostic = where(key);
  diagnostic.message = std::move(message);
  document_->note(std::move(diagnostic));
}

std::string_view TomlTable::type_of(std::string_view key) const {
  if (table_ == nullptr) return {};
  const auto* node = as_table(table_)->get(key);
  return node == nullptr ? std::string_view{} : type_name(*node).substr(type_name(*node).find(' ') + 1);
}

void TomlTable::ignore_rest() const {
  if (table_ != nullptr) document_->open.insert(as_table(table_));
}

double TomlTable::number_or(std::string_view key, double fallback, Range range) const {
  const auto* node = find(document_, table_, key);
  if (node == nullptr) return fallback;
  const auto value = node->value<double>();
  if (!value || node->is_boolean()) {
    error(key, "`" + std::string(key) + "` is " + std::string(type_name(*node)) + "; a number is needed");
    return fallback;
  }
  if (!inside(*value, range)) {
    error(key, "`" + std::string(key) + "` = " + number_text(*value) + "; it has to be " + range_text(range));
    return fallback;
  }
  return *value;
}

std::int64_t TomlTable::integer_or(std::string_view key, std::int64_t fallback, Range range) const {
  const auto* node = find(document_, table_, key);
  if (node == nullptr) return fallback;
  const auto value = node->is_integer() ? node->value<std::int64_t>() : std::nullopt;
  if (!value) {
    error(key, "`" + std::string(key) + "` is " + std::string(type_name(*node)) + "; a whole number is needed");
    return fallback;
  }
  if (!inside(static_cast<double>(*value), range)) {
    error(key, "`" + std::string(key) + "` = " + std::to_string(*value) + "; it has to be " + range_text(range));
    return fallback;
  }
  return *value;
}

bool TomlTable::boolean_or(std::string_view key, bool fallback) const {
  const auto* node = find(document_, table_, key);
  if (node == nullptr) return fallback;
  if (!node->is_boolean()) {
    error(key, "`" + std::string(key) + "` is " + std::string(type_name(*node)) + "; true or false is needed");
    return fallback;
  }
  return *node->value<bool>();
}

std::string TomlTable::string_or(std::string_view key, std::string_view fallback) const {
  const auto* node = find(document_, table_, key);
  if (node == nullptr) return std::string(fallback);
  if (!node->is_string()) {
    error(key, "`" + std::string(key) + "` is " + std::string(type_name(*node)) + "; a \"string\" is needed");
    return std::string(fallback);
  }
  return *node->value<std::string>();
}

std::string TomlTable::choice_or(std::string_view key, std::string_view fallback,
                                 std::initializer_list<std::string_view> allowed) const {
  auto value = string_or(key, fallback);
  if (std::find(allowed.begin(), allowed.end(), value) == allowed.end() && value != fallback) {
    std::string message = "`" + std::string(key) + "` = \"" + value + "\"; it has to be one of";
    for (auto a : allowed) message += " \"" + std::string(a) + "\"";
    error(key, message);
    return std::string(fallback);
  }
  return value;
}

namespace {
std::string missing(std::string_view key) {
  return "`" + std::string(key) + "` is missing here";
}
}  // namespace

double TomlTable::number(std::string_view key, Range range) const {
  if (!has(key)) error({}, missing(key));
  return number_or(key, std::isfinite(range.min) ? range.min : 0.0, range);
}

std::int64_t TomlTable::integer(std::string_view key, Range range) const {
  if (!has(key)) error({}, missing(key));
  return integer_or(key, std::isfinite(range.min) ? static_cast<std::int64_t>(range.min) : 0, range);
}

bool TomlTable::boolean(std::string_view key) const {
  if (!has(key)) error({}, missing(key));
  return boolean_or(key, false);
}

std::string TomlTable::string(std::string_view key) const {
  if (!has(key)) error({}, missing(key));
  return string_or(key, {});
}

std::string TomlTable::choice(std::string_view key, std::initializer_list<std::string_view> allowed) const {
  if (!has(key)) {
    std::string message = missing(key) + "; one of";
    for (auto a : allowed) message += " \"" + std::string(a) + "\"";
    error({}, message);
  }
  return choice_or(key, *allowed.begin(), allowed);
}

std::vector<double> TomlTable::numbers(std::string_view key, Range range) const {
  std::vector<double> out;
  if (!has(key)) error({}, missing(key));
  const auto* node = find(document_, table_, key);
  if (node == nullptr) return out;
  const auto* array = node->as_array();
  if (array == nullptr) {
    error(key, "`" + std::string(key) + "` is " + std::string(type_name(*node)) + "; a list of numbers is needed");
    return out;
  }
  for (const auto& element : *array) {
    const auto value = element.value<double>();
    if (!value || element.is_boolean() || !inside(*value, range)) {
      const bool number = element.is_number() && value;
      document_->note(
          document_->at(element.source(), "`" + std::string(key) + "` holds " +
                                              (number ? number_text(*value) + "; each has to be " + range_text(range)
                                                      : std::string(type_name(element)) + "; a number is needed")));
      continue;
    }
    out.push_back(*value);
  }
  return out;
}

std::vector<std::string> TomlTable::strings(std::string_view key) const {
  std::vector<std::string> out;
  if (!has(key)) error({}, missing(key));
  const auto* node = find(document_, table_, key);
  if (node == nullptr) return out;
  const auto* array = node->as_array();
  if (array == nullptr) {
    error(key, "`" + std::string(key) + "` is " + std::string(type_name(*node)) + "; a list of strings is needed");
    return out;
  }
  for (const auto& element : *array) {
    if (const auto value = element.value<std::string>()) {
      out.push_back(*value);
    } else {
      document_->note(document_->at(
          element.source(),
          "`" + std::string(key) + "` holds " + std::string(type_name(element)) + "; a \"string\" is needed"));
    }
  }
  return out;
}

std::optional<TomlTable> TomlTable::table_if(std::string_view key) const {
  const auto* node = find(document_, table_, key);
  if (node == nullptr) return std::nullopt;
  const auto* sub = node->as_table();
  if (sub == nullptr) {
    error(key, "`" + std::string(key) + "` is " + std::string(type_name(*node)) + "; a table [" + std::string(key) +
                   "] is needed");
    return std::nullopt;
  }
  document_->asked[sub];
  return TomlTable(document_, sub);
}

TomlTable TomlTable::table(std::string_view key) const {
  if (!has(key)) error({}, "table [" + std::string(key) + "] is missing");
  return table_if(key).value_or(TomlTable(document_, nullptr));
}

std::vector<TomlTable> TomlTable::tables(std::string_view key) const {
  std::vector<TomlTable> out;
  const auto* node = find(document_, table_, key);
  if (node == nullptr) return out;
  const auto* array = node->as_array();
  if (array == nullptr) {
    error(key, "`" + std::string(key) + "` is " + std::string(type_name(*node)) + "; a list of tables is needed");
    return out;
  }
  for (const auto& element : *array) {
    if (const auto* sub = element.as_table()) {
      document_->asked[sub];
      out.emplace_back(document_, sub);
    } else {
      document_->note(document_->at(element.source(), "`" + std::string(key) + "` holds " +
                                                          std::string(type_name(element)) + "; a table is needed"));
    }
  }
  return out;
}

}  // namespace isorig::base
