#include <lcm/lcm.h>
#include <unistd.h>

#include <chrono>
#include <iostream>
#include <memory>
#include <thread>

#include "cli/command.hpp"
#include "cli/rig/rig_at_rest.hpp"
#include "cli/selftest/selftest_checks.hpp"
#include "daemon/host/paths.hpp"

/// isorig selftest: every device, interlock and limit of a rig at rest, through the daemon.
namespace isorig::cli {
namespace {

struct SelftestOptions {
  bool with_pressure = false, non_interactive = false, yes = false, json = false, strict = false;
  double pressure_psi = 5.0, leak_s = 20.0, window_s = 5.0, lcm_s = 2.0;
  std::string socket = daemon::default_socket().string();
};

/// Messages that come in over LCM; negative when there is no receiver.
int listen(const std::string& url, double seconds) {
  const std::unique_ptr<lcm_t, decltype(&lcm_destroy)> lcm(lcm_create(url.c_str()), &lcm_destroy);
  if (lcm == nullptr) return -1;
  int count = 0;
  const auto take = [](const lcm_recv_buf_t*, const char*, void* counter) { ++*static_cast<int*>(counter); };
  if (lcm_subscribe(lcm.get(), "ISORIG.*", take, &count) == nullptr) return -1;
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (std::chrono::steady_clock::now() < end) {
    if (lcm_handle_timeout(lcm.get(), 50) < 0) return -1;
  }
  return count;
}

bool closed(const Client& client, const char* key) {
  return client.get_or_throw("/v1/status")["interlock"].value(key, false);
}

/// The operator opens and closes a contact; the daemon has to see both.
Line walk_contact(const Client& client, const char* check, const char* key, const std::string& open_it,
                  const std::string& close_it) {
  const auto wait_for = [&](bool state) {
    for (int i = 0; i < 40 && closed(client, key) != state; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return closed(client, key) == state;
  };
  const auto answer = ask(open_it + ", then press Enter (n: leave it out): ");
  if (!answer || *answer == "n" || *answer == "no")
    return {check, Verdict::kSkipped, "the operator left it out", "run it at the rig"};
  const bool saw_open = wait_for(false);
  (void)ask(close_it + ", then press Enter: ");
  const bool saw_closed = wait_for(true);
  if (saw_open && saw_closed) return {check, Verdict::kOk, "seen open and closed", ""};
  return {check, Verdict::kFail,
          !saw_open ? "was not seen open: a press would go unnoticed" : "was not seen closed again",
          "the contact's wire and line, active_low and bias in [interlock] (docs/gpio.md)"};
}

std::vector<Line> walk_interlock(const Client& client) {
  return {walk_contact(client, "interlock.estop.walk", "estop_closed", "Press the emergency stop", "Release it"),
          walk_contact(client, "interlock.guard.walk", "guard_closed", "Open the guard", "Close it")};
}

std::vector<Line> test_air(const Client& client, const SelftestOptions& o) {
  AirTest t;
  t.wanted_psi = o.pressure_psi;
  const auto shown = [&](double window_s) {
    return client.get_or_throw("/v1/readings?window_s=" + std::to_string(window_s))["pressure"].value("calibrated",
                                                                                                      0.0);
  };
  try {
    HeldPressure held(client, {o.pressure_psi}, "selftest");
    held.go_to(0);
    pause_for(1.0);
    t.reached_psi = shown(0.5);
    if (const auto sealed = client.post("/v1/seal"); !sealed.ok()) throw std::runtime_error(sealed.text());
    pause_for(2.0);  // what the valves' closing and the air's temperature do is no leak
    t.sealed_from_psi = shown(0.5);
    pause_for(o.leak_s);
    t.sealed_to_psi = shown(0.5);
    t.sealed_s = o.leak_s;
  } catch (const NoDaemon&) {
    throw;
  } catch (const Interrupted&) {
    throw;
  } catch (const std::runtime_error& e) {
    return {{"air.fill", Verdict::kFail, e.what(), "what it says; then isorig selftest --with-pressure again"}};
  }
  wait_for_rest(client, 60.0);
  std::this_thread::sleep_for(std::chrono::seconds(2));
  t.vented_psi = shown(0.5);
  return judge_air(t);
}

int selftest(const SelftestOptions& o) {
  const bool somebody = !o.non_interactive && ::isatty(STDIN_FILENO) != 0;
  if (o.with_pressure && !o.yes && !somebody) {
    std::cerr << "isorig selftest: nobody to ask whether the rig may be pressurized; add --yes\n";
    return kUsage;
  }
  const Client client(o.socket);
  Answers a;
  a.status = client.get_or_throw("/v1/status");
  const auto state = a.status.value("state", "");
  if (a.status.contains("run") || state == "running" || state == "paused" || state == "stopping") {
    std::cerr << "isorig selftest: the rig is " << state << "; a self-test wants it at rest\n";
    return kRefused;
  }
  a.selftest = client.get_or_throw("/v1/selftest");
  int messages = 0;
  const bool lcm = a.selftest["lcm"].value("enabled", false);
  if (lcm) messages = listen(a.selftest["lcm"].value("url", ""), o.lcm_s);
  std::this_thread::sleep_for(std::chrono::duration<double>(std::max(0.0, o.window_s - (lcm ? o.lcm_s : 0.0))));
  a.readings = client.get_or_throw("/v1/readings?window_s=" + std::to_string(o.window_s));
  a.status = client.get_or_throw("/v1/status");
  a.selftest = client.get_or_throw("/v1/selftest");
  a.calibrations = client.get_or_throw("/v1/calibrations");
  auto lines = judge(a);
  lines.push_back(judge_lcm(a.selftest, messages, o.lcm_s));

  const auto append = [&](std::vector<Line> more) { lines.insert(lines.end(), more.begin(), more.end()); };
  if (!a.status["interlock"].value("watched", true)) {
    lines.push_back({"interlock.walk", Verdict::kSkipped, "the chain is not watched", "[interlock] driver = \"gpio\""});
  } else if (!somebody) {
    lines.push_back({"interlock.walk", Verdict::kSkipped,
                     "nobody to press and release (no terminal, or --non-interactive)",
                     "run it at the rig, at a terminal"});
  } else {
    append(walk_interlock(client));
  }
  if (!o.with_pressure) {
    lines.push_back({"air", Verdict::kSkipped, "valves and leak are tested with --with-pressure",
                     "isorig selftest --with-pressure"});
  } else if (a.status.value("state", "") != "ready") {
    lines.push_back(
        {"air.fill", Verdict::kFail, "the rig is not ready, nothing was pressurized", "what is named above"});
  } else if (consent("The rig will pressurize what is connected to " + std::to_string(o.pressure_psi).substr(0, 5) +
                         " psi and vent. Go on?",
                     o.yes)) {
    append(test_air(client, o));
  } else {
    lines.push_back({"air", Verdict::kSkipped, "the operator said no", ""});
  }

  int count[4] = {};
  for (const auto& l : lines) ++count[static_cast<std::size_t>(l.verdict)];
  const bool bad = count[3] > 0 || (o.strict && count[2] > 0);
  if (o.json) {
    std::cout << nlohmann::json{{"rig", a.status.value("rig", "")}, {"ok", !bad}, {"checks", to_json(lines)}}.dump(2)
              << '\n';
  } else {
    std::cout << "rig " << a.status.value("rig", "") << "\n"
              << table_of(lines) << count[0] << " ok, " << count[2] << " warnings, " << count[3] << " failures, "
              << count[1] << " skipped\n";
  }
  return bad ? kFailure : kOk;
}

Command add_selftest(CLI::App& app) {
  auto* sub = app.add_subcommand("selftest",
                                 "Walk every device, interlock and limit with the rig at rest, and say what to check");
  auto o = std::make_shared<SelftestOptions>();
  sub->add_flag("--with-pressure", o->with_pressure, "Fill a little, seal, measure the leak, vent");
  sub->add_option("--pressure-psi", o->pressure_psi, "For that")->check(within(1.0, 30.0))->capture_default_str();
  sub->add_option("--leak-s", o->leak_s, "How long the leak is watched")
      ->check(within(2.0, 3600.0))
      ->capture_default_str();
  sub->add_option("--window-s", o->window_s, "How long noise and rates are watched")
      ->check(within(1.0, 10.0))
      ->capture_default_str();
  sub->add_flag("--non-interactive", o->non_interactive, "Do not ask to open and close the contacts, only read them");
  sub->add_flag("--yes", o->yes, "Do not ask whether to pressurize");
  sub->add_flag("--strict", o->strict, "A warning fails, too");
  sub->add_flag("--json", o->json, "For scripts");
  sub->add_option("--socket", o->socket, "The daemon's socket")->capture_default_str();
  return {sub, [o] {
            try {
              return selftest(*o);
            } catch (const NoDaemon& e) {
              std::cerr << "isorig: " << e.what() << '\n';
              return static_cast<int>(kNoDaemon);
            }
          }};
}

const Registration kSelftest(24, add_selftest);

}  // namespace
}  // namespace isorig::cli
