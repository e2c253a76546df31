#include "daemon/host/api_requests.hpp"

#include <algorithm>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>
#include <vector>

#include "base/blank.hpp"
#include "base/nearest.hpp"
#include "base/printable.hpp"

namespace isorig::daemon {
namespace {

using nlohmann::json;

constexpr std::size_t kLongestLine = 1024;  // a file's path may stand in one
// What is read in the thread of the connections has no file in it.
constexpr std::size_t kShortBody = 4096;
constexpr std::size_t kAnyBody = std::numeric_limits<std::size_t>::max();  // the connection has its bound
constexpr std::size_t kDeepestBody = 8;
constexpr std::size_t kShownBytes = 200;  // of a value in a line of the audit log

/// Counted before anything is made of it.
bool is_too_deep(std::string_view text) {
  std::size_t depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') ++i;
      in_string = c != '"';
    } else if (c == '"') {
      in_string = true;
    } else if (c == '[' || c == '{') {
      if (++depth > kDeepestBody) return true;
    } else if ((c == ']' || c == '}') && depth > 0) {
      --depth;
    }
  }
  return false;
}

/// A JSON object with no other keys than these: an unknown key would be ignored without a word.
class Body {
 public:
  Body(const std::string& call, const std::string& text, std::initializer_list<std::string_view> keys,
       std::size_t most_bytes = kShortBody)
      : call_(call) {
    if (text.size() > most_bytes)
      fail("the body has " + std::to_string(text.size()) + " bytes; at most " + std::to_string(most_bytes));
    if (is_too_deep(text)) fail("the body is nested deeper than " + std::to_string(kDeepestBody) + " levels");
    std::vector<std::set<std::string>> seen(kDeepestBody + 2);  // keys of the objects that are open, by depth
    std::string twice;
    const auto watch = [&](int depth, json::parse_event_t event, json& value) {
      const auto at = static_cast<std::size_t>(depth);
      if (event == json::parse_event_t::object_start) seen.at(at + 1).clear();
      if (event == json::parse_event_t::key && !seen.at(at).insert(value.get<std::string>()).second)
        twice = value.get<std::string>();
      return true;
    };
    object_ = json::parse(text, watch, false);
    if (!twice.empty()) fail("the key `" + base::printable(twice) + "` stands there twice; which of them is meant?");
    if (object_.is_discarded()) fail("the body is not JSON");
    if (!object_.is_object()) fail("the body has to be a JSON object");
    for (const auto& [key, value] : object_.items()) {
      if (std::find(keys.begin(), keys.end(), key) != keys.end()) continue;
      const auto meant = base::nearest(key, keys);
      std::string known;
      for (const auto& k : keys) known += (known.empty() ? "`" : ", `") + std::string(k) + "`";
      fail("unknown key `" + key + "`" +
           (meant.empty() ? "; known here: " + known : "; did you mean `" + meant + "`?"));
    }
  }

  [[nodiscard]] std::string text(const char* key, const char* fallback) const {
    if (!object_.contains(key)) return fallback;
    if (!object_[key].is_string()) fail(std::string("`") + key + "` has to be a text");
    return object_[key].get<std::string>();
  }
  [[nodiscard]] std::string text(const char* key) const {
    if (!object_.contains(key)) fail(std::string("`") + key + "` is missing");
    return text(key, "");
  }
  [[nodiscard]] bool flag(const char* key) const {
    if (!object_.contains(key)) return false;
    if (!object_[key].is_boolean()) fail(std::string("`") + key + "` has to be true or false");
    return object_[key].get<bool>();
  }
  [[nodiscard]] bool has(const char* key) const { return object_.contains(key); }
  [[nodiscard]] double number(const char* key, double fallback) const {
    if (!object_.contains(key)) return fallback;
    if (!object_[key].is_number()) fail(std::string("`") + key + "` has to be a number");
    return object_[key].get<double>();
  }
  /// A name goes to terminals, logs and file names.
  [[nodiscard]] std::string line(const char* key, const char* fallback) const {
    auto value = text(key, fallback);
    if (base::printable(value) != value) {
      fail(std::string("`") + key +
           "` holds a control character, or a mark that hides or turns text; one line of plain text is needed");
    }
    if (value.size() > kLongestLine)
      fail(std::string("`") + key + "` is longer than " + std::to_string(kLongestLine) + " bytes");
    return value;
  }
  [[noreturn]] void fail(const std::string& why) const {
    throw BadRequest("the request is not what " + call_ + " takes: " + why);
  }

 private:
  std::string call_;
  json object_;
};

}  // namespace

