#include <spdlog/spdlog.h>

#include "base/printable.hpp"
#include "base/toml_reader.hpp"
#include "webserver/answers.hpp"
#include "webserver/hub.hpp"
#include "webserver/rules/files.hpp"
#include "webserver/rules/requests.hpp"

/// Hub: the live twin.
namespace isorig::web {
namespace {

using nlohmann::json;

constexpr auto kTwinPatience = std::chrono::seconds(5);
constexpr auto kTellPatience = std::chrono::seconds(1);

}  // namespace

/// "" or what is wrong with it.
std::string Hub::choose_twin(const std::string& text, TwinDesk::Choice choice) {
  try {
    choice.spec = model::parse_model(text, choice.name);
    if (choice.spec.name.empty()) choice.spec.name = choice.name;
    twin_.choose(std::move(choice));
    return {};
  } catch (const base::ConfigError& e) {
    return e.what();
  } catch (const std::invalid_argument& e) {
    return choice.name + ": " + e.what();
  }
}

void Hub::change_twin(const Who& who, const json& given, const Reply& reply) {
  const auto file = text_at(given, "model_file"), own = text_at(given, "model");
  if (file.empty() && own.empty()) {
    twin_.put_away();
    twin_.overrule();
    spdlog::info("twin put away by {} (uid {})", base::printable(who.name), who.uid);
    return reply(answer(200, "no model is stepped beside the rig"));
  }
  const auto on_parting = on_parting_of(given.contains("on_parting") ? text_at(given, "on_parting") : "mark");
  if (!on_parting) return reply(answer(400, "`on_parting` has to be mark, pause or abort"));
  TwinDesk::Choice choice{own.empty() ? file : text_at(given, "model_name"), {}, *on_parting, false};
  if (!is_plain_toml_name(choice.name)) choice.name = "model.toml";
  if (!own.empty()) return take_twin(who, std::move(choice), own, reply);
  from_disk([this, file] { return model_text(file); },
            [this, who = Who(who), file, choice = std::move(choice),
             reply = Reply(reply)](const std::optional<std::string>& text) mutable {
              if (!text) return reply(answer(400, "no model " + base::printable(file) + " in the library"));
              take_twin(who, std::move(choice), *text, reply);
            });
}

std::optional<std::string> Hub::model_text(const std::string& name) const {
  return is_plain_toml_name(name) ? text_of(settings_.models / name) : std::nullopt;
}

void Hub::take_twin(const Who& who, TwinDesk::Choice choice, const std::string& text, const Reply& reply) {
  const auto on_parting = choice.on_parting;
  const auto name = choice.name;
  if (const auto why = choose_twin(text, std::move(choice)); !why.empty()) return reply(answer(400, why));
  twin_.overrule();
  spdlog::info("twin {} chosen by {} (uid {}), on parting: {}", base::printable(name), base::printable(who.name),
               who.uid, to_text(on_parting));
  const bool band = twin_.choice()->spec.seen.has_value();
  reply(answer(200, name + " is stepped beside the rig" +
                        (band ? "" : "; it does not say what it has seen ([seen]), so that it has no band")));
}

void Hub::on_plan(const DaemonAnswer& answer) {
  plan_ = std::make_shared<const Message>(
      Message{"{\"kind\":\"plan\",\"plan\":" + answer.text + "}", Message::Kind::kPlan});
  broadcast(plan_);
  run_ = text_at(answer.body, "run");
  if (!twin_.plan(answer.body) || twin_.overruled()) return;
  const auto wish = answer.body.find("twin");
  if (twin_.choice() && twin_.choice()->by_protocol) twin_.put_away();  // that of the run before
  if (wish == answer.body.end() || !wish->is_object()) return;
  const auto name = text_at(*wish, "model");
  const auto then = on_parting_of(text_at(*wish, "on_parting")).value_or(TwinDesk::OnParting::kMark);
  from_disk([this, name] { return model_text(name); },
            [this, name, then, run = run_](const std::optional<std::string>& text) {
              if (run != run_ || twin_.overruled()) return;  // another run, or somebody's choice, meanwhile
              twin_of_protocol(name, text, then);
            });
}

void Hub::twin_of_protocol(const std::string& name, const std::optional<std::string>& text, TwinDesk::OnParting then) {
  std::string why;
  if (!text) {
    why = "the protocol asks for the model " + base::printable(name) + ", which is not in " +
          settings_.models.string() + " (isorig-web --models)";
  } else {
    why = choose_twin(*text, {name, {}, then, true});
  }
  if (why.empty()) {
    spdlog::info("twin {} of the protocol, on parting: {}", name, to_text(twin_.choice()->on_parting));
  } else {
    twin_.put_away(why);
    spdlog::warn("no twin: {}", base::printable_lines(why));
  }
}

/// Marked for all, noted at the run, and what was asked for is done.
void Hub::look_at_twin() {
  if (const auto fault = twin_.take_fault(); !fault.empty()) {
    spdlog::warn("{}", base::printable(fault));
    add_event({{"mono_ns", history_.series(Stream::kFrame).newest_ns().value_or(0)},
               {"severity", "warning"},
               {"code", "twin"},
               {"text", fault},
               {"count", 1}});
  }
  const auto found = twin_.take_found();
  if (!found) return;
  spdlog::warn("{}", base::printable(found->text));
  add_event({{"mono_ns", found->parting.mono_ns},
             {"severity", "warning"},
             {"code", "twin"},
             {"text", found->text},
             {"count", 1}});
  const auto call = [this](const std::string& path, const json& body, const std::string& what) {
    daemon_.call("POST", path, dump(body), kTwinPatience, [this, what](const DaemonAnswer& a) {
      looked_up_.forget();  // a note is part of the list of runs
      spdlog::info("{}: {}", what, base::printable(a.body.value("text", std::string())));
    });
  };
  const std::string then = to_text(found->on_parting);
  const auto act = [call, then, marks = found->on_parting == TwinDesk::OnParting::kMark] {
    if (!marks) call("/v1/" + then, json::object(), then + " by the twin");
  };
  if (run_.empty()) {
    act();
  } else {
    // First why, so that whoever is told of the pause is told its cause; the pause itself waits no longer than this.
    daemon_.call("POST", "/v1/parted", dump({{"run", run_}, {"text", found->text}, {"then", then}}), kTellPatience,
                 [act](const DaemonAnswer&) { act(); });
  }
  if (!run_.empty()) {
    call("/v1/notes", {{"run", run_}, {"by", "isorig-web"}, {"text", found->text}}, "note to the run by the twin");
  }
}

}  // namespace isorig::web
