#include "daemon/host/api_gate.hpp"

#include <pwd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <utility>

#include "base/printable.hpp"
#include "base/utc_text.hpp"
#include "daemon/host/api_calls.hpp"
#include "daemon/host/api_requests.hpp"

namespace isorig::daemon {
namespace {

using nlohmann::json;

constexpr std::size_t kNameBytes = 64;
constexpr std::size_t kPageNameBytes = 64;
constexpr std::size_t kOutcomeBytes = 300;
constexpr std::size_t kLooksKept = 10'000;
/// A page that polls is refused several times a second, for as long as it is open.
constexpr auto kRefusedLookAgain = std::chrono::minutes(1);
/// The user of the service that speaks for the users of the live page (packaging/).
constexpr const char* kWebUser = "isorig-web";

std::int64_t unix_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

std::string first_line(const HttpAnswer& answer) {
  const auto body = json::parse(answer.json, nullptr, false);
  const auto text = body.is_object() ? body.value("text", std::string()) : std::string();
  return base::printable(text.substr(0, std::min(text.find('\n'), kOutcomeBytes)));
}

std::string verb_of_path(const std::string& path) {
  return path.substr(std::min<std::size_t>(4, path.size()));
}

/// Who is believed when he says for whom he asks: root, the daemon's own user, and that of the live page, if there is
/// one.
std::set<uid_t> find_trusted_relays() {
  std::set<uid_t> out{0, ::geteuid()};
  passwd entry{};
  passwd* found = nullptr;
  std::array<char, 4096> room{};
  if (::getpwnam_r(kWebUser, &entry, room.data(), room.size(), &found) == 0 && found != nullptr)
    out.insert(entry.pw_uid);
  return out;
}

}  // namespace

Caller caller_of(const HttpRequest& request) {
  Caller caller{request.peer, {}, {}, {}};
  if (request.on_behalf.empty()) return caller;
  const auto wrong = [](const std::string& why) -> void { throw BadRequest("the header Isorig-For: " + why); };
  const auto given = json::parse(request.on_behalf, nullptr, false);
  if (!given.is_object()) wrong("it has to be a JSON object");
  Peer peer;
  for (const auto& [key, value] : given.items()) {
    const auto is_id = [](const json& v) { return v.is_number_unsigned() && v.get<std::uint64_t>() < Peer::kUnknown; };
    const bool is_text = value.is_string() && base::printable(value.get<std::string>()) == value.get<std::string>();
    if (key == "uid" && is_id(value)) {
      peer.uid = value.get<uid_t>();
    } else if (key == "gid" && is_id(value)) {
      peer.gid = value.get<gid_t>();
    } else if (key == "groups" && value.is_array() && std::all_of(value.begin(), value.end(), is_id)) {
      peer.groups = value.get<std::vector<gid_t>>();
    } else if (key == "name" && is_text && value.get<std::string>().size() <= kNameBytes) {
      caller.for_name = value.get<std::string>();
    } else if (key == "page" && is_text && value.get<std::string>().size() <= kPageNameBytes) {
      caller.page = value.get<std::string>();
    } else {
      wrong("`" + base::printable(key) + "` is unknown, or not what it has to be");
    }
  }
  if (peer.uid == Peer::kUnknown || caller.for_name.empty() || caller.page.empty())
    wrong("`uid`, `name` and `page` are needed");
  caller.for_whom = std::move(peer);
  return caller;
}

ApiGate::ApiGate(Roles roles, AuditLog* audit, Log log, std::function<bool()> busy)
    : roles_(std::move(roles)),
      audit_(audit),
      log_(std::move(log)),
      control_(std::move(busy), [this](const Control::Holder& holder) { note_end(holder); }),
      trusted_relays_(find_trusted_relays()) {}

ApiGate::Entered ApiGate::enter(const HttpRequest& request, const Needs& needs, HttpServer::Reply reply) {
  Entered out;
  out.pass = std::make_shared<Pass>(Pass{request, needs, {request.peer, {}, {}, {}}, 0, false});
  out.reply = [this, pass = out.pass, reply = std::move(reply)](HttpAnswer answer) {
    if (answer.status != 200) control_.undo(pass->newly);
    if (is_to_be_noted(*pass, answer)) note(*pass, answer);
    reply(std::move(answer));
  };
  try {
    out.pass->caller = caller_of(request);
  } catch (const BadRequest& e) {
    if (!needs.role) return out;  // a stop is a stop
    out.status = 400;
    out.refused = e.what();
    return out;
  }
  const auto& caller = out.pass->caller;
  if (needs.role) {
    for (const auto* who : {&caller.peer, caller.for_whom ? &*caller.for_whom : nullptr}) {
      if (who == nullptr || roles_.may(*who, *needs.role)) continue;
      out.status = 403;
      out.refused = roles_.why_not(*who, *needs.role);
      return out;
    }
  }
  if (!needs.control) return out;
  out.refused = take_control(*out.pass);
  if (!out.refused.empty()) out.status = 409;
  return out;
}

/// Commands, and looks without the right: the first of a minute of each user at each call.
bool ApiGate::is_to_be_noted(const Pass& pass, const HttpAnswer& answer) {
  if (pass.needs.command) return true;
  if (answer.status != 403) return false;
  const auto now = std::chrono::steady_clock::now();
  // Made-up paths are one: who makes them up does not fill the log.
  const bool is_call = why_no_such_call(pass.request, false).status != 404;
  const std::lock_guard lock(looks_mutex_);
  if (looks_noted_.size() >= kLooksKept) looks_noted_.clear();
  const auto [at, is_first] =
      looks_noted_.try_emplace({pass.caller.peer.uid, is_call ? pass.request.path : std::string()}, now);
  if (!is_first && now - at->second < kRefusedLookAgain) return false;
  at->second = now;
  return true;
}

std::string ApiGate::take_control(Pass& pass) {
  const auto used = control_.use(seat_of(pass.caller), std::chrono::steady_clock::now(), unix_ms() / 1000, pass.newly);
  pass.newly = used.newly;
  return used.refused;
}

HttpAnswer ApiGate::change_control(const Pass& pass) {
  const auto action = control_action(pass.request.body);
  const auto seat = seat_of(pass.caller);
  const auto now = std::chrono::steady_clock::now();
  Control::Answer said;
  if (action == "keep") {
    said.ok = control_.keep(seat, now);
    said.text = said.ok ? "control is held" : "control is not held there (any more)";
  } else if (action == "give-back") {
    said = control_.give_back(seat, now);
  } else {
    said = control_.take(seat, action == "take-over", now, unix_ms() / 1000);
  }
  const json body{{"ok", said.ok},
                  {"text", said.text},
                  {"term", said.term},
                  {"taken_from", said.taken_from},
                  {"control", control_json()}};
  return {said.ok ? 200 : 409, body.dump(-1, ' ', false, json::error_handler_t::replace)};
}

json ApiGate::control_json() {
  const auto holder = control_.holder(std::chrono::steady_clock::now());
  if (!holder) return {};
  const auto& seat = holder->seat;
  return {{"holder", seat.name},
          {"uid", seat.uid},
          {"where", seat.page.empty() ? "terminal" : "page"},
          {"text", where_text(seat)},
          {"since_utc", base::utc_text(holder->since_unix_s)},
          {"term", holder->term}};
}

/// Names are asked for once: the name service may be a server elsewhere.
Seat ApiGate::seat_of(const Caller& caller) {
  if (caller.for_whom) {
    const auto relay = caller.peer.uid;
    return {caller.for_whom->uid, caller.for_name, caller.page, relay, trusted_relays_.contains(relay)};
  }
  const auto uid = caller.peer.uid;
  {
    const std::lock_guard lock(names_mutex_);
    if (const auto known = names_.find(uid); known != names_.end()) return {uid, known->second, {}, uid};
  }
  auto name = user_name(uid);
  const std::lock_guard lock(names_mutex_);
  if (names_.size() >= kUserNamesKept) names_.clear();
  names_[uid] = name;
  return {uid, std::move(name), {}, uid};
}

std::string ApiGate::who(const Caller& caller) {
  const auto number = [](uid_t uid) { return "uid " + std::to_string(uid); };
  if (caller.for_whom)
    return caller.for_name + " (" + number(caller.for_whom->uid) + ") at a page of " + number(caller.peer.uid);
  const auto uid = caller.peer.uid;
  const std::lock_guard lock(names_mutex_);
  const auto known = names_.find(uid);
  // Without a name of its own a user is called by the number.
  return known == names_.end() || known->second == number(uid) ? number(uid) : known->second + " (" + number(uid) + ")";
}

void ApiGate::note(const Pass& pass, const HttpAnswer& answer) {
  const auto& q = pass.request;
  const auto& who = pass.caller;
  auto outcome = first_line(answer);
  const auto verb = (q.method == "POST" ? "" : q.method + " ") + verb_of_path(q.path);
  const bool repeated =
      audit_ != nullptr && !audit_->add({unix_ms(), who.peer, who.for_whom, who.for_name, verb,
                                         short_arguments(q.body, pass.may_read_long), answer.status, outcome});
  if (log_ && !repeated) {
    log_(verb_of_path(q.path) + " by uid " + std::to_string(who.peer.uid) + " (process " +
         std::to_string(who.peer.pid) + ")" +
         (who.for_whom ? " for " + who.for_name + " (uid " + std::to_string(who.for_whom->uid) + ")" : "") + ": " +
         outcome);
  }
}

/// Nobody's command: time has passed.
void ApiGate::note_end(const Control::Holder& holder) {
  const auto text = where_text(holder.seat) + " has left; control is free";
  if (log_) log_("control: " + text);
  if (audit_ == nullptr) return;
  Peer who;
  who.uid = holder.seat.uid;
  audit_->add({unix_ms(), who, {}, {}, "control", "(time)", 200, text});
}

}  // namespace isorig::daemon
