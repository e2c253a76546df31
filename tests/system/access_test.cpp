// isorigd and isorig as several users of one machine: who may do what, who has control, what is written down, what who
// may only read can see, and that nothing is heard from the network.
#include <dirent.h>
#include <gmock/gmock.h>
#include <grp.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/stat.h>

#include <cstdlib>
#include <map>
#include <set>

#include "../daemon/as_user.hpp"
#include "processes.hpp"

namespace isorig::system_test {
namespace {

using daemon::test::kNeedsRoot;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr uid_t kAnn = 21'001, kBob = 21'002, kNobody = 65'534;

/// A run that does not end by itself, and moves nothing.
constexpr const char* kLongProtocol = R"(format = "isorig-protocol/1"
name = "long"
steps = [
  { do = "pressurize", pressure_psi = 0, rate_psi_s = 5, settled_for_s = 0.01, timeout_s = 20 },
  { do = "hold", duration_s = 1000 } ]
)";

gid_t group(const char* name) {
  const auto* entry = ::getgrnam(name);  // of every Debian: base-passwd
  return entry == nullptr ? static_cast<gid_t>(-1) : entry->gr_gid;
}

class AccessTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (::geteuid() != 0) GTEST_SKIP() << kNeedsRoot;
    ::chmod(dir_.path().c_str(), 0755);
    // The build tree may lie where no other user may look.
    std::filesystem::copy_file(bin("isorig"), program_);
    spit(protocol_, kLongProtocol);
    ::chmod(protocol_.c_str(), 0644);
  }

  /// `isorig` of that user; `groups`: the first is the main one.
  Answer as(uid_t uid, const std::vector<gid_t>& groups, std::vector<std::string> words) {
    words.insert(words.begin(), program_.string());
    const auto log = dir_ / ("as-" + std::to_string(++calls_) + ".txt");
    Process process(std::move(words), log, [&] {
      if (::setgroups(groups.size(), groups.data()) != 0 || ::setgid(groups.front()) != 0 || ::setuid(uid) != 0)
        ::_exit(125);
    });
    const int code = process.wait(60.0);
    return {code, process.output()};
  }

  TempDir dir_;
  std::filesystem::path program_ = dir_ / "isorig", protocol_ = dir_ / "long.toml";
  int calls_ = 0;
};

