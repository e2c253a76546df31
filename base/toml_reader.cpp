#include "base/toml_reader.hpp"

#include <algorithm>
#include <cmath>

#include "base/number_text.hpp"
#include "base/toml_document.hpp"
#include "base/toml_observer.hpp"

namespace isorig::base {
namespace {

/// As somebody would write the number: 1000000, not 1e+06.
std::string written(double value) {
  if (std::abs(value) < 1e15 && value == std::floor(value)) return std::to_string(static_cast<std::int64_t>(value));
  return exact_number_text(value);
}

std::string range_text(Range range) {
  const bool low = std::isfinite(range.min), high = std::isfinite(range.max);
  if (low && high) {
    return std::string(range.open_min ? "above " : "from ") + written(range.min) + " to " + written(range.max);
  }
  if (low) return (range.open_min ? "greater than " : "at least ") + written(range.min);
  if (high) return "at most " + written(range.max);
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

const toml::table* as_table(const void* table) {
  return static_cast<const toml::table*>(table);
}

using Kind = TomlObserver::Kind;
thread_local TomlObserver* observer = nullptr;

void tell(const void* table, const TomlObserver::Asked& asked) {
  if (observer != nullptr && table != nullptr) observer->asked(table, asked);
}

const toml::node* find(TomlDocument::Impl* document, const void* table, std::string_view key) {
  if (table == nullptr) return nullptr;
  document->asked[as_table(table)].emplace(key);
  return as_table(table)->get(key);
}

}  // namespace

TomlObserver::TomlObserver() {
  observer = this;
}
TomlObserver::~TomlObserver() {
  observer = nullptr;
}
TomlObserver* TomlObserver::of_this_thread() {
  return observer;
}

bool TomlTable::has(std::string_view key) const {
  return table_ != nullptr && as_table(table_)->contains(key);
}

std::vector<std::string> TomlTable::keys() const {
  std::vector<std::string> out;
  if (table_ != nullptr) {
    if (observer != nullptr) observer->open(table_);
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

bool TomlTable::is_wrong(std::string_view key) const {
  if (!has(key)) return false;
  const auto at = where(key);
  return std::any_of(document_->diagnostics.begin(), document_->diagnostics.end(),
                     [&](const Diagnostic& d) { return d.line == at.line && d.column == at.column; });
}

void TomlTable::error(std::string_view key, std::string message) const {
  if (table_ == nullptr) return;  // the missing table itself was reported
  auto diagnostic = where(key);
  diagnostic.message = std::move(message);
  document_->note(std::move(diagnostic));
}

std::string_view TomlTable::type_of(std::string_view key) const {
  if (table_ == nullptr) return {};
  tell(table_, {key});
  const auto* node = as_table(table_)->get(key);
  return node == nullptr ? std::string_view{} : type_name(*node).substr(type_name(*node).find(' ') + 1);
}

void TomlTable::ignore_rest() const {
  if (table_ == nullptr) return;
  document_->open.insert(as_table(table_));
  if (observer != nullptr) observer->open(table_);
}

double TomlTable::number_or(std::string_view key, double fallback, Range range) const {
  tell(table_, {key, Kind::kNumber, false, range});
  const auto* node = find(document_, table_, key);
  if (node == nullptr) return fallback;
  const auto value = node->value<double>();
  if (!value || node->is_boolean()) {
    error(key, "`" + std::string(key) + "` is " + std::string(type_name(*node)) + "; a number is needed");
    return fallback;
  }
  if (!inside(*value, range)) {
    error(key, "`" + std::string(key) + "` = " + written(*value) + "; it has to be " + range_text(range));
    return fallback;
  }
  return *value;
}

std::int64_t TomlTable::integer_or(std::string_view key, std::int64_t fallback, Range range) const {
  tell(table_, {key, Kind::kInteger, false, range});
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
  tell(table_, {key, Kind::kBoolean});
  const auto* node = find(document_, table_, key);
  if (node == nullptr) return fallback;
  if (!node->is_boolean()) {
    error(key, "`" + std::string(key) + "` is " + std::string(type_name(*node)) + "; true or false is needed");
    return fallback;
  }
  return *node->value<bool>();
}

std::string TomlTable::string_or(std::string_view key, std::string_view fallback) const {
  tell(table_, {key, Kind::kString});
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
  tell(table_, {key, Kind::kString, false, {}, {allowed.begin(), allowed.size()}});
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
  tell(table_, {key, Kind::kNumber, true});
  if (!has(key)) error({}, missing(key));
  return number_or(key, std::isfinite(range.min) ? range.min : 0.0, range);
}

std::int64_t TomlTable::integer(std::string_view key, Range range) const {
  tell(table_, {key, Kind::kInteger, true});
  if (!has(key)) error({}, missing(key));
  return integer_or(key, std::isfinite(range.min) ? static_cast<std::int64_t>(range.min) : 0, range);
}

bool TomlTable::boolean(std::string_view key) const {
  tell(table_, {key, Kind::kBoolean, true});
  if (!has(key)) error({}, missing(key));
  return boolean_or(key, false);
}

std::string TomlTable::string(std::string_view key) const {
  tell(table_, {key, Kind::kString, true});
  if (!has(key)) error({}, missing(key));
  return string_or(key, {});
}

std::string TomlTable::choice(std::string_view key, std::initializer_list<std::string_view> allowed) const {
  tell(table_, {key, Kind::kString, true, {}, {allowed.begin(), allowed.size()}});
  if (!has(key)) {
    std::string message = missing(key) + "; one of";
    for (auto a : allowed) message += " \"" + std::string(a) + "\"";
    error({}, message);
  }
  return choice_or(key, *allowed.begin(), allowed);
}

std::vector<double> TomlTable::numbers(std::string_view key, Range range) const {
  std::vector<double> out;
  tell(table_, {key, Kind::kNumbers, true, range});
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
                                              (number ? written(*value) + "; each has to be " + range_text(range)
                                                      : std::string(type_name(element)) + "; a number is needed")));
      continue;
    }
    out.push_back(*value);
  }
  return out;
}

std::vector<std::string> TomlTable::strings(std::string_view key) const {
  std::vector<std::string> out;
  tell(table_, {key, Kind::kStrings, true});
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
  tell(table_, {key, Kind::kTable});
  const auto* node = find(document_, table_, key);
  if (node == nullptr) return std::nullopt;
  const auto* sub = node->as_table();
  if (sub == nullptr) {
    error(key, "`" + std::string(key) + "` is " + std::string(type_name(*node)) + "; a table [" + std::string(key) +
                   "] is needed");
    return std::nullopt;
  }
  document_->asked[sub];
  if (observer != nullptr) observer->inside(table_, key, sub, -1);
  return TomlTable(document_, sub);
}

TomlTable TomlTable::table(std::string_view key) const {
  tell(table_, {key, Kind::kTable, true});
  if (!has(key)) error({}, "table [" + std::string(key) + "] is missing");
  return table_if(key).value_or(TomlTable(document_, nullptr));
}

std::vector<TomlTable> TomlTable::tables(std::string_view key) const {
  std::vector<TomlTable> out;
  tell(table_, {key, Kind::kTables});
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
      if (observer != nullptr) observer->inside(table_, key, sub, static_cast<int>(out.size()));
      out.emplace_back(document_, sub);
    } else {
      document_->note(document_->at(element.source(), "`" + std::string(key) + "` holds " +
                                                          std::string(type_name(element)) + "; a table is needed"));
    }
  }
  return out;
}

}  // namespace isorig::base
