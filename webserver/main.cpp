#include <pwd.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <cstdlib>
#include <iostream>
#include <string>
#include <thread>
#include <utility>

#include "base/printable.hpp"
#include "daemon/host/http_server.hpp"
#include "daemon/host/paths.hpp"
#include "daemon/host/unix_listener.hpp"
#include "daemon/revision.hpp"
#include "daemon/version.hpp"
#include "webserver/hub.hpp"
#include "webserver/mint.hpp"
#include "webserver/server.hpp"

namespace {

/// The service's own folder, or the user's; empty: neither is known.
std::string default_saved_protocols() {
  const auto under = [](const char* variable, const char* folder) -> std::string {
    const char* base = std::getenv(variable);
    return base != nullptr && *base == '/' ? std::string(base) + folder : std::string();
  };
  for (const auto& [variable, folder] :
       {std::pair{"STATE_DIRECTORY", "/protocols"}, std::pair{"XDG_DATA_HOME", "/isorig/protocols"},
        std::pair{"HOME", "/.local/share/isorig/protocols"}}) {
    if (auto found = under(variable, folder); !found.empty()) return found;
  }
  return {};
}

}  // namespace

/// Exit codes: 0 stopped as asked, 1 failure, 2 usage.
int main(int argc, char** argv) {
  using namespace isorig;
  if (const auto why = base::why_not_arguments(argc, argv); !why.empty()) {
    std::cerr << "isorig-web: " << why << '\n';
    return 2;
  }
  CLI::App app("The live page of a rig, on this machine's loopback", "isorig-web");
  web::HubSettings settings;
  settings.socket = daemon::default_socket().string();
  std::string protocols = "/usr/share/isorig/protocols", specimens = "/etc/isorig/specimens",
              models = "/etc/isorig/models", door, saved = default_saved_protocols();
  std::uint16_t port = 8730;
  app.add_option("--socket", settings.socket, "The daemon's control socket")->capture_default_str();
  app.add_option("--port", port, "TCP port on 127.0.0.1; 0: any that is free")->capture_default_str();
  app.add_option("--web-socket", door, "Where `isorig web` asks for links, instead of the daemon's socket with .web");
  app.add_option("--protocols", protocols, "Protocols a run can be started from")->capture_default_str();
  app.add_option("--saved-protocols", saved, "Where protocols that are edited on the page are saved")
      ->capture_default_str();
  app.add_option("--specimens", specimens, "Specimens to choose from")->capture_default_str();
  app.add_option("--models", models, "Models for the live twin (model.toml of a diagnosis)")->capture_default_str();
  app.set_version_flag("--version", std::string("isorig-web ") + daemon::kVersion + " (" + daemon::kRevision + ")");
  app.footer("Exit codes: 0 stopped as asked, 1 failure, 2 usage.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  settings.protocols = protocols;
  settings.saved_protocols = saved;
  settings.specimens = specimens;
  settings.models = models;
  if (door.empty()) door = daemon::web_socket_of(settings.socket).string();
  try {
    spdlog::set_pattern("%Y-%m-%d %H:%M:%S.%e %l: %v");
    spdlog::flush_on(spdlog::level::info);
    boost::asio::io_context io(1);
    boost::asio::signal_set signals(io, SIGTERM, SIGINT, SIGHUP);
    signals.async_wait([&io](boost::system::error_code, int) { io.stop(); });
    web::Hub hub(io, settings);
    web::Server server(io, hub, port, {});
    web::Mint mint(door, hub.access(), server.port());
    std::thread minting([&mint] { mint.run(); });
    spdlog::info("the live page is at http://localhost:{}/ (view only); `isorig web` gives a link that may control",
                 server.port());
    server.start();
    hub.start();
    int code = 0;
    try {
      io.run();
    } catch (const std::exception& e) {
      spdlog::error("{}", base::printable_lines(e.what()));
      code = 1;
    }
    mint.stop();
    minting.join();
    return code;
  } catch (const std::exception& e) {
    std::cerr << "isorig-web: " << base::printable_lines(e.what()) << '\n';
    return 1;
  }
}