TEST_F(AccessTest, GroupsOperateOneAtATimeAndEveryCommandIsWrittenDownOverRestarts) {
  // The socket's group is the daemon's: games for all who come in, users for who operates, adm for who configures.
  const auto rig = patient_rig(dir_, "[api]\noperate = \"users\"\nconfigure = \"adm\"\n");
  const std::vector<gid_t> looks{group("games")}, operates{group("games"), group("users")};
  const auto serve = [&] {
    return std::make_unique<DaemonProcess>(dir_, rig, [&] {
      if (::setgid(group("games")) != 0) ::_exit(125);
    });
  };
  auto daemon = serve();
  ASSERT_TRUE(daemon->reach("ready")) << daemon->log();
  const std::vector<std::string> there{"--socket", daemon->socket()};
  const auto words = [&](std::vector<std::string> verb) {
    verb.insert(verb.end(), there.begin(), there.end());
    return verb;
  };
  EXPECT_EQ(as(kNobody, {kNobody}, words({"status"})).code, 4) << "the socket is not his to open";
  EXPECT_EQ(as(kAnn, looks, words({"status"})).code, 0);
  const auto refused = as(kAnn, looks, words({"start", protocol_.string()}));
  EXPECT_EQ(refused.code, 5);
  EXPECT_THAT(refused.text, AllOf(HasSubstr("uid 21001 may not operate this rig; who may: members of the group users"),
                                  HasSubstr("usermod -aG users NAME")));
  EXPECT_THAT(as(kAnn, looks, words({"control"})).text, HasSubstr("nobody has control"));
  const auto started = as(kBob, operates, words({"start", protocol_.string()}));
  ASSERT_EQ(started.code, 0) << started.text;
  EXPECT_THAT(as(kAnn, looks, words({"control"})).text, HasSubstr("uid 21002 at a terminal since 20"));
  EXPECT_THAT(as(kAnn, looks, words({"status"})).text, HasSubstr("control   uid 21002 at a terminal"));
  EXPECT_EQ(as(kAnn, looks, words({"pause"})).code, 0) << "who may come in may stop";
  const auto other = as(kAnn, operates, words({"resume"}));
  EXPECT_EQ(other.code, 5);
  EXPECT_THAT(other.text, AllOf(HasSubstr("uid 21002 has control"), HasSubstr("isorig control --take-over")));
  EXPECT_EQ(as(kAnn, operates, words({"control", "--take"})).code, 5);
  EXPECT_THAT(as(kAnn, operates, words({"control", "--take-over"})).text, HasSubstr("taken over from uid 21002"));
  EXPECT_EQ(as(kAnn, operates, words({"resume"})).code, 0);
  EXPECT_EQ(as(kAnn, looks, words({"abort"})).code, 0);
  EXPECT_EQ(as(kAnn, operates, words({"control", "--give-back"})).code, 0);
  EXPECT_EQ(daemon->process().stop(), 0);

  const auto log = [&] { return isorig(dir_, {"audit", "--all", "--json", "--runs", daemon->runs()}).json(); };
  const auto before = log();
  std::vector<std::string> told;
  for (const auto& line : before) told.push_back(line.value("verb", "") + std::to_string(line.value("status", 0)));
  EXPECT_THAT(told, testing::ElementsAre("start403", "start200", "pause200", "resume409", "control409", "control200",
                                         "resume200", "abort200", "control200"));
  EXPECT_EQ(before[1]["uid"], kBob);
  EXPECT_EQ(before[1]["gid"], group("games"));
  EXPECT_THAT(before[1]["groups"], testing::Contains(group("users")));
  EXPECT_THAT(before[1].value("arguments", ""), HasSubstr("protocol_name=" + protocol_.string()));

  daemon = serve();
  ASSERT_TRUE(daemon->reach("ready")) << daemon->log();
  EXPECT_EQ(daemon->call({"abort"}).code, 0);
  ASSERT_TRUE(wait_until(10.0, [&] { return log().size() == before.size() + 1; }));
  const auto after = log();
  for (std::size_t i = 0; i < before.size(); ++i) EXPECT_EQ(after[i], before[i]);
  EXPECT_EQ(after.back()["user"], "root");
  EXPECT_EQ(after.back()["number"], before.size() + 1);
  EXPECT_THAT(
      isorig(dir_, {"audit", "--last", "2", "--runs", daemon->runs()}).text,
      AllOf(HasSubstr("root  abort"), HasSubstr("uid 21001  control action=give-back"), Not(HasSubstr("start"))));
}

TEST_F(AccessTest, AGroupThatThisMachineDoesNotHaveKeepsTheDaemonFromStarting) {
  DaemonProcess daemon(dir_, patient_rig(dir_, "[api]\noperate = \"no-such-group\"\n"));
  EXPECT_EQ(daemon.process().wait(30.0), 3);
  EXPECT_THAT(daemon.log(), AllOf(HasSubstr("rig.toml"), HasSubstr("no-such-group"), HasSubstr("groupadd")));
}

