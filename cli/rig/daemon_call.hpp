#pragma once
#include <iostream>
#include <string>

#include "cli/command.hpp"
#include "cli/rig/client.hpp"
#include "daemon/host/paths.hpp"

/// What every command that is one call to the daemon has in common.
namespace isorig::cli {

struct Common {
  std::string socket = daemon::default_socket().string();
  bool json = false;
};

inline void add_common(CLI::App& sub, Common& common) {
  sub.add_option("--socket", common.socket, "The daemon's socket")->capture_default_str();
  sub.add_flag("--json", common.json, "Print the daemon's answer as it came");
}

inline int finish(const Answer& answer, const Common& common) {
  if (common.json) {
    std::cout << answer.body.dump(2) << '\n';
  } else if (answer.ok()) {
    std::cout << answer.text() << '\n';
  } else {
    std::cerr << answer.text() << '\n';
  }
  if (answer.ok()) return kOk;
  return answer.status == 400 ? kBadInput : kRefused;
}

template <typename Call>
int with_daemon(Call&& call) {
  try {
    return call();
  } catch (const NoDaemon& e) {
    std::cerr << "isorig: " << e.what() << '\n';
    return kNoDaemon;
  }
}

}  // namespace isorig::cli
