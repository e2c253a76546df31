#include "cli/protocols/schema_of_readers.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <set>
#include <sstream>
#include <utility>

#include "base/toml_observer.hpp"

namespace isorig::cli {
namespace {

using base::TomlObserver;
using Json = nlohmann::ordered_json;
using Kind = TomlObserver::Kind;

constexpr const char* kProbeName = "schema-probe.toml";
constexpr const char* kProbeText = "1";
/// Far more than any file asks for: whoever runs into it has made a reader that never ends.
constexpr std::size_t kMostProbes = 20000;

struct Key {
  std::set<Kind> kinds;
  std::set<std::string> choices;
  double min = INFINITY, max = -INFINITY;  ///< widest of what was asked; none yet
  bool open_min = true;
  std::size_t required = 0;  ///< readings in which it was
};

/// What readers do while a condition holds: of every key how often it was not there, and how often it was demanded
/// then.
struct Under {
  std::set<std::string> asked;
  std::map<std::string, std::pair<std::size_t, std::size_t>> absent_and_required;
  std::size_t readings = 0;

  [[nodiscard]] bool demands(const std::string& key) const {
    const auto found = absent_and_required.find(key);
    return found != absent_and_required.end() && found->second.first > 0 && found->second.first == found->second.second;
  }
};

struct Table {
  std::map<std::string, Key> keys;
  std::size_t readings = 0, open = 0;
  std::map<std::string, std::map<std::string, Under>> word;  ///< by key and its word
};

/// Where a table stands in a document: keys, and indices of lists.
using Place = std::vector<std::pair<std::string, int>>;

class Prober : TomlObserver {
 public:
  explicit Prober(const std::vector<ReadText>& readers) : readers_(readers) {}

  void probe(toml::table document) {
    waiting_.push_back(std::move(document));
    for (std::size_t count = 0; !waiting_.empty(); ++count) {
      if (count > kMostProbes) throw std::logic_error("the readers ask for ever more keys");
      document_ = std::move(waiting_.front());
      waiting_.pop_front();
      std::ostringstream text;
      text << document_;
      for (const auto& read : readers_) {
        begin_reading();
        try {
          read(text.str(), kProbeName);
        } catch (const std::exception&) {  // a probe is rarely right; what was asked counts
        }
        end_reading();
      }
    }
  }

  [[nodiscard]] Json schema(const std::string& title) const {
    Json out{{"$schema", "http://json-schema.org/draft-07/schema#"}, {"title", title}};
    out.update(object(""));
    return out;
  }

 private:
  struct Seen {
    std::string path;
    Place place;
  };

  /// A table in one reading.
  struct Instance {
    Seen seen;
    std::set<std::string> asked, required;
  };

  void begin_reading() {
    instances_.clear();
    places_.clear();
    opened_.clear();
    required_.clear();
  }
  void end_reading() {
    std::set<std::string> here;
    for (const auto& [table, seen] : places_) here.insert(seen.path);
    for (const auto& path : here) ++tables_[path].readings;
    for (const auto& path : opened_) ++tables_[path].open;
    for (const auto& [path, key] : required_) ++tables_[path].keys[key].required;
    for (const auto& [table, instance] : instances_) count_conditions(instance);
  }

  void count_conditions(const Instance& instance) {
    const toml::table* there = located(document_, instance.seen.place);
    if (there == nullptr) return;
    const auto count = [&](Under& under) {
      ++under.readings;
      under.asked.insert(instance.asked.begin(), instance.asked.end());
      for (const auto& key : instance.asked) {
        if (there->contains(key)) continue;
        auto& [absent, required] = under.absent_and_required[key];
        ++absent;
        required += instance.required.contains(key) ? 1 : 0;
      }
      // Not even asked for in this reading: not demanded.
      for (auto& [key, counts] : under.absent_and_required) {
        if (!instance.asked.contains(key)) ++counts.first;
      }
    };
    Table& table = tables_[instance.seen.path];
    for (const auto& [key, node] : *there) {
      const std::string name(key.str());
      if (const auto word = node.value<std::string>(); node.is_string() && *word != kProbeText) {
        count(table.word[name][*word]);
      }
    }
  }

