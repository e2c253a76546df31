#include "protocol/syntax.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <limits>
#include <utility>

#include "base/printable.hpp"

namespace isorig::protocol::syntax {
namespace {

/// Every name in force is looked through for every value: many would make a long file slow.
constexpr std::size_t kMaxNames = 64;
constexpr std::size_t kMaxNameBytes = 64;
constexpr std::size_t kMaxLabelBytes = 200;
constexpr std::size_t kMaxProtocolNameBytes = 100;

/// It goes to terminals, logs and the names of runs.
std::string read_protocol_name(const base::TomlTable& root) {
  auto name = root.string("name");
  if (root.type_of("name") != "string") return name;
  if (name.empty() || name.size() > kMaxProtocolNameBytes) {
    root.error("name", "`name` has " + std::to_string(name.size()) + " bytes; it has to be 1 to " +
                           std::to_string(kMaxProtocolNameBytes) + ", since runs and listings are named by it");
  } else if (base::printable(name) != name) {
    root.error("name", "`name` holds a control character or a mark that hides text; one line of plain text is needed");
  }
  return name;
}

/// A label goes to terminals, logs and file names: one line of printable text.
std::string read_label(const base::TomlTable& table) {
  auto label = table.string_or("label", {});
  if (label.size() > kMaxLabelBytes) {
    table.error("label", "`label` has " + std::to_string(label.size()) + " bytes; at most " +
                             std::to_string(kMaxLabelBytes) + " are taken");
    label.clear();
  } else if (base::printable(label) != label) {
    table.error("label",
                "`label` holds a control character or a mark that hides text; one line of plain text is needed");
    label.clear();
  }
  return label;
}

using base::TomlTable;
using Names = std::vector<std::string>;

std::string list(const Names& names) {
  std::string out;
  for (const auto& name : names) out += (out.empty() ? "" : ", ") + name;
  return out.empty() ? "none" : out;
}

/// Keys in the order in which they are written: TOML tables have none, but people read them so.
Names keys_as_written(const TomlTable& table) {
  auto keys = table.keys();
  if (keys.size() > 2 * kMaxNames) return keys;  // too many, and about to be refused as such
  std::sort(keys.begin(), keys.end(), [&](const std::string& a, const std::string& b) {
    const auto at_a = table.where(a), at_b = table.where(b);
    return std::pair(at_a.line, at_a.column) < std::pair(at_b.line, at_b.column);
  });
  return keys;
}

bool usable_name(const TomlTable& table, const std::string& name, const Names& scope) {
  if (!is_name(name)) {
    table.error(name, "`" + name + "` cannot name a variable; use letters, digits and _ (with the unit)");
    return false;
  }
  if (name.size() > kMaxNameBytes) {
    table.error(name, "`" + name.substr(0, 20) + "...` has " + std::to_string(name.size()) + " bytes; at most " +
                          std::to_string(kMaxNameBytes) + " are taken for a name");
    return false;
  }
  if (scope.size() >= kMaxNames) {
    table.error(name,
                "`" + name + "` is one name too many; at most " + std::to_string(kMaxNames) + " are bound at a time");
    return false;
  }
  if (std::find(scope.begin(), scope.end(), name) != scope.end()) {
    table.error(name, "`" + name + "` is bound already further out; choose another name");
    return false;
  }
  return true;
}

enum class Need { kRequired, kOptional };

void read_value(Node& node, std::string_view key, Need need, const Names& scope) {
  const std::string name(key);
  if (!node.table.has(key)) {
    if (need == Need::kRequired) {
      (void)node.table.number(key);  // notes that it is missing
      node.broken.insert(name);
    } else {
      (void)node.table.number_or(key, 0.0);  // makes the key known
    }
    return;
  }
  if (node.table.type_of(key) != "string") {
    // Not the fallback that number() has for what is none: it would be complained about again.
    const double value = node.table.number_or(key, std::numeric_limits<double>::quiet_NaN());
    const auto type = node.table.type_of(key);
    if ((type == "integer" || type == "float") && std::isfinite(value)) {
      node.values.emplace(name, Expression(value));
    } else {
      node.broken.insert(name);
    }
    return;
  }
  const std::string text = node.table.string(key);
  std::string error;
  auto expression = Expression::parse(text, error);
  if (!expression) {
    node.table.error(key, "`" + name + "` = \"" + text + "\": " + error);
    node.broken.insert(name);
    return;
  }
  bool bound = true;
  for (const auto& variable : expression->variables()) {
    if (std::find(scope.begin(), scope.end(), variable) != scope.end()) continue;
    node.table.error(key, "`" + name + "`: unknown variable `" + variable + "`; bound here: " + list(scope));
    bound = false;
  }
  if (bound) {
    node.values.emplace(name, *std::move(expression));
  } else {
    node.broken.insert(name);
  }
}

void read_values(Node& node, Need need, const Names& scope, std::initializer_list<std::string_view> keys) {
  for (const auto key : keys) read_value(node, key, need, scope);
}

std::vector<Node> read_steps(const TomlTable& table, const Names& scope, bool in_session);

void read_rows_of_lists(Node& node, const TomlTable& lists, Names& scope) {
  for (const auto& name : keys_as_written(lists)) {
    const bool usable = usable_name(lists, name, scope);
    auto values = lists.type_of(name) == "array" ? lists.numbers(name) : std::vector{lists.number(name)};
    if (values.empty()) lists.error(name, "`" + name + "` has no values; give at least one number");
    if (!usable || values.empty()) continue;
    scope.push_back(name);
    node.lists.push_back({name, std::move(values)});
  }
}

void read_rows_of_tables(Node& node, Names& scope) {
  Names names;
  const auto tables = node.table.tables("for");
  if (tables.empty()) node.table.error("for", "`for` has no values; give at least one row");
  for (const auto& table : tables) {
    auto keys = keys_as_written(table);
    if (names.empty()) {
      for (const auto& name : keys) {
        if (usable_name(table, name, scope)) names.push_back(name);
      }
      scope.insert(scope.end(), names.begin(), names.end());
    }
    Bindings row;
    for (const auto& name : keys) {
      const double value = table.number(name);
      if (std::find(names.begin(), names.end(), name) != names.end()) {
        row.push_back({name, value});
      } else if (&table != &tables.front()) {
        table.error(name, "`" + name + "` is not in the first row; every row binds the same names: " + list(names));
      }
    }
    if (row.size() < names.size()) {
      table.error({}, "this row does not bind all names that the first one does: " + list(names));
      for (const auto& name : names) {
        if (find(row, name) == nullptr) row.push_back({name, 0.0});
      }
    }
    node.rows.push_back(std::move(row));
  }
}

void read_repeat(Node& node, Names scope, bool in_session) {
  const auto& table = node.table;
  node.is_repeat = true;
  if (table.has("unit")) {
    (void)table.choice("unit", {"session"});
    node.is_session = table.string_or("unit", {}) == "session";
    if (node.is_session && in_session) {
      table.error("unit", "a session cannot hold another session; take `unit` off one of them");
    }
  } else {
    (void)table.string_or("unit", {});
  }
  const std::int64_t times = table.integer_or("times", 1, {1.0, 1e5});
  const auto type = table.type_of("for");
  if (type == "array") {
    read_rows_of_tables(node, scope);
  } else if (const auto lists = table.table_if("for")) {
    read_rows_of_lists(node, *lists, scope);
  } else {
    node.times = static_cast<double>(times);
    if (type.empty() && !table.has("times") && !table.has("unit")) {
      table.error({}, "a repeat needs `for` (values to go through) or `times`");
    }
  }
  if (!type.empty() && table.has("times")) {
    table.error("times", "give either `for` or `times`; put one repeat into another for both");
  }
  if (node.is_session) {
    // Its own name is the default; a label may use it.
    if (!table.has("repetition") && std::find(scope.begin(), scope.end(), "repetition") != scope.end()) {
      std::string unused;
      node.values.emplace("repetition", *Expression::parse("repetition", unused));
    }
    read_value(node, "repetition", Need::kOptional, scope);
    node.label = read_label(table);
  }
  if (!table.has("steps")) table.error({}, "`steps` is missing here: what to repeat");
  node.body = read_steps(table, scope, in_session || node.is_session);
}

void read_step(Node& node, const Names& scope) {
  const auto& table = node.table;
  switch (node.kind) {
    case StepKind::kPressurize:
      read_values(node, Need::kRequired, scope, {"pressure_psi", "rate_psi_s", "settled_for_s", "timeout_s"});
      read_values(node, Need::kOptional, scope, {"tolerance_psi"});
      break;
    case StepKind::kSettle:
      read_values(node, Need::kRequired, scope, {"force_slope_N_s", "window_s", "timeout_s"});
      read_values(node, Need::kOptional, scope, {"settled_for_s", "expected_s"});
      if (table.choice_or("on_timeout", "stop", {"continue", "stop"}) == "continue") {
        node.on_timeout = OnTimeout::kContinue;
      }
      break;
    case StepKind::kRamp:
      read_values(node, Need::kRequired, scope, {"to_mm", "velocity_mm_s"});
      break;
    case StepKind::kHold:
      read_values(node, Need::kRequired, scope, {"duration_s"});
      break;
    case StepKind::kWave:
      if (table.choice("shape", {"triangle", "sine"}) == "sine") {
        node.shape = WaveShape::kSine;
        read_values(node, Need::kOptional, scope, {"deviation_mm"});
      }
      read_values(node, Need::kRequired, scope, {"amplitude_mm", "cycles"});
      read_values(node, Need::kOptional, scope, {"frequency_hz", "velocity_mm_s", "frequency_tolerance"});
      if (table.has("frequency_hz") == table.has("velocity_mm_s")) {
        table.error({}, "a wave needs either `frequency_hz` or `velocity_mm_s`");
        node.broken.insert("frequency_hz");
      } else if (table.has("frequency_tolerance") && !table.has("frequency_hz")) {
        table.error("frequency_tolerance", "`frequency_tolerance` is of `frequency_hz`, and this wave has none");
      }
      break;
    case StepKind::kMark:
      node.label = table.has("label") ? read_label(table) : table.string("label");
      break;
  }
  if (node.kind != StepKind::kMark && table.has("record")) {
    const auto record = table.choice("record", {"full", "averaged"});
    node.record = record == "full" ? Keep::kFull : Keep::kAveraged;
  } else if (node.kind != StepKind::kMark) {
    (void)table.string_or("record", {});
  }
}

std::vector<Node> read_steps(const TomlTable& table, const Names& scope, bool in_session) {
  static constexpr std::array kKinds{StepKind::kPressurize, StepKind::kSettle, StepKind::kRamp,
                                     StepKind::kHold,       StepKind::kWave,   StepKind::kMark};
  std::vector<Node> out;
  for (const auto& step : table.tables("steps")) {
    Node node(step);
    const std::string verb = step.string_or("do", {});
    if (verb == "repeat") {
      read_repeat(node, scope, in_session);
      out.push_back(std::move(node));
      continue;
    }
    const auto kind = std::find_if(kKinds.begin(), kKinds.end(), [&](StepKind k) { return verb == name_of(k); });
    if (kind == kKinds.end()) {
      static constexpr auto kVerbs = "pressurize, settle, ramp, hold, wave, mark or repeat";
      if (!step.has("do")) {
        step.error({}, std::string("`do` is missing here: ") + kVerbs);
      } else if (step.type_of("do") == "string") {
        step.error("do", "`do` = \"" + verb + "\"; it has to be " + kVerbs);
      }
      step.ignore_rest();
      continue;
    }
    node.kind = *kind;
    read_step(node, scope);
    out.push_back(std::move(node));
  }
  return out;
}

RecordingPolicy read_recording(const TomlTable& table) {
  RecordingPolicy out;
  const auto policy = table.choice_or("policy", "round_ramps", {"round_ramps", "full", "averaged"});
  if (policy == "full") out.mode = RecordingMode::kFull;
  if (policy == "averaged") out.mode = RecordingMode::kAveraged;
  out.before_s = table.number_or("before_s", out.before_s, {0.0, 60.0});
  out.after_s = table.number_or("after_s", out.after_s, {0.0, 3600.0});
  out.average_interval_s = table.number_or("average_interval_s", out.average_interval_s, {0.01, 60.0});
  return out;
}

/// A file beside others, not a path: isorig-web looks it up in its own folder, whoever wrote the protocol.
bool is_model_name(std::string_view name) {
  const auto plain = [](unsigned char c) { return std::isalnum(c) != 0 || c == '-' || c == '_' || c == '.'; };
  return name.size() > 5 && name.size() <= 128 && name.front() != '.' && name.ends_with(".toml") &&
         std::all_of(name.begin(), name.end(), plain);
}

TwinWish read_twin(const TomlTable& table) {
  TwinWish out;
  out.model = table.string("model");
  if (table.type_of("model") == "string" && !is_model_name(out.model)) {
    table.error("model", "`model` = \"" + base::printable(out.model) +
                             "\"; it has to be the name of a file in isorig-web's folder of models, such as "
                             "\"muscle-5psi.toml\": letters, digits, - _ . and no path");
  }
  const auto what = table.choice_or("on_parting", "mark", {"mark", "pause", "abort"});
  if (what == "pause") out.on_parting = TwinWish::OnParting::kPause;
  if (what == "abort") out.on_parting = TwinWish::OnParting::kAbort;
  return out;
}

}  // namespace

double Node::turns() const {
  if (!rows.empty()) return static_cast<double>(rows.size());
  double turns = times;
  for (const auto& list : lists) turns *= static_cast<double>(list.values.size());
  return turns;
}

Bindings Node::bindings_of(std::size_t index) const {
  if (!rows.empty()) return rows[index];
  Bindings row(lists.size());
  for (std::size_t i = lists.size(); i-- > 0;) {
    const auto& list = lists[i].values;
    row[i] = {lists[i].name, list[index % list.size()]};
    index /= list.size();
  }
  return row;
}

Protocol parse(const TomlTable& root) {
  Protocol out;
  if (root.choice("format", {"isorig-protocol/1"}).empty()) return out;
  out.name = read_protocol_name(root);
  out.description = root.string_or("description", {});
  out.approaches = root.boolean_or("approach", true);
  out.approach_velocity_mm_s = root.number_or("approach_velocity_mm_s", out.approach_velocity_mm_s, base::kPositive);
  if (const auto table = root.table_if("recording")) out.recording = read_recording(*table);
  if (const auto table = root.table_if("twin")) out.twin = read_twin(*table);
  Names scope;
  if (const auto table = root.table_if("constants")) {
    for (const auto& name : keys_as_written(*table)) {
      const bool usable = usable_name(*table, name, scope);
      const double value = table->number(name);
      if (!usable) continue;
      scope.push_back(name);
      out.constants.push_back({name, value});
    }
  }
  if (!root.has("steps")) {
    root.error({}, "`steps` is missing: the list of what to do, before the first [table] of the file");
  }
  out.steps = read_steps(root, scope, false);
  return out;
}

}  // namespace isorig::protocol::syntax
