#include "daemon/host/roles.hpp"

#include <grp.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <stdexcept>

#include "base/toml_reader.hpp"
#include "daemon/rig/config.hpp"

namespace isorig::daemon {
namespace {

constexpr std::size_t kMostGroupBytes = std::size_t{1} << 22U;  // a group may have thousands of members

gid_t gid_of(const std::string& name, const char* key) {
  group entry{};
  group* found = nullptr;
  std::vector<char> room(1 << 14U);
  int error = 0;
  while ((error = ::getgrnam_r(name.c_str(), &entry, room.data(), room.size(), &found)) == ERANGE &&
         room.size() < kMostGroupBytes) {
    room.resize(2 * room.size());
  }
  if (found == nullptr) {
    throw std::runtime_error("[api] " + std::string(key) + " names the group \"" + name +
                             "\", which this machine does not have; make it (groupadd --system " + name +
                             "), or name another");
  }
  return entry.gr_gid;
}

}  // namespace

const char* to_text(Role role) {
  switch (role) {
    case Role::kSee:
      return "see";
    case Role::kOperate:
      return "operate";
    case Role::kConfigure:
      break;
  }
  return "configure";
}

Roles::Roles(const Groups& groups, uid_t owner) : owner_(owner), owner_name_(user_name(owner)) {
  const auto take = [&](Role role, const std::vector<std::string>& names) {
    for (const auto& name : names)
      groups_.at(static_cast<std::size_t>(role)).emplace_back(name, gid_of(name, to_text(role)));
  };
  take(Role::kSee, groups.see);
  take(Role::kOperate, groups.operate);
  take(Role::kConfigure, groups.configure);
}

/// The groups of which `who` is in none; nothing when `who` may. Members of a later role's groups have the earlier
/// ones.
const std::vector<Roles::Group>* Roles::wanted(const Peer& who, Role role) const {
  if (who.uid == 0 || (owner_ != Peer::kUnknown && who.uid == owner_)) return nullptr;
  const auto is_member = [&](const std::vector<Group>& of) {
    return std::any_of(of.begin(), of.end(), [&](const Group& g) { return who.is_in(g.second); });
  };
  // The nearest role at or before the wanted one that names groups is the one that is asked for.
  for (auto r = static_cast<std::size_t>(role) + 1; r-- > 0;) {
    if (groups_.at(r).empty()) continue;
    for (auto higher = r; higher < groups_.size(); ++higher) {
      if (is_member(groups_.at(higher))) return nullptr;
    }
    return &groups_.at(r);
  }
  return nullptr;
}

bool Roles::may(const Peer& who, Role role) const {
  return wanted(who, role) == nullptr;
}

std::string Roles::why_not(const Peer& who, Role role) const {
  const auto* groups = wanted(who, role);
  if (groups == nullptr) return {};
  std::string names;
  for (const auto& [name, gid] : *groups) names += (names.empty() ? "" : " or ") + name;
  return "uid " + std::to_string(who.uid) + " may not " + to_text(role) +
         " this rig; who may: " + (groups->size() == 1 ? "members of the group " : "members of the groups ") + names +
         ", root" + (owner_ == 0 ? "" : ", " + owner_name_) + ". To become one: an administrator runs `usermod -aG " +
         groups->front().first + " NAME`, then log in again (on the live page: with a new link of `isorig web`)";
}

Roles roles_of(const RigConfig& rig) {
  try {
    return {{rig.api.see, rig.api.operate, rig.api.configure}, ::geteuid()};
  } catch (const std::runtime_error& e) {
    throw base::ConfigError({{rig.path.string(), 0, 0, e.what()}});
  }
}

}  // namespace isorig::daemon
