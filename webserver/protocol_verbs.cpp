#include <spdlog/spdlog.h>

#include <utility>

#include "base/fingerprint.hpp"
#include "base/printable.hpp"
#include "webserver/answers.hpp"
#include "webserver/hub.hpp"
#include "webserver/rules/files.hpp"
#include "webserver/rules/requests.hpp"

/// Hub: protocols that are edited on the page.
namespace isorig::web {
namespace {

using nlohmann::json;

constexpr auto kCheckPatience = std::chrono::seconds(60);  // a long protocol is compiled

}  // namespace

std::optional<std::string> Hub::protocol_text(const std::string& from, const std::string& name) const {
  if (!is_plain_toml_name(name)) return std::nullopt;
  if (from != "saved") return text_of(settings_.protocols / name);
  auto saved = saved_.read(name);
  if (!saved) return std::nullopt;
  return std::move(saved->text);
}

void Hub::protocol(const std::string& from, const std::string& name, const Reply& reply) {
  from_disk([this, from, name] { return protocol_text(from, name); },
            [from, name, reply = Reply(reply)](const std::optional<std::string>& text) {
              if (!text) return reply(answer(404, "no protocol " + base::printable(name) + " in the library"));
              // A shipped one is not replaced: what is saved under its name is new.
              reply({200, dump({{"ok", true},
                                {"name", name},
                                {"protocol", *text},
                                {"version", from == "saved" ? base::fingerprint(*text) : std::string()}})});
            });
}

/// By the daemon, whose worker a start waits for, too: one at a time for all pages.
void Hub::check_protocol(const Who& who, const json& given, const Reply& reply) {
  if (!check_.expired()) return reply(answer(503, "another protocol is being checked; try again in a moment"));
  const auto place = std::make_shared<const char>();
  check_ = place;
  const auto name = text_at(given, "protocol_name");
  const json body{{"protocol", text_at(given, "protocol")}, {"protocol_name", name.empty() ? "protocol.toml" : name}};
  daemon_.call(
      "POST", "/v1/check", dump(body), kCheckPatience,
      [reply, place](DaemonAnswer a) {
        reply({a.status == 0 ? 502 : a.status, a.status == 0 ? dump(a.body) : std::move(a.text), place});
      },
      on_behalf_of(who));
}

void Hub::save_protocol(const Who& who, const json& given, const Reply& reply) {
  auto name = text_at(given, "name"), text = text_at(given, "protocol"), replaces = text_at(given, "replaces");
  if (text.empty()) return reply(answer(400, "there is nothing to save"));
  from_disk([this, name = std::move(name), text = std::move(text),
             replaces = std::move(replaces)] { return saved_.save(name, text, replaces); },
            [who = Who(who), reply = Reply(reply)](const SavedProtocols::Saved& saved) {
              using Is = SavedProtocols::Saved::Is;
              if (saved.is == Is::kDone)
                spdlog::info("{}, by {} (uid {})", saved.text, base::printable(who.name), who.uid);
              const int status = saved.is == Is::kDone           ? 200
                                 : saved.is == Is::kThereAlready ? 409
                                 : saved.is == Is::kFailed       ? 500
                                                                 : 400;
              reply({status, dump({{"ok", saved.is == Is::kDone},
                                   {"text", saved.text},
                                   {"there_already", saved.is == Is::kThereAlready},
                                   {"version", saved.version}})});
            });
}

}  // namespace isorig::web