  void root(const std::string& document, const void* table) override {
    if (document.ends_with(kProbeName)) places_[table] = {"", {}};
  }
  void open(const void* table) override {
    if (const auto at = places_.find(table); at != places_.end()) opened_.insert(at->second.path);
  }
  void inside(const void* table, std::string_view key, const void* child, int index) override {
    const auto at = places_.find(table);
    if (at == places_.end()) return;
    Seen seen = at->second;
    seen.place.emplace_back(key, index);
    const std::string step = "/" + std::string(key) + (index < 0 ? "" : "[]");
    // A list of the same name in a list: steps in steps are the same kind of step.
    if (index < 0 || !seen.path.ends_with(step)) seen.path += step;
    places_.emplace(child, std::move(seen));
  }
  void asked(const void* table, const Asked& what) override {
    const auto at = places_.find(table);
    if (at == places_.end()) return;
    const auto& [path, place] = at->second;
    const std::string name(what.key);
    auto& instance = instances_.try_emplace(table, Instance{at->second, {}, {}}).first->second;
    instance.asked.insert(name);
    if (what.required) instance.required.insert(name);
    auto& key = tables_[path].keys[name];
    key.kinds.insert(what.kind);
    if (what.required) required_.emplace(path, name);
    for (const auto choice : what.choices) key.choices.emplace(choice);
    if (what.range.min < key.min || (what.range.min == key.min && !what.range.open_min)) {
      key.min = what.range.min;
      key.open_min = what.range.open_min;
    }
    key.max = std::max(key.max, what.range.max);
    // Deep enough: a step in a repeat in a repeat.
    if (place.size() > 4) return;
    ask_for(path, place, name, what);
  }

  static toml::table* located(toml::table& document, const Place& place) {
    toml::table* at = &document;
    for (const auto& [key, index] : place) {
      toml::node* node = at->get(key);
      if (node == nullptr) return nullptr;
      if (index >= 0) {
        toml::array* list = node->as_array();
        node = list == nullptr ? nullptr : list->get(static_cast<std::size_t>(index));
        if (node == nullptr) return nullptr;
      }
      at = node->as_table();
      if (at == nullptr) return nullptr;
    }
    return at;
  }

  /// The words that stand in a table: what is asked for next may depend on them.
  [[nodiscard]] std::string words_at(const std::string& path, const Place& place) {
    const toml::table* there = located(document_, place);
    std::string out;
    if (there == nullptr) return out;
    for (const auto& [key, node] : *there) {
      const auto word = node.value<std::string>();
      if (!node.is_string() || *word == kProbeText) continue;
      // Few words: not a name or a text.
      if (const auto& known = tables_[path].keys[std::string(key.str())]; known.choices.size() == 1) continue;
      out += std::string(key.str()) + "=" + *word + ";";
    }
    return out;
  }

  void ask_for(const std::string& path, const Place& place, const std::string& name, const Asked& what) {
    const std::string words = words_at(path, place);
    const auto with = [&](const std::string& tag, auto&& value) {
      if (!tried_.insert(path + "/" + name + "=" + tag + "|" + words).second) return;
      toml::table next = document_;
      toml::table* at = located(next, place);
      if (at == nullptr) return;
      at->insert_or_assign(name, std::forward<decltype(value)>(value));
      waiting_.push_back(std::move(next));
    };
    for (const auto choice : what.choices) with("\"" + std::string(choice) + "\"", std::string(choice));
    switch (what.kind) {
      case Kind::kAny:
      case Kind::kNumber:
        with("number", 1.0);
        with("text", std::string(kProbeText));
        if (what.kind == Kind::kNumber) break;
        with("truth", true);
        with("table", toml::table{});
        with("numbers", toml::array{1.0});
        break;
      case Kind::kInteger:
        with("integer", std::isfinite(what.range.min) ? static_cast<std::int64_t>(what.range.min) : std::int64_t{1});
        break;
      case Kind::kBoolean:
        with("true", true);
        with("false", false);
        break;
      case Kind::kString:
        with("text", std::string(kProbeText));
        break;
      case Kind::kNumbers:
        with("numbers", toml::array{1.0});
        break;
      case Kind::kStrings:
        with("texts", toml::array{std::string(kProbeText)});
        break;
      case Kind::kTable:
        with("table", toml::table{});
        break;
      case Kind::kTables:
        with("tables", toml::array{toml::table{}});
        break;
    }
  }

  [[nodiscard]] Json object(const std::string& path) const {
    Json out{{"type", "object"}};
    const auto found = tables_.find(path);
    if (found == tables_.end()) return out;
    const Table& table = found->second;
    Json properties = Json::object(), required = Json::array();
    for (const auto& [name, key] : table.keys) {
      properties[name] = value(path, name, key);
      if (key.required > 0 && key.required == table.readings) required.push_back(name);
    }
    out["properties"] = std::move(properties);
    if (!required.empty()) out["required"] = std::move(required);
    // Closed, unless every reading left it open.
    const bool closed = table.open < table.readings;
    if (closed) out["additionalProperties"] = false;
    add_conditions(out, table, closed);
    return out;
  }

