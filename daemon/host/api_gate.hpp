#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "daemon/host/audit_log.hpp"
#include "daemon/host/control.hpp"
#include "daemon/host/http_server.hpp"
#include "daemon/host/roles.hpp"

namespace isorig::daemon {

/// What a call needs. The calls that stop the rig need nothing: who may open the socket may.
struct Needs {
  std::optional<Role> role;
  bool control = false;
  bool command = false;  ///< is written down, whatever comes of it
};

/// Who asks. For isorig-web, which speaks for the users of its page, the header Isorig-For says for whom: a JSON object
/// with `uid`, `gid`, `groups`, `name` and `page`. Nobody gains by it: both have to have the right.
struct Caller {
  Peer peer;
  std::optional<Peer> for_whom;
  std::string for_name, page;
};
/// Throws BadRequest (api_requests.hpp).
[[nodiscard]] Caller caller_of(const HttpRequest& request);

/// The gate that every call goes through: rights by group, control by one at a time, and what came of it on paper.
class ApiGate {
 public:
  /// A line for the journal.
  using Log = std::function<void(const std::string&)>;
  /// `audit` may be null.
  ApiGate(Roles roles, AuditLog* audit, Log log, std::function<bool()> busy);

  /// One call on its way. Its reply is the only one that is to be used: it gives back control that was taken for a
  /// command which then was refused, and writes down what came of it.
  struct Pass {
    HttpRequest request;
    Needs needs;
    Caller caller;
    std::uint64_t newly = 0;     ///< Control::Use
    bool may_read_long = false;  ///< the thread that answers may parse a long body
  };
  struct Entered {
    std::shared_ptr<Pass> pass;
    HttpServer::Reply reply;
    int status = 0;  ///< of the refusal; 0: it may go on
    std::string refused;
  };
  [[nodiscard]] Entered enter(const HttpRequest& request, const Needs& needs, HttpServer::Reply reply);
  /// Why not, or "". For a call of which its body says whether it needs control, and for one that had to wait for its
  /// turn: meanwhile somebody else may have taken control over.
  [[nodiscard]] std::string take_control(Pass& pass);

  /// Who asks, for events: "ann (uid 1000)". Asks no name service: a stop may not wait for it; whoever has been given
  /// control was asked for before.
  [[nodiscard]] std::string who(const Caller& caller);

  /// POST /v1/control.
  [[nodiscard]] HttpAnswer change_control(const Pass& pass);
  /// Who has it, or null.
  [[nodiscard]] nlohmann::json control_json();

 private:
  [[nodiscard]] Seat seat_of(const Caller& caller);
  [[nodiscard]] bool is_to_be_noted(const Pass& pass, const HttpAnswer& answer);
  void note(const Pass& pass, const HttpAnswer& answer);
  void note_end(const Control::Holder& holder);

  const Roles roles_;
  AuditLog* const audit_;
  const Log log_;
  Control control_;
  std::mutex names_mutex_;
  std::map<uid_t, std::string> names_;  // guarded by it
  const std::set<uid_t> trusted_relays_;
  std::mutex looks_mutex_;
  std::map<std::pair<uid_t, std::string>, Control::Time> looks_noted_;  // guarded by it
};

}  // namespace isorig::daemon
