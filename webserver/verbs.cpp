#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <sstream>
#include <string_view>

#include "base/printable.hpp"
#include "webserver/hub.hpp"
#include "webserver/requests.hpp"

/// Hub: what a page asks for.
namespace isorig::web {
namespace {

using nlohmann::json;

constexpr auto kVerbPatience = std::chrono::seconds(5);
constexpr auto kStartPatience = std::chrono::seconds(60);  // a long protocol is compiled
constexpr std::size_t kFileBytes = std::size_t{1} << 20U;

/// Who may: everybody with a session may stop the rig, whoever has control; the rest is for who has it.
struct Verb {
  std::string_view name;
  bool needs_control;
};
constexpr std::array kVerbs{Verb{"pause", false}, Verb{"abort", false},       Verb{"resume", true},
                            Verb{"reset", true},  Verb{"confirm-zero", true}, Verb{"go", true}};

std::string dump(const json& body) {
  return body.dump(-1, ' ', false, json::error_handler_t::replace);
}
Hub::Answer answer(int status, const std::string& text) {
  return {status, dump({{"ok", status == 200}, {"text", text}})};
}

/// Nothing: there is no such file, or it is longer than a protocol can be.
std::optional<std::string> text_of(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return std::nullopt;
  std::string text(kFileBytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > kFileBytes) return std::nullopt;
  return text;
}

/// The text at `key`, if it is one; what a page sends may be anything.
std::string text_at(const json& body, const char* key) {
  const auto found = body.find(key);
  return found != body.end() && found->is_string() ? found->get<std::string>() : std::string();
}

}  // namespace

std::vector<std::string> Hub::files(const std::filesystem::path& folder) const {
  std::vector<std::string> out;
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    const auto name = at->path().filename().string();
    std::error_code ignored;
    if (is_plain_toml_name(name) && at->is_regular_file(ignored)) out.push_back(name);
  }
  std::sort(out.begin(), out.end());
  return out;
}

std::string Hub::library() const {
  return dump({{"protocols", files(settings_.protocols)}, {"specimens", files(settings_.specimens)}});
}

void Hub::perform(const std::string& verb, const std::string& session, const std::string& body, const Reply& reply) {
  const auto now = std::chrono::steady_clock::now();
  const auto who = access_.who(session, now);
  if (!who) return reply(answer(403, "this page is view only: isorig web gives a link that may control"));
  const auto given = body.empty() ? json::object() : json::parse(body, nullptr, false);
  if (!given.is_object()) return reply(answer(400, "the body has to be a JSON object"));
  if (verb == "lease") return change_lease(session, *who, text_at(given, "action"), reply);
  if (verb == "leave") {
    access_.leave(session);
    spdlog::info("session of {} (uid {}) ended", base::printable(who->name), who->uid);
    tell_lease();
    return reply(answer(200, "view only from now on"));
  }
  if (verb == "preview") return start_run(*who, given, true, reply);
  const auto found = std::find_if(kVerbs.begin(), kVerbs.end(), [&](const Verb& v) { return v.name == verb; });
  const bool note = verb == "note", start = verb == "start";
  if (found == kVerbs.end() && !note && !start) return reply(answer(404, "no such call: " + base::printable(verb)));
  if ((start || (found != kVerbs.end() && found->needs_control)) && !access_.has_control(session)) {
    const auto lease = access_.lease();
    return reply(
        answer(409, lease ? lease->who.name + " has control; take it over if that is agreed" : "take control first"));
  }
  if (start) return start_run(*who, given, false, reply);
  if (note) {
    json correction{{"by", who->name}};
    for (const char* key : {"run", "operator", "text", "specimen_name"}) {
      if (const auto text = text_at(given, key); !text.empty()) correction[key] = text;
    }
    if (const auto name = text_at(given, "specimen_file"); !name.empty()) {
      const auto text = is_plain_toml_name(name) ? text_of(settings_.specimens / name) : std::nullopt;
      if (!text) return reply(answer(400, "no specimen " + base::printable(name) + " in the library"));
      correction["specimen"] = *text;
      correction["specimen_name"] = name;
    }
    return forward("notes", *who, dump(correction), reply);
  }
  forward(verb, *who, "{}", reply);
}

void Hub::change_lease(const std::string& session, const Who& who, const std::string& action, const Reply& reply) {
  if (action == "give-back") {
    if (access_.give_back(session))
      spdlog::info("control given back by {} (uid {})", base::printable(who.name), who.uid);
    tell_lease();
    return reply(answer(200, "control is free"));
  }
  if (action != "take" && action != "take-over") {
    return reply(answer(400, "`action` has to be take, take-over or give-back"));
  }
  const auto taken = access_.take(session, action == "take-over", std::chrono::steady_clock::now());
  if (taken.ok) {
    if (taken.taken_from.empty()) {
      spdlog::info("control taken by {} (uid {})", base::printable(who.name), who.uid);
    } else {
      spdlog::warn("control taken over by {} (uid {}) from {}", base::printable(who.name), who.uid,
                   base::printable(taken.taken_from));
    }
    tell_lease();
  }
  reply(answer(taken.ok ? 200 : 409, taken.text));
}

void Hub::start_run(const Who& who, const json& given, bool preview, const Reply& reply) {
  json body{{"operator", text_at(given, "operator")}};
  if (body["operator"] == "") return reply(answer(400, "who runs it? name the operator"));
  if (const auto text = text_at(given, "protocol"); !text.empty()) {
    body["protocol"] = text;
    const auto name = text_at(given, "protocol_name");
    body["protocol_name"] = name.empty() ? "protocol.toml" : name;
  } else {
    const auto name = text_at(given, "protocol_file");
    const auto file = is_plain_toml_name(name) ? text_of(settings_.protocols / name) : std::nullopt;
    if (!file) return reply(answer(400, "no protocol " + base::printable(name) + " in the library"));
    body["protocol"] = *file;
    body["protocol_name"] = name;
  }
  // An empty name is the rig's own specimen, said by choosing it.
  if (const auto name = text_at(given, "specimen_file"); !name.empty()) {
    const auto file = is_plain_toml_name(name) ? text_of(settings_.specimens / name) : std::nullopt;
    if (!file) return reply(answer(400, "no specimen " + base::printable(name) + " in the library"));
    body["specimen"] = *file;
    body["specimen_name"] = name;
  } else if (const auto said = given.find("specimen_file"); said == given.end() || !said->is_string()) {
    return reply(answer(400, "which specimen is mounted? choose one, or the rig's own"));
  }
  if (preview) {
    body["dry_run"] = true;
    return daemon_.call("POST", "/v1/start", dump(body), kStartPatience, [reply](const DaemonAnswer& a) {
      reply({a.status == 0 ? 502 : a.status, dump(a.body)});
    });
  }
  forward("start", who, dump(body), reply);
}

void Hub::forward(const std::string& verb, const Who& who, std::string body, const Reply& reply) {
  daemon_.call("POST", "/v1/" + verb, std::move(body), verb == "start" || verb == "go" ? kStartPatience : kVerbPatience,
               [verb, who, reply](const DaemonAnswer& a) {
                 const auto text = a.body.value("text", std::string());
                 spdlog::info("{} by {} (uid {}): {}", verb, base::printable(who.name), who.uid,
                              base::printable(text.substr(0, text.find('\n'))));
                 reply({a.status == 0 ? 502 : a.status, dump(a.body)});
               });
}

}  // namespace isorig::web
