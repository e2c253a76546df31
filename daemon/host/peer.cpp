#include "daemon/host/peer.hpp"

#include <pwd.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "base/printable.hpp"

namespace isorig::daemon {

bool Peer::is_in(gid_t group) const {
  return gid == group || std::find(groups.begin(), groups.end(), group) != groups.end();
}

Peer peer_of(int socket_fd) {
  Peer peer;
  ucred credentials{};
  socklen_t size = sizeof credentials;
  if (::getsockopt(socket_fd, SOL_SOCKET, SO_PEERCRED, &credentials, &size) != 0) return peer;
  peer.uid = credentials.uid;
  peer.gid = credentials.gid;
  peer.pid = credentials.pid;
  // ERANGE says how many bytes there are (Linux 4.13). A kernel without it knows the first group alone: fewer rights.
  std::vector<gid_t> groups(32);
  for (int attempt = 0; attempt < 2; ++attempt) {
    size = static_cast<socklen_t>(groups.size() * sizeof(gid_t));
    const bool known = ::getsockopt(socket_fd, SOL_SOCKET, SO_PEERGROUPS, groups.data(), &size) == 0;
    if (!known && errno != ERANGE) return peer;
    groups.resize(size / sizeof(gid_t));
    if (!known) continue;
    peer.groups = std::move(groups);
    break;
  }
  return peer;
}

std::string user_name(uid_t uid) {
  passwd entry{};
  passwd* found = nullptr;
  std::array<char, 4096> room{};
  if (uid != Peer::kUnknown && ::getpwuid_r(uid, &entry, room.data(), room.size(), &found) == 0 && found != nullptr)
    return base::printable(entry.pw_name);
  return "uid " + std::to_string(uid);
}

}  // namespace isorig::daemon