StartOptions start_options(const std::string& body, bool* dry_run) {
  const Body b("/v1/start", body,
               {"protocol", "protocol_name", "specimen", "specimen_name", "operator", "resume_run", "resume_aborted",
                "on_another_rig", "another_specimen", "dry_run"},
               kAnyBody);
  StartOptions o;
  o.resume_run = b.line("resume_run", "");
  // A run that goes on has its protocol with it.
  o.protocol_text = o.resume_run.empty() ? b.text("protocol") : "";
  o.protocol_name = b.line("protocol_name", "protocol.toml");
  o.specimen_text = b.text("specimen", "");
  o.specimen_name = b.line("specimen_name", "");
  o.operator_name = b.line("operator", "");
  o.resume_aborted = b.flag("resume_aborted");
  o.on_another_rig = b.flag("on_another_rig");
  o.another_specimen = b.flag("another_specimen");
  if (dry_run != nullptr) *dry_run = b.flag("dry_run");
  return o;
}

CheckRequest check_request(const std::string& body) {
  const Body b("/v1/check", body, {"protocol", "protocol_name"}, kAnyBody);
  return {b.text("protocol"), b.line("protocol_name", "protocol.toml")};
}

Correction correction(const std::string& body) {
  const Body b("/v1/notes", body, {"run", "by", "operator", "specimen", "specimen_name", "text"}, kAnyBody);
  return {b.line("run", ""),
          b.line("by", ""),
          b.line("operator", ""),
          b.text("specimen", ""),
          b.line("specimen_name", "specimen.toml"),
          b.line("text", "")};
}

Parting parting(const std::string& body) {
  const Body b("/v1/parted", body, {"run", "text", "then"});
  Parting out{b.line("run", ""), b.line("text", ""), b.line("then", "mark")};
  if (out.run.empty() || out.text.empty()) b.fail("`run` and `text` say in which run, and how far they are apart");
  if (out.then != "mark" && out.then != "pause" && out.then != "abort")
    b.fail("`then` has to be mark, pause or abort: what the client does about it");
  return out;
}

Request setup_request(const std::string& body) {
  Request r;
  r.verb = !body.empty() && Body("/v1/setup", body, {"off"}).flag("off") ? Request::Verb::kLeaveSetup
                                                                         : Request::Verb::kSetup;
  return r;
}

Request jog_request(const std::string& body) {
  const Body b("/v1/jog", body, {"to_mm", "by_mm", "velocity_mm_s"});
  if (b.has("to_mm") == b.has("by_mm")) b.fail("one of `to_mm` and `by_mm` says where to");
  Request r;
  r.verb = Request::Verb::kJog;
  r.relative = b.has("by_mm");
  r.target_mm = b.number(r.relative ? "by_mm" : "to_mm", 0.0);
  r.velocity_mm_s = b.number("velocity_mm_s", 0.0);
  // Without one it is the greatest that setup allows.
  if (b.has("velocity_mm_s") && !(r.velocity_mm_s > 0.0))
    b.fail("`velocity_mm_s` has to be above 0; the direction is the target's");
  return r;
}

std::string accepting_operator(const std::string& body) {
  const Body b("/v1/accept-rig", body, {"operator"});
  auto name = b.line("operator", "");
  if (base::is_blank(name)) b.fail("`operator` says who accepts the rig file, and is missing");
  return name;
}

std::string control_action(const std::string& body) {
  const Body b("/v1/control", body, {"action"});
  auto action = b.text("action");
  for (const char* known : {"take", "take-over", "give-back", "keep"}) {
    if (action == known) return action;
  }
  b.fail("`action` has to be take, take-over or give-back, or keep for a page that is looked at");
}

std::string short_arguments(const std::string& body, bool may_read_long) {
  const auto bytes = std::to_string(body.size()) + " bytes";
  if (body.empty()) return {};
  if (body.size() > kShortBody && !may_read_long) return "(" + bytes + ")";
  if (is_too_deep(body)) return "(" + bytes + ", nested deeper than " + std::to_string(kDeepestBody) + " levels)";
  const auto given = json::parse(body, nullptr, false);
  if (!given.is_object()) return "(" + bytes + ", no JSON object)";
  std::string out;
  for (const auto& [key, value] : given.items()) {
    if (value.is_string() && value.get_ref<const std::string&>().empty()) continue;
    auto text = value.is_string() ? value.get<std::string>() : value.dump();
    if (text.size() > kShownBytes || text.find('\n') != std::string::npos)
      text = "(" + std::to_string(text.size()) + " bytes)";
    out += (out.empty() ? "" : ", ") + base::printable(key) + "=" + base::printable(text);
    if (out.size() > kShortBody) return out.substr(0, kShortBody) + "...";
  }
  return out;
}

std::string calibration_record(const std::string& body) {
  return Body("/v1/calibrations", body, {"record"}, kAnyBody).text("record");
}

}  // namespace isorig::daemon
