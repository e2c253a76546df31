#include <algorithm>
#include <array>
#include <cctype>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "cli/selftest/selftest_checks.hpp"
#include "model/words.hpp"
#include "webserver/answers.hpp"
#include "webserver/hub.hpp"
#include "webserver/rules/requests.hpp"
#include "webserver/words/diagnosis_words.hpp"

/// Hub: what is looked up at the daemon for one page.
namespace isorig::web {
namespace {

using nlohmann::json;

constexpr auto kLookUpPatience = std::chrono::seconds(20);
/// Of a question to the daemon that ends with for whom it is asked.
constexpr std::string_view kMaySee = "may see ";

Hub::Answer passed_on(DaemonAnswer& a) {
  return {a.status == 0 ? 502 : a.status, a.status == 0 ? dump(a.body) : std::move(a.text)};
}

/// Made of what the daemon has answered. One of another version is told, and ends nothing.
template <typename Make>
Hub::Answer made(Make make) {
  try {
    return {200, dump(make())};
  } catch (const std::exception& e) {
    return answer(502,
                  std::string("isorigd's answer is not what this page knows; are both of one version? ") + e.what());
  }
}

/// It stands in a path.
bool is_run_id(const std::string& id) {
  return !id.empty() && id.size() <= 200 && id.front() != '.' && std::all_of(id.begin(), id.end(), [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '-' || c == '_' || c == '.';
  });
}

bool is_fingerprint(const std::string& id) {
  return id.size() == 16 && std::all_of(id.begin(), id.end(), [](unsigned char c) { return std::isxdigit(c) != 0; });
}

/// What people call the effects that are named in a list of diagnoses.
json words_in(const json& list) {
  json words{{"nominal", model::explanation_words("nominal")}};
  const auto add = [&](const json& key) {
    if (key.is_array()) {
      for (const auto& one : key) {
        if (one.is_string()) words[one.get<std::string>()] = model::explanation_words(one.get<std::string>());
      }
    }
    if (key.is_string()) words[key.get<std::string>()] = model::explanation_words(key.get<std::string>());
  };
  const auto all = [&](const json& of, const char* name, const char* key) {
    for (const auto& one : of.value(name, json::array())) {
      if (one.is_object() && one.contains(key)) add(one[key]);
    }
  };
  for (const auto& d : list.value("diagnoses", json::array())) {
    all(d, "missing", "effect");
    all(d, "alternatives", "effects");
    all(d, "explanations", "effects");
    for (const auto& missing : d.value("missing", json::array())) {
      if (const auto able = missing.find("discernible"); able != missing.end() && able->contains("nearest"))
        add((*able)["nearest"]);
    }
    const auto next = d.find("next_experiment");
    if (next == d.end() || !next->is_object()) continue;
    for (const auto& key : next->value("separates", json::array())) add(key);
  }
  return words;
}

}  // namespace

/// One answer serves all who ask; whether it may be given to this one is asked for each session.
void Hub::look_up(const std::string& what, const Who& who, const Reply& reply) {
  if (what != "runs" && what != "calibrations" && what != "diagnoses" && what != "selftest")
    return reply(answer(404, "there is no such call"));
  looked_up_.get(std::string(kMaySee) + on_behalf_of(who), std::chrono::steady_clock::now(),
                 [this, what, reply](const Answer& a) {
                   if (a.status != 200) return reply(a);
                   looked_up_.get(what, std::chrono::steady_clock::now(), reply);
                 });
}

void Hub::look_for(const std::string& what) {
  const auto reply = [this, what](const Answer& a) { looked_up_.answered(what, a, std::chrono::steady_clock::now()); };
  if (what.starts_with(kMaySee)) {  // a call that needs that right alone, and no disk
    return daemon_.call(
        "GET", "/v1/status", {}, kLookUpPatience,
        [reply](DaemonAnswer a) { reply(a.status == 200 ? answer(200, "") : passed_on(a)); },
        what.substr(kMaySee.size()));
  }
  if (what == "diagnoses") {
    return daemon_.call("GET", "/v1/diagnoses", {}, kLookUpPatience, [reply](DaemonAnswer a) {
      if (a.status != 200) return reply(passed_on(a));
      reply(made([&] {
        a.body["words"] = words_in(a.body);
        put_in_words(a.body);
        return std::move(a.body);
      }));
    });
  }
  if (what != "selftest") {
    return daemon_.call("GET", "/v1/" + what, {}, kLookUpPatience, [reply](DaemonAnswer a) { reply(passed_on(a)); });
  }
  // The four answers that it is judged by, one after the other.
  static constexpr std::array kAsked{"status", "selftest", "readings", "calibrations"};
  struct Asking {
    Hub* hub;
    Reply reply;
    std::array<json, 4> answers;
    void ask(const std::shared_ptr<Asking>& self, std::size_t i) {
      if (i == kAsked.size()) {
        return reply(made([&] {
          return json{{"rig", answers[1].value("rig", "")},
                      {"simulated", answers[1].value("simulated", false)},
                      {"state", answers[0].value("state", "")},
                      {"lines", cli::to_json(cli::judge({answers[0], answers[1], answers[2], answers[3]}))}};
        }));
      }
      hub->daemon_.call("GET", std::string("/v1/") + kAsked[i], {}, kLookUpPatience, [self, i](DaemonAnswer a) {
        if (a.status != 200) return self->reply(passed_on(a));
        self->answers[i] = std::move(a.body);
        self->ask(self, i + 1);
      });
    }
  };
  const auto asking = std::make_shared<Asking>(Asking{this, reply, {}});
  asking->ask(asking, 0);
}

/// A page that stands by itself, in the answer's `page`.
void Hub::send_page(const std::string& path, const Who& who, const Reply& reply) {
  if (!report_.expired()) return reply(answer(503, "another page is being sent; try again in a moment"));
  const auto place = std::make_shared<const char>();
  report_ = place;
  daemon_.call(
      "GET", path, {}, kLookUpPatience,
      [reply, place](DaemonAnswer a) {
        if (a.status != 200) return reply(passed_on(a));
        const auto page = a.body.find("page");
        if (page == a.body.end() || !page->is_string()) return reply(answer(502, "isorigd's answer has no page"));
        reply({200, std::move(page->get_ref<std::string&>()), place});
      },
      on_behalf_of(who));
}

void Hub::report(const std::string& run, const Who& who, const Reply& reply) {
  if (!is_run_id(run)) return reply(answer(400, "this is no name of a run"));
  send_page("/v1/report?run=" + run, who, reply);
}

void Hub::page(const std::string& path, const Who& who, const Reply& reply) {
  if (!is_path_of_a_report(path)) return reply(answer(400, "this is no path of a report"));
  send_page("/v1/page?path=" + path, who, reply);
}

void Hub::experiment(const std::string& id, const Who& who, const Reply& reply) {
  if (!is_fingerprint(id)) return reply(answer(400, "this is no name of a diagnosis"));
  // Each looks through folders on the worker that a start waits for.
  if (!experiment_.expired())
    return reply(answer(503, "another experiment is being looked for; try again in a moment"));
  const auto place = std::make_shared<const char>();
  experiment_ = place;
  daemon_.call(
      "GET", "/v1/experiment?id=" + id, {}, kLookUpPatience,
      [reply, place](DaemonAnswer a) {
        auto answer = passed_on(a);
        answer.place = place;
        reply(std::move(answer));
      },
      on_behalf_of(who));
}

}  // namespace isorig::web
