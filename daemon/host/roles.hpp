#pragma once
#include <sys/types.h>

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "daemon/host/peer.hpp"

namespace isorig::daemon {

struct RigConfig;

/// What a call needs; each includes those before it. To stop is nobody's right alone: whoever may open the socket may.
enum class Role { kSee, kOperate, kConfigure };
[[nodiscard]] const char* to_text(Role role);

/// Who may do what, by Unix group. Root and the user that the daemon runs as may everything. A role that names no group
/// is given to whoever has the role before it, and `see` to whoever may open the socket: without any group whoever may
/// open the socket may everything.
class Roles {
 public:
  struct Groups {
    std::vector<std::string> see, operate, configure;
  };
  Roles() = default;  ///< no group is named
  /// Throws std::runtime_error, naming a group that this machine does not have and how to make it.
  Roles(const Groups& groups, uid_t owner);

  [[nodiscard]] bool may(const Peer& who, Role role) const;
  /// Who may, and how to become one of them: for whoever was refused. Asks no name service: abort does
  /// not wait for one.
  [[nodiscard]] std::string why_not(const Peer& who, Role role) const;

 private:
  using Group = std::pair<std::string, gid_t>;
  [[nodiscard]] const std::vector<Group>* wanted(const Peer& who, Role role) const;

  std::array<std::vector<Group>, 3> groups_;
  uid_t owner_ = Peer::kUnknown;
  std::string owner_name_;
};

/// As its [api] says, for a daemon that runs as this user. Throws base::ConfigError for a group that is not there:
/// nobody would be its member, until somebody else makes one of that name.
[[nodiscard]] Roles roles_of(const RigConfig& rig);

}  // namespace isorig::daemon
