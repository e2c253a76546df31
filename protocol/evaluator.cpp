#include "protocol/evaluator.hpp"

#include <algorithm>
#include <cmath>

namespace isorig::protocol {
namespace {

std::string demand(base::Range range) {
  const std::string low = number_text(range.min), high = number_text(range.max);
  if (std::isfinite(range.min) && std::isfinite(range.max)) {
    return (range.open_min ? "above " + low + " and at most " : "from " + low + " to ") + high;
  }
  if (std::isfinite(range.min)) return (range.open_min ? "greater than " : "at least ") + low;
  return std::isfinite(range.max) ? "at most " + high : "a finite number";
}

}  // namespace

namespace {
/// Each turn of a repeat may have its own; nobody reads a thousand.
constexpr std::size_t kMaxNotes = 1000;
}  // namespace

std::size_t Evaluator::bind(const Bindings& row) {
  const std::size_t outer = bindings_.size();
  bindings_.insert(bindings_.end(), row.begin(), row.end());
  return outer;
}

double Evaluator::value(const syntax::Node& node, std::string_view key, base::Range range, double fallback) {
  const auto it = node.values.find(key);
  if (it == node.values.end()) return fallback;
  const double v = it->second.value(bindings_);
  const bool inside = std::isfinite(v) && (range.open_min ? v > range.min : v >= range.min) && v <= range.max;
  if (inside) return v;
  note(node.table, key, said(node, key, v) + "; it has to be " + demand(range));
  bad_.emplace(key);
  return fallback;
}

double Evaluator::whole(const syntax::Node& node, std::string_view key, base::Range range) {
  const double v = value(node, key, range, 1.0);
  if (v == std::floor(v)) return v;
  note(node.table, key, said(node, key, v) + "; it has to be a whole number");
  bad_.emplace(key);
  return 1.0;
}

bool Evaluator::all_well(const syntax::Node& node, std::initializer_list<std::string_view> keys) const {
  return std::none_of(keys.begin(), keys.end(),
                      [&](std::string_view key) { return node.broken.contains(key) || bad_.contains(key); });
}

std::string Evaluator::said(const syntax::Node& node, std::string_view key, double value) const {
  std::string out = "`" + std::string(key) + "` = " + number_text(value);
  const auto it = node.values.find(key);
  if (it == node.values.end()) return out;
  const char* joint = " with ";
  for (const auto& name : it->second.variables()) {
    out += joint + name + " = " + number_text(find(bindings_, name)->value);
    joint = ", ";
  }
  return out;
}

void Evaluator::note(const base::TomlTable& table, std::string_view key, std::string message) {
  if (noted_.size() >= kMaxNotes) return;
  const auto at = table.where(key);
  if (noted_.insert({at.line, at.column, message}).second) table.error(key, std::move(message));
}

}  // namespace isorig::protocol
