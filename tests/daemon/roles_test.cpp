#include "daemon/host/roles.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <grp.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include "as_user.hpp"
#include "base/toml_reader.hpp"
#include "daemon/host/peer.hpp"
#include "daemon/rig/config.hpp"
#include "rig_fixture.hpp"

namespace isorig::daemon::test {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::ThrowsMessage;

constexpr uid_t kOwner = 900;

gid_t gid_of(const char* name) {
  const auto* entry = ::getgrnam(name);  // of every Debian: base-passwd
  return entry == nullptr ? static_cast<gid_t>(-1) : entry->gr_gid;
}
Peer member_of(const char* group) {
  return {1000, 1000, 1, {27, gid_of(group)}};
}
const Peer kNoMember{1001, 1001, 1, {}};

TEST(Roles, WithoutAGroupWhoeverMayOpenTheSocketMayEverything) {
  const Roles roles({}, kOwner);
  for (const auto role : {Role::kSee, Role::kOperate, Role::kConfigure}) {
    EXPECT_TRUE(Roles().may(kNoMember, role));
    EXPECT_TRUE(roles.may(kNoMember, role));
  }
}

TEST(Roles, EachIncludesThoseBeforeItAndRootAndTheOwnerMayAll) {
  const Roles roles({{"users"}, {"games"}, {"adm"}}, kOwner);
  const auto rights = [&](const Peer& who) {
    return std::vector<bool>{roles.may(who, Role::kSee), roles.may(who, Role::kOperate),
                             roles.may(who, Role::kConfigure)};
  };
  EXPECT_THAT(rights(kNoMember), ElementsAre(false, false, false));
  EXPECT_THAT(rights(member_of("users")), ElementsAre(true, false, false));
  EXPECT_THAT(rights(member_of("games")), ElementsAre(true, true, false));
  EXPECT_THAT(rights(member_of("adm")), ElementsAre(true, true, true));
  EXPECT_THAT(rights({0, 0, 1, {}}), ElementsAre(true, true, true));
  EXPECT_THAT(rights({kOwner, 77, 1, {}}), ElementsAre(true, true, true));
  EXPECT_THAT(rights({1002, gid_of("games"), 1, {}}), ElementsAre(true, true, false)) << "by the first group";
}

TEST(Roles, OneThatNamesNoGroupIsGivenToWhoHasTheOneBefore) {
  const Roles operate_only({{}, {"games"}, {}}, kOwner);
  EXPECT_TRUE(operate_only.may(kNoMember, Role::kSee));
  EXPECT_FALSE(operate_only.may(kNoMember, Role::kOperate));
  EXPECT_FALSE(operate_only.may(kNoMember, Role::kConfigure));
  EXPECT_TRUE(operate_only.may(member_of("games"), Role::kConfigure));
  const Roles configure_only({{}, {}, {"adm"}}, kOwner);
  EXPECT_TRUE(configure_only.may(kNoMember, Role::kOperate));
  EXPECT_FALSE(configure_only.may(kNoMember, Role::kConfigure));
}

TEST(Roles, APeerThatTheKernelDoesNotNameIsNotRoot) {
  const Roles roles({{}, {"games"}, {}}, Peer::kUnknown);
  EXPECT_FALSE(roles.may(Peer(), Role::kOperate));
  EXPECT_EQ(peer_of(-1).uid, Peer::kUnknown);
}

TEST(Roles, ARefusalSaysWhoMayAndHowToBecomeOne) {
  const Roles roles({{}, {"games", "users"}, {"adm"}}, kOwner);
  EXPECT_THAT(roles.why_not(kNoMember, Role::kOperate),
              AllOf(HasSubstr("uid 1001 may not operate this rig"), HasSubstr("members of the groups games or users"),
                    HasSubstr("root, uid 900"), HasSubstr("usermod -aG games NAME"), HasSubstr("log in again")));
  EXPECT_THAT(roles.why_not(kNoMember, Role::kConfigure), HasSubstr("members of the group adm"));
  EXPECT_EQ(roles.why_not(member_of("games"), Role::kOperate), "");
}

TEST(Roles, AGroupThatIsNotThereIsNamedWithTheFile) {
  EXPECT_THAT(
      [] {
        (void)Roles({{}, {"no-such-group"}, {}}, 0);
      },
      ThrowsMessage<std::runtime_error>(AllOf(HasSubstr("[api] operate names the group \"no-such-group\""),
                                              HasSubstr("groupadd --system no-such-group"))));
  auto rig = load_rig(source("config/rigs/sim.toml"));
  EXPECT_TRUE(roles_of(rig).may(kNoMember, Role::kConfigure)) << "what is shipped names no group";
  rig.api.configure = {"no-such-group"};
  EXPECT_THAT([&] { (void)roles_of(rig); }, ThrowsMessage<base::ConfigError>(HasSubstr("sim.toml")));
}

/// What the kernel says of a connection is what its opener was then, with all groups, and not what it becomes.
TEST(Peer, IsWhoOpenedTheConnection) {
  if (::geteuid() != 0) GTEST_SKIP() << kNeedsRoot;
  int ends[2];
  std::vector<gid_t> many;
  for (gid_t g = 20'000; g < 20'100; ++g) many.push_back(g);  // more than are asked for at first
  as_user(12'345, 12'346, many, [&] { ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0); });
  const auto peer = peer_of(ends[0]);
  ::close(ends[0]);
  ::close(ends[1]);
  EXPECT_EQ(peer.uid, 12'345U);
  EXPECT_EQ(peer.gid, 12'346U);
  EXPECT_EQ(peer.pid, ::getpid());
  EXPECT_EQ(peer.groups, many);
  EXPECT_TRUE(peer.is_in(20'099));
  EXPECT_FALSE(peer.is_in(20'100));
  EXPECT_EQ(user_name(12'345), "uid 12345");
  EXPECT_EQ(user_name(0), "root");
}

}  // namespace
}  // namespace isorig::daemon::test
