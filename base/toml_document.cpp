#include "base/toml_document.hpp"

#include <algorithm>

#include "base/nearest.hpp"
#include "base/text_file.hpp"
#include "base/toml_budget.hpp"
#include "base/toml_hints.hpp"
#include "base/toml_observer.hpp"

namespace isorig::base {
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

void TomlDocument::Impl::note(Diagnostic diagnostic) {
  if (diagnostics.size() >= kMaxDiagnostics) {
    ++further;
    return;
  }
  shorten(diagnostic.message);
  diagnostics.push_back(std::move(diagnostic));
}

void TomlDocument::Impl::find_unread(const toml::table& table, std::vector<Diagnostic>& out) const {
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
        message += "; did you mean `" + best + "`?" + unit_hint(name_of_key, best);
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

void TomlDocument::Impl::find_unread(const toml::array& array, std::vector<Diagnostic>& out) const {
  for (const auto& element : array) {
    if (const auto* sub = element.as_table()) {
      if (asked.contains(sub)) find_unread(*sub, out);
    } else if (const auto* inner = element.as_array()) {
      find_unread(*inner, out);
    }
  }
}

TomlDocument::TomlDocument(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
TomlDocument::TomlDocument(TomlDocument&&) noexcept = default;
TomlDocument& TomlDocument::operator=(TomlDocument&&) noexcept = default;
TomlDocument::~TomlDocument() = default;

TomlDocument TomlDocument::parse_file(const std::filesystem::path& path) {
  // One byte more than is taken: enough to see that it is too long.
  return parse_text(read_config_file(path, kMaxTomlBytes + 1), path.string());
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
    throw ConfigError({impl->at(e.source(), "not valid TOML: " + std::string(e.description()) +
                                                decimal_comma_hint(impl->text, e.source().begin.line))});
  }
  return TomlDocument(std::move(impl));
}

TomlTable TomlDocument::root() const {
  impl_->asked[&impl_->root];
  if (auto* observer = TomlObserver::of_this_thread()) observer->root(impl_->name, &impl_->root);
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
  // A file of another kind breaks every rule of this one; only that is worth reading.
  if (const auto* format = impl_->root.get("format"); format != nullptr && format->is_string()) {
    const auto place = format->source().begin;
    const auto wrong = std::ranges::find_if(
        all, [&](const Diagnostic& d) { return d.line == place.line && d.column == place.column; });
    if (wrong != all.end() && format->ref<std::string>().starts_with("isorig-")) return {*wrong};
  }
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

}  // namespace isorig::base
