#include <iostream>
#include <memory>
#include <string>

#include "cli/command.hpp"
#include "cli/rig/client.hpp"
#include "cli/rig/daemon_call.hpp"
#include "daemon/host/paths.hpp"

/// web: a link to the live page that may control the rig, from isorig-web's own socket.
namespace isorig::cli {
namespace {

Command add_web(CLI::App& app) {
  struct WebOptions : Common {
    std::string web_socket, name;
    int port = 0;
  };
  auto* sub = app.add_subcommand("web", "A link to the live page (isorig-web) that may control the rig; for one use");
  auto o = std::make_shared<WebOptions>();
  sub->add_option("--name", o->name, "Who controls, as the page and the log say; without it, the user's name");
  sub->add_option("--port", o->port, "This end of an ssh -L, if it is not isorig-web's own port")
      ->check(CLI::Range(1, 65535));
  sub->add_option("--web-socket", o->web_socket, "isorig-web's socket, if it was given one");
  add_common(*sub, *o);
  return {sub, [o] {
            const auto socket =
                o->web_socket.empty() ? daemon::web_socket_of(o->socket) : std::filesystem::path(o->web_socket);
            nlohmann::json body = nlohmann::json::object();
            if (!o->name.empty()) body["name"] = o->name;
            try {
              auto answer = Client(socket).post("/v1/link", body);
              if (answer.ok() && o->port != 0) {
                answer.body["text"] = "http://localhost:" + std::to_string(o->port) + answer.body.value("path", "");
              }
              return finish(answer, *o);
            } catch (const NoDaemon& e) {
              std::cerr << "isorig web: " << e.what()
                        << "\nIt is isorig-web that is asked there: systemctl start isorig-web, "
                        << "or isorig-web --socket " << o->socket << '\n';
              return static_cast<int>(kNoDaemon);
            }
          }};
}

const Registration kWeb(25, add_web);

}  // namespace
}  // namespace isorig::cli
