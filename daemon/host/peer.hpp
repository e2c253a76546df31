#pragma once
#include <sys/types.h>

#include <cstddef>
#include <string>
#include <vector>

namespace isorig::daemon {

/// The process at the other end of a Unix socket as the kernel says (SO_PEERCRED, SO_PEERGROUPS, unix(7)): what it was
/// when it connected, whatever it has become since. Nothing in it is the client's word.
struct Peer {
  static constexpr uid_t kUnknown = static_cast<uid_t>(-1);  ///< nobody's number: it has no right that root has
  uid_t uid = kUnknown;
  gid_t gid = static_cast<gid_t>(-1);
  pid_t pid = 0;
  std::vector<gid_t> groups;  ///< supplementary ones

  [[nodiscard]] bool is_in(gid_t group) const;
};

[[nodiscard]] Peer peer_of(int socket_fd);

/// "ann", or "uid 1000" when the machine has no name for it. Asks the name service, which may be a server elsewhere.
[[nodiscard]] std::string user_name(uid_t uid);
/// So many names are remembered, then all are forgotten: who calls under ever other users must not fill the memory.
inline constexpr std::size_t kUserNamesKept = 1000;

}  // namespace isorig::daemon