  /// What a word of one key demands and allows of the others: the kind of a step, a driver, a transport. What the mere
  /// presence of a key demands is not told: a reader that gives up early asks for less, and one key more lets it come
  /// further, which looks the same.
  static void add_conditions(Json& out, const Table& table, bool closed) {
    const auto always = [&](const std::string& name) {
      const auto found = table.keys.find(name);
      return found != table.keys.end() && found->second.required > 0 && found->second.required == table.readings;
    };
    const auto demanded = [&](const Under& under) {
      Json names = Json::array();
      for (const auto& [name, counts] : under.absent_and_required) {
        if (under.demands(name) && !always(name)) names.push_back(name);
      }
      return names;
    };
    Json all = Json::array();
    for (const auto& [key, words] : table.word) {
      if (words.size() < 2) continue;  // a word that has no other one tells nothing apart
      for (const auto& [word, under] : words) {
        Json then = Json::object();
        if (auto names = demanded(under); !names.empty()) then["required"] = std::move(names);
        if (closed && under.asked.size() < table.keys.size()) then["propertyNames"] = {{"enum", under.asked}};
        if (then.empty()) continue;
        all.push_back({{"if", {{"properties", {{key, {{"const", word}}}}}, {"required", {key}}}}, {"then", then}});
      }
    }
    if (!all.empty()) out["allOf"] = std::move(all);
  }

  [[nodiscard]] Json list_of(const std::string& path, const std::string& name) const {
    const std::string step = "/" + name + "[]";
    if (!path.ends_with(step)) return {{"type", "array"}, {"items", object(path + step)}};
    std::string pointer = "#";  // of the list's own schema, further out
    for (std::size_t from = 1; from < path.size();) {
      const auto end = std::min(path.find('/', from), path.size());
      std::string part = path.substr(from, end - from);
      const bool list = part.ends_with("[]");
      if (list) part.resize(part.size() - 2);
      pointer += "/properties/" + part + (list ? "/items" : "");
      from = end + 1;
    }
    return {{"type", "array"}, {"items", {{"$ref", pointer}}}};
  }

  [[nodiscard]] Json value(const std::string& path, const std::string& name, const Key& key) const {
    Json forms = Json::array();
    const auto has = [&](Kind kind) { return key.kinds.contains(kind); };
    if (has(Kind::kNumber) || has(Kind::kInteger)) {
      Json number{{"type", has(Kind::kNumber) ? "number" : "integer"}};
      if (std::isfinite(key.min)) number[key.open_min ? "exclusiveMinimum" : "minimum"] = key.min;
      if (std::isfinite(key.max)) number["maximum"] = key.max;
      forms.push_back(std::move(number));
    }
    if (has(Kind::kBoolean)) forms.push_back({{"type", "boolean"}});
    if (has(Kind::kString)) {
      forms.push_back(key.choices.empty() ? Json{{"type", "string"}} : Json{{"enum", key.choices}});
    }
    if (has(Kind::kNumbers)) forms.push_back({{"type", "array"}, {"items", {{"type", "number"}}}});
    if (has(Kind::kStrings)) forms.push_back({{"type", "array"}, {"items", {{"type", "string"}}}});
    if (has(Kind::kTables)) forms.push_back(list_of(path, name));
    if (has(Kind::kTable)) forms.push_back(object(path + "/" + name));
    if (forms.empty()) return Json::object();
    return forms.size() == 1 ? forms.front() : Json{{"anyOf", std::move(forms)}};
  }

  const std::vector<ReadText>& readers_;
  std::map<std::string, Table> tables_;
  std::set<std::string> tried_;
  std::deque<toml::table> waiting_;
  toml::table document_;  // that is being read
  std::map<const void*, Seen> places_;
  std::map<const void*, Instance> instances_;
  std::set<std::string> opened_;
  std::set<std::pair<std::string, std::string>> required_;
};

}  // namespace

nlohmann::ordered_json schema_of(const std::string& title, const std::vector<ReadText>& readers,
                                 const std::vector<std::string>& seeds) {
  Prober prober(readers);
  for (const auto& seed : seeds) prober.probe(toml::parse(seed));
  return prober.schema(title);
}

}  // namespace isorig::cli