/// While a daemon writes, after it has gone, and when it was killed with its last words in the write-ahead log.
TEST_F(AccessTest, WhoMayOnlyReadListsAndShowsRuns) {
  const auto runs = (dir_ / "runs").string();
  std::string id;
  const auto looks_well = [&](const std::string& state, const std::string& when) {
    const auto list = as(kNobody, {kNobody}, {"runs", "--runs", runs});
    EXPECT_EQ(list.code, 0) << when << ": " << list.text;
    EXPECT_THAT(list.text, AllOf(HasSubstr(id), HasSubstr(state))) << when;
    const auto shown = as(kNobody, {kNobody}, {"show", id, "--runs", runs});
    // 7: data are missing, as of a run that was killed.
    EXPECT_TRUE(shown.code == 0 || shown.code == 7) << when << ": " << shown.text;
    EXPECT_THAT(shown.text, HasSubstr(id)) << when;
  };
  const auto everything = [&] {
    std::map<std::string, std::string> out;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(runs)) {
      // Readers lock the shared memory file where they may write, which is not here; its bytes are the daemon's.
      if (entry.is_regular_file()) out[entry.path().string()] = slurp(entry.path());
    }
    return out;
  };
  {
    DaemonProcess daemon(dir_, patient_rig(dir_));
    ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
    id = started_run(daemon.call({"start", protocol_.string()}));
    ASSERT_TRUE(daemon.reach("running"));
    ASSERT_TRUE(std::filesystem::exists(runs + "/catalogue.sqlite-wal"));
    looks_well("running", "while it is recorded");
    EXPECT_EQ(daemon.process().stop(SIGKILL), -SIGKILL);
  }
  const auto killed = everything();
  looks_well("interrupted", "when the daemon was killed");
  std::filesystem::remove(runs + "/catalogue.sqlite-shm");
  looks_well("interrupted", "after a restart of the machine");
  for (const auto& [file, bytes] : everything())
    EXPECT_EQ(killed.at(file), bytes) << file << " was written by a reader";
  {
    DaemonProcess daemon(dir_, patient_rig(dir_));
    ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
    EXPECT_EQ(daemon.process().stop(), 0);
  }
  looks_well("interrupted", "after an orderly end");
  // Who may not even read is told so.
  ::chmod(runs.c_str(), 0700);
  const auto refused = as(kNobody, {kNobody}, {"runs", "--runs", runs});
  EXPECT_NE(refused.code, 0);
  EXPECT_THAT(refused.text, Not(HasSubstr(id)));
  const auto audit = as(kNobody, {kNobody}, {"audit", "--runs", runs});
  EXPECT_NE(audit.code, 0);
}

/// The inodes of a process' sockets.
std::set<std::string> sockets_of(pid_t pid) {
  std::set<std::string> out;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/" + std::to_string(pid) + "/fd", error)) {
    const auto target = std::filesystem::read_symlink(entry.path(), error).string();
    if (target.starts_with("socket:[")) out.insert(target.substr(8, target.size() - 9));
  }
  return out;
}

/// Of a line of /proc/net/udp and tcp: local port in hexadecimal, and inode.
std::map<std::string, std::string> ports_by_inode(pid_t pid, const char* table) {
  std::map<std::string, std::string> out;
  std::istringstream lines(slurp("/proc/" + std::to_string(pid) + "/net/" + table));
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line)) {
    std::istringstream words(line);
    std::vector<std::string> all;
    for (std::string word; words >> word;) all.push_back(word);
    if (all.size() > 9) out[all[9]] = all[1].substr(all[1].find(':') + 1) + (all[3] == "0A" ? " listens" : "");
  }
  return out;
}

TEST_F(AccessTest, TheDaemonListensToNoNetworkAndHearsNoLcm) {
  const auto rig = patient_rig(dir_);
  spit(rig, replaced(slurp(rig), "[lcm]\nenabled = false", "[lcm]\nenabled = true"));
  // A network of its own, where that is allowed: a machine without a route for multicast has none otherwise.
  DaemonProcess daemon(dir_, rig, [] {
    if (::unshare(CLONE_NEWNET) != 0) return;
    (void)!std::system("ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo");
  });
  const bool up = daemon.reach("ready");
  if (daemon.log().find("LCM cannot open") != std::string::npos)
    GTEST_SKIP() << "no multicast, and no network namespace is allowed: allow them (unshare -n), or add the route";
  ASSERT_TRUE(up) << daemon.log();
  const auto pid = daemon.process().pid();
  const auto own = sockets_of(pid);
  ASSERT_FALSE(own.empty());
  std::size_t datagram = 0;
  for (const auto* table : {"udp", "udp6", "tcp", "tcp6"}) {
    for (const auto& [inode, port] : ports_by_inode(pid, table)) {
      if (!own.contains(inode)) continue;
      if (std::string(table).starts_with("udp")) ++datagram;
      EXPECT_NE(port, "1DF3") << table << ": bound to LCM's port 7667, as who subscribes is";
      EXPECT_THAT(port, Not(HasSubstr("listens"))) << table;
    }
  }
  EXPECT_GT(datagram, 0U) << "it publishes, and its socket was not found: nothing was looked at";
}

}  // namespace
}  // namespace isorig::system_test
