#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <string>
#include <string_view>
#include <utility>

#include "base/fingerprint.hpp"
#include "base/printable.hpp"
#include "webserver/answers.hpp"
#include "webserver/hub.hpp"
#include "webserver/rules/files.hpp"
#include "webserver/rules/requests.hpp"

/// Hub: what a page asks for.
namespace isorig::web {
namespace {

using nlohmann::json;

constexpr auto kVerbPatience = std::chrono::seconds(5);
constexpr auto kKeepPeriod = std::chrono::seconds(5);
constexpr auto kStartPatience = std::chrono::seconds(60);  // a long protocol is compiled

/// Who may: everybody with a session may stop the rig, whoever has control; the rest is for who has it.
struct Verb {
  std::string_view name;
  bool needs_control;
};
constexpr std::array kVerbs{Verb{"pause", false}, Verb{"abort", false},       Verb{"resume", true},
                            Verb{"reset", true},  Verb{"confirm-zero", true}, Verb{"go", true}};

}  // namespace

void Hub::library(const Reply& reply) {
  from_disk(
      [this] {
        return dump({{"protocols", toml_files(settings_.protocols, true)},
                     {"saved", toml_files(saved_.folder(), false)},
                     {"specimens", toml_files(settings_.specimens, true)},
                     {"models", toml_files(settings_.models, true)}});
      },
      [reply = Reply(reply)](std::string text) {
        reply({200, std::move(text)});
      });
}

std::optional<std::string> Hub::specimen_text(const std::string& name) const {
  return is_plain_toml_name(name) ? text_of(settings_.specimens / name) : std::nullopt;
}

void Hub::perform(const std::string& verb, const std::string& session, const std::string& body, const Reply& reply) {
  const auto now = std::chrono::steady_clock::now();
  const auto who = access_.who(session, now);
  if (!who) return reply(answer(403, "this page is view only: isorig web gives a link that may control"));
  const auto given = body.empty() ? json::object() : json::parse(body, nullptr, false);
  if (!given.is_object()) return reply(answer(400, "the body has to be a JSON object"));
  if (verb == "lease") return change_lease(session, *who, text_at(given, "action"), reply);
  if (verb == "leave") {
    end_session(session);
    return reply(answer(200, "view only from now on"));
  }
  if (verb == "check") return check_protocol(*who, given, reply);
  if (verb == "save") return save_protocol(*who, given, reply);
  if (verb == "preview") return start_run(*who, given, true, reply);
  const auto found = std::find_if(kVerbs.begin(), kVerbs.end(), [&](const Verb& v) { return v.name == verb; });
  const bool is_note = verb == "note", start = verb == "start", twin = verb == "twin";
  if (found == kVerbs.end() && !is_note && !start && !twin)
    return reply(answer(404, "no such call: " + base::printable(verb)));
  if ((start || twin || (found != kVerbs.end() && found->needs_control)) && !access_.has_control(session)) {
    const auto control = access_.control();
    return reply(
        answer(409, control ? control->holder + " has control; take it over if that is agreed" : "take control first"));
  }
  if (start) return start_run(*who, given, false, reply);
  if (twin) return change_twin(*who, given, reply);
  if (is_note) return note(*who, given, reply);
  forward(verb, *who, "{}", reply);
}

void Hub::note(const Who& who, const json& given, const Reply& reply) {
  json correction{{"by", who.name}};
  for (const char* key : {"run", "operator", "text", "specimen_name"}) {
    if (const auto text = text_at(given, key); !text.empty()) correction[key] = text;
  }
  const auto name = text_at(given, "specimen_file");
  if (name.empty()) return forward("notes", who, dump(correction), reply);
  from_disk([this, name] { return specimen_text(name); },
            [this, who = Who(who), correction = std::move(correction), name,
             reply = Reply(reply)](const std::optional<std::string>& text) mutable {
              if (!text) return reply(answer(400, "no specimen " + base::printable(name) + " in the library"));
              correction["specimen"] = *text;
              correction["specimen_name"] = name;
              forward("notes", who, dump(correction), reply);
            });
}

void Hub::end_session(const std::string& session) {
  const auto who = access_.who(session, std::chrono::steady_clock::now());
  if (!who) return;
  if (access_.has_control(session)) change_lease(session, *who, "give-back", [](const Answer&) {});
  access_.leave(session);
  spdlog::info("session of {} (uid {}) ended", base::printable(who->name), who->uid);
  tell_lease();
  const auto all = viewers_;
  for (const auto& v : all) {
    if (v->session() == session) v->cut_off();
  }
}

void Hub::change_lease(const std::string& session, const Who& who, const std::string& action, const Reply& reply) {
  if (action != "take" && action != "take-over" && action != "give-back")
    return reply(answer(400, "`action` has to be take, take-over or give-back"));
  daemon_.call(
      "POST", "/v1/control", dump({{"action", action}}), kVerbPatience,
      [this, session, who, action, reply](DaemonAnswer a) {
        if (a.status == 200) {
          const auto from = text_at(a.body, "taken_from");
          const auto name = base::printable(who.name);
          if (action == "give-back") {
            spdlog::info("control given back by {} (uid {})", name, who.uid);
          } else if (from.empty()) {
            spdlog::info("control taken by {} (uid {})", name, who.uid);
          } else {
            spdlog::warn("control taken over by {} (uid {}) from {}", name, who.uid, base::printable(from));
          }
          access_.won(session, a.body.value("term", std::uint64_t{0}));
        }
        if (a.body.contains("control")) {
          take_note_of_control(a.body["control"]);
          status_is_older_ = true;
        }
        if (a.status == 404) {
          return reply(answer(404,
                              "isorigd is older than this page: restart it when the rig rests; until then use isorig "
                              "at a terminal"));
        }
        reply({a.status == 0 ? 502 : a.status, dump(a.body)});
      },
      on_behalf_of(who));
}

/// Null: nobody has it.
void Hub::take_note_of_control(const json& control) {
  std::optional<Access::Control> now;
  if (control.is_object()) {
    const bool terminal = text_at(control, "where") == "terminal";
    now = Access::Control{text_at(control, "holder") + (terminal ? " (terminal)" : ""),
                          control.value("term", std::uint64_t{0})};
  }
  if (access_.control_is(now)) tell_lease();
}

/// A daemon that ends takes its word about control with it. Who looks at his page all the while asks the next one for
/// it, unless somebody else was first.
void Hub::regain_control() {
  const auto session = std::exchange(holder_before_, {});
  const auto who = session.empty() ? std::nullopt : access_.who(session, std::chrono::steady_clock::now());
  // Who has closed his page meanwhile is not there: control would be his for a minute, and keep others from theirs.
  if (who && access_.is_present(session) && !access_.control())
    change_lease(session, *who, "take", [](const Answer&) {});
}

/// The daemon ends the control of a page that nobody looks at any more: that somebody does is said here.
void Hub::keep_control(Time now) {
  if (now - kept_ < kKeepPeriod) return;
  const auto session = access_.present_holder();
  const auto who = session ? access_.who(*session, now) : std::nullopt;
  if (!who) return;
  kept_ = now;
  daemon_.call(
      "POST", "/v1/control", R"({"action":"keep"})", kVerbPatience, [](const DaemonAnswer&) {}, on_behalf_of(*who));
}

void Hub::start_run(const Who& who, const json& given, bool preview, const Reply& reply) {
  const bool own_text = !text_at(given, "resume_run").empty() || !text_at(given, "protocol").empty();
  const auto protocol = own_text ? std::string() : text_at(given, "protocol_file");
  const auto specimen = text_at(given, "specimen_file");
  from_disk(
      [this, from = text_at(given, "protocol_from"), protocol, specimen] {
        return Read{protocol_text(from, protocol), specimen_text(specimen)};
      },
      [this, who = Who(who), given = json(given), preview, reply = Reply(reply)](const Read& read) {
        start_with(who, given, read, preview, reply);
      });
}

/// What starts has to be what was checked, so that the very text that was read is compared and sent.
void Hub::start_with(const Who& who, const json& given, const Read& read, bool preview, const Reply& reply) {
  const auto who_runs = text_at(given, "operator");
  if (who_runs.empty()) return reply(answer(400, "who runs it? name the operator"));
  json body{{"operator", who_runs}};
  if (const auto run = text_at(given, "resume_run"); !run.empty()) {
    body["resume_run"] = run;
    // Said by the person for each: another measurement goes on in the same run.
    for (const char* key : {"resume_aborted", "on_another_rig", "another_specimen"}) {
      const auto said = given.find(key);
      body[key] = said != given.end() && said->is_boolean() && said->get<bool>();
    }
  } else if (const auto text = text_at(given, "protocol"); !text.empty()) {
    body["protocol"] = text;
    const auto name = text_at(given, "protocol_name");
    body["protocol_name"] = name.empty() ? "protocol.toml" : name;
  } else {
    const auto name = text_at(given, "protocol_file");
    const auto& file = read.protocol;
    if (!file) return reply(answer(400, "no protocol " + base::printable(name) + " in the library"));
    // Every session may write saved files: what starts has to be what was checked.
    if (const auto checked = text_at(given, "protocol_version");
        !checked.empty() && checked != base::fingerprint(*file)) {
      return reply(answer(409, name + " was changed since it was checked: check it again"));
    }
    body["protocol"] = *file;
    body["protocol_name"] = name;
  }
  // An empty name is the rig's own specimen, said by choosing it.
  if (const auto name = text_at(given, "specimen_file"); !name.empty()) {
    const auto& file = read.specimen;
    if (!file) return reply(answer(400, "no specimen " + base::printable(name) + " in the library"));
    if (const auto checked = text_at(given, "specimen_version");
        !checked.empty() && checked != base::fingerprint(*file)) {
      return reply(answer(409, name + " was changed since it was checked: check it again"));
    }
    body["specimen"] = *file;
    body["specimen_name"] = name;
  } else if (const auto said = given.find("specimen_file"); said == given.end() || !said->is_string()) {
    return reply(answer(400, "which specimen is mounted? choose one, or the rig's own"));
  }
  if (preview) {
    body["dry_run"] = true;
    json versions = json::object();
    for (const char* key : {"protocol", "specimen"}) {
      if (body.contains(key))
        versions[std::string(key) + "_version"] = base::fingerprint(body[key].get_ref<const std::string&>());
    }
    return daemon_.call(
        "POST", "/v1/start", dump(body), kStartPatience,
        [reply, versions = std::move(versions)](DaemonAnswer a) {
          if (a.status == 200) a.body.update(versions);
          reply({a.status == 0 ? 502 : a.status, dump(a.body)});
        },
        on_behalf_of(who));
  }
  forward("start", who, dump(body), reply);
}

void Hub::forward(const std::string& verb, const Who& who, std::string body, const Reply& reply) {
  daemon_.call(
      "POST", "/v1/" + verb, std::move(body), verb == "start" || verb == "go" ? kStartPatience : kVerbPatience,
      [this, verb, who, reply](const DaemonAnswer& a) {
        if (verb == "notes") looked_up_.forget();
        const auto text = a.body.value("text", std::string());
        spdlog::info("{} by {} (uid {}): {}", verb, base::printable(who.name), who.uid,
                     base::printable(text.substr(0, text.find('\n'))));
        reply({a.status == 0 ? 502 : a.status, dump(a.body)});
      },
      on_behalf_of(who));
}

}  // namespace isorig::web
