// isorigd in real time on the virtual rig in its process, as an operator meets it: verbs, errors, kills, rights, disks.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <cerrno>
#include <cstring>
#include <set>

#include "daemon/recording/catalogue.hpp"
#include "last_state.hpp"
#include "messages/recording.hpp"
#include "messages/run_log.hpp"
#include "processes.hpp"

namespace isorig::system_test {
namespace {

using testing::AnyOf;
using testing::HasSubstr;

const std::string kSmoke = source("config/protocols/vma-smoke.toml");

/// When the last recorded sample was, and whether all could be read.
struct LastSample : messages::RunVisitor {
  void frame(const isorig_msgs::frame_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) {
      mono_ns = std::max(mono_ns, m.mono_ns + m.mono_offset_ns[i]);
    }
  }
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override {
    for (std::size_t i = 0; i < static_cast<std::size_t>(m.count); ++i) mono_ns = std::max(mono_ns, m.last_mono_ns[i]);
  }
  void event(const isorig_msgs::event_t& m) override { codes.insert(m.code); }
  std::int64_t mono_ns = 0;
  std::set<std::string> codes;
};

std::int64_t monotonic_ns() {
  timespec t{};
  ::clock_gettime(CLOCK_MONOTONIC, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

TEST(Daemon, KilledInTheSecondRepetitionItResumesFromItsStart) {
  const TempDir dir;
  const auto rig = patient_rig(dir);
  std::string id;
  std::int64_t killed_ns = 0;
  {
    DaemonProcess daemon(dir, rig);
    ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
    id = started_run(daemon.call({"start", kSmoke}));
    ASSERT_TRUE(wait_until(90.0, [&] {
      const auto s = daemon.status();
      return s.contains("run") && s["run"]["session"] == 1 && s.value("pressure_psi", 0.0) > 4.0;
    })) << daemon.log();
    std::this_thread::sleep_for(std::chrono::seconds(2));
    killed_ns = monotonic_ns();
    EXPECT_EQ(daemon.process().stop(SIGKILL), -SIGKILL);

    const auto rows = daemon.catalogue();
    ASSERT_EQ(rows.size(), 1U);
    EXPECT_EQ(rows[0]["state"], "interrupted");
    EXPECT_EQ(rows[0]["sessions_done"], 1);
    const auto listed = isorig(dir, {"runs", "--runs", daemon.runs()});
    EXPECT_THAT(listed.text, HasSubstr("interrupted"));
  }
  // At most the sync interval (1 s), the recorder's lag (0.35 s) and its look-back (2.5 s) are lost, and what the
  // machine may stand still.
  LastSample last;
  (void)messages::read_run(dir / "runs" / id, last);
  const double lost_s = static_cast<double>(killed_ns - last.mono_ns) * 1e-9;
  std::printf("  lost by SIGKILL: %.2f s\n", lost_s);
  EXPECT_GT(lost_s, -0.5);
  EXPECT_LT(lost_s, 1.0 + 0.35 + 2.5 + 2.0);

  DaemonProcess daemon(dir, rig);  // the socket file of the killed one is in its way
  ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
  const auto resumed = daemon.call({"resume", id});
  ASSERT_EQ(resumed.code, 0) << resumed.text;
  EXPECT_TRUE(wait_until(10.0, [&] {
    const auto s = daemon.status();
    return s.contains("run") && s["run"]["id"] == id && s["run"]["session"] == 1;
  }));
  EXPECT_EQ(daemon.call({"watch", "--until-done"}, 120.0).code, 0);

  const auto rows = daemon.catalogue();
  ASSERT_EQ(rows.size(), 1U);
  EXPECT_EQ(rows[0]["state"], "done");
  EXPECT_EQ(rows[0]["sessions_done"], 2);
  EXPECT_EQ(rows[0]["attempts"], 2);
  // The daemon has the page written: first of what was interrupted, now of what is done.
  const auto page = dir / "runs" / id / "report.html";
  EXPECT_TRUE(wait_until(120.0, [&] { return slurp(page).find("\"word\":\"done\"") != std::string::npos; }))
      << daemon.log();
  EXPECT_THAT(slurp(page), HasSubstr("isorig report "));
  const auto exported = isorig(dir, {"export", id, "--runs", daemon.runs(), "--out", (dir / "out").string()});
  EXPECT_THAT(exported.code, AnyOf(0, 7)) << exported.text;  // 7: the torn end of the first attempt is named
  for (const auto* folder : {"rep-1_5-psi", "rep-2_5-psi"}) {
    const auto recording = messages::read_recording(dir / "out" / folder);
    EXPECT_THAT(recording.metadata.further_toml, HasSubstr("complete = true")) << folder;
    EXPECT_GT(recording.frame.t_s.back(), 15.0) << folder;
  }
  EXPECT_EQ(daemon.process().stop(SIGTERM), 0) << daemon.log();
}

TEST(Daemon, VerbsAndErrorsOverTheSocket) {
  const TempDir dir;
  // Nobody there.
  const auto nobody = isorig(dir, {"status", "--socket", (dir / "isorigd.sock").string()});
  EXPECT_EQ(nobody.code, 4);
  EXPECT_THAT(nobody.text, HasSubstr("isorigd --rig"));

  const auto rig = patient_rig(dir, "[api]\nmode = \"0600\"\n");
  // What a killed daemon leaves is a socket that nobody answers on.
  const int dead = ::socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strcpy(address.sun_path, (dir / "isorigd.sock").c_str());
  ASSERT_EQ(::bind(dead, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ::close(dead);
  DaemonProcess daemon(dir, rig);
  ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
  struct stat info {};
  ASSERT_EQ(::stat(daemon.socket().c_str(), &info), 0);
  EXPECT_TRUE(S_ISSOCK(info.st_mode));
  EXPECT_EQ(info.st_mode & 0777U, 0600U);

  // A second one on the same socket does not start, and does not disturb the first.
  const auto second = run(dir, {bin("isorigd"), "--no-realtime", "--rig", rig.string(), "--runs",
                                (dir / "runs2").string(), "--socket", daemon.socket()});
  EXPECT_EQ(second.code, 1);
  EXPECT_THAT(second.text, HasSubstr("another daemon answers"));
  EXPECT_EQ(daemon.state(), "ready");

  // A wrong protocol: every error with its place, nothing started.
  spit(dir / "wrong.toml",
       "format = \"isorig-protocol/1\"\nname = \"wrong\"\nsteps = [\n"
       "  { do = \"ramp\", to_mm = 40, velocity_mm_s = 1 },\n"
       "  { do = \"hold\", duration_min = 3 },\n]\n");
  const auto wrong = daemon.call({"start", (dir / "wrong.toml").string()});
  EXPECT_EQ(wrong.code, 3);
  EXPECT_THAT(wrong.text, HasSubstr("wrong.toml:4:"));
  EXPECT_THAT(wrong.text, HasSubstr("wrong.toml:5:"));
  EXPECT_EQ(daemon.call({"start", (dir / "none.toml").string()}).code, 3);
  EXPECT_EQ(daemon.catalogue().size(), 0U);

  // Verbs that the state forbids say so.
  for (const auto* verb : {"pause", "resume", "reset"}) {
    const auto refused = daemon.call({verb});
    EXPECT_EQ(refused.code, 5) << verb << ": " << refused.text;
    EXPECT_FALSE(refused.text.empty());
  }
  const auto unknown = daemon.call({"resume", "no-such-run"});
  EXPECT_EQ(unknown.code, 5) << unknown.text;

  const auto id = started_run(daemon.call({"start", kSmoke, "--operator", "somebody"}));
  EXPECT_EQ(daemon.state(), "running");
  const auto again = daemon.call({"start", kSmoke});
  EXPECT_EQ(again.code, 5) << again.text;
  EXPECT_THAT(again.text, HasSubstr("running"));
  EXPECT_EQ(daemon.call({"resume", id}).code, 5);

  ASSERT_TRUE(wait_until(30.0, [&] { return daemon.status().value("pressure_psi", 0.0) > 4.8; }));
  EXPECT_EQ(daemon.call({"pause"}).code, 0);
  EXPECT_TRUE(daemon.reach("paused", 5.0));
  const auto paused = daemon.status();
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  const auto still = daemon.status();
  EXPECT_EQ(still["progress"], paused["progress"]);
  EXPECT_NEAR(still["pressure_psi"].get<double>(), 5.0, 0.3);
  EXPECT_EQ(daemon.call({"resume"}).code, 0);
  EXPECT_TRUE(daemon.reach("running", 5.0));

  EXPECT_EQ(daemon.call({"abort"}).code, 0);
  EXPECT_TRUE(wait_until(30.0, [&] { return !daemon.status().contains("run"); }));
  EXPECT_TRUE(daemon.reach("ready", 30.0));
  EXPECT_LT(daemon.status().value("pressure_psi", 99.0), 0.6);
  const auto rows = daemon.catalogue();
  ASSERT_EQ(rows.size(), 1U);
  EXPECT_EQ(rows[0]["state"], "aborted");
  EXPECT_EQ(rows[0]["operator"], "somebody");

  EXPECT_EQ(daemon.process().stop(SIGTERM), 0);
  EXPECT_FALSE(std::filesystem::exists(daemon.socket()));
}

TEST(Daemon, TerminatedWhileRunningItVentsAndClosesTheRun) {
  const TempDir dir;
  DaemonProcess daemon(dir, patient_rig(dir));
  ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
  const auto id = started_run(daemon.call({"start", kSmoke}));
  ASSERT_TRUE(wait_until(30.0, [&] { return daemon.status().value("pressure_psi", 0.0) > 4.0; }));
  EXPECT_EQ(daemon.process().stop(SIGTERM), 0) << daemon.log();

  const daemon::Catalogue catalogue(daemon.runs(), daemon::Catalogue::Access::kReadOnly);
  const auto row = catalogue.find_run(id);
  ASSERT_TRUE(row);
  EXPECT_EQ(row->state, "aborted");
  LastState last;
  const auto report = messages::read_run(row->directory, last);
  EXPECT_TRUE(report.whole()) << testing::PrintToString(report.complaints());
  EXPECT_GT(last.peak_psi(), 3.5);
  EXPECT_LT(last.last_psi(), 0.6);
}

/// For a child: another user, without the capabilities that give real-time rights.
std::vector<std::string> without_rights(std::vector<std::string> words) {
  std::vector<std::string> all;
  if (::geteuid() == 0) {
    all = {"setpriv", "--reuid",    "65534", "--regid", "65534",   "--clear-groups", "--bounding-set",
           "-all",    "--inh-caps", "-all",  "--",      "prlimit", "--rtprio=0",     "--"};
  } else {
    all = {"prlimit", "--rtprio=0", "--"};
  }
  all.insert(all.end(), words.begin(), words.end());
  return all;
}

TEST(Daemon, WithoutRealTimeRightsItRefusesAndSaysWhatToGrant) {
  const TempDir dir;
  std::filesystem::permissions(dir.path(), std::filesystem::perms::all);
  const auto rig = patient_rig(dir);
  const auto readable = run(dir, without_rights({"test", "-r", rig.string(), "-a", "-x", bin("isorigd")}));
  const auto has_rights = run(dir, without_rights({"chrt", "-f", "10", "true"}));
  if (readable.code != 0 || has_rights.code == 0) {
    GTEST_SKIP() << "this machine gives no way to drop rights: another user sees the build (" << readable.code
                 << "), real-time priority is refused (" << has_rights.code << "): " << has_rights.text;
  }
  const auto socket = (dir / "s.sock").string();
  const auto words = [&](const std::string& flag) {
    std::vector<std::string> w{bin("isorigd"),          "--rig",    rig.string(), "--runs",
                               (dir / "runs").string(), "--socket", socket};
    if (!flag.empty()) w.push_back(flag);
    return without_rights(w);
  };
  const auto refused = run(dir, words(""));
  EXPECT_EQ(refused.code, 8) << refused.text;
  EXPECT_THAT(refused.text, HasSubstr("--no-realtime"));
  EXPECT_THAT(refused.text, AnyOf(HasSubstr("LimitRTPRIO"), HasSubstr("LimitMEMLOCK")));

  Process allowed(words("--no-realtime"), dir / "allowed.log");
  EXPECT_TRUE(wait_until(30.0, [&] {
    return isorig(dir, {"status", "--socket", socket}).code == 0;
  })) << allowed.output();
  EXPECT_EQ(allowed.stop(SIGTERM), 0) << allowed.output();
}

TEST(Daemon, SaysWhereTheKernelMayMoveItsPages) {
  const TempDir dir;
  if (const auto has_rights = run(dir, {"chrt", "-f", "90", "true"}); has_rights.code != 0)
    GTEST_SKIP() << "this machine grants no real-time priority: " << has_rights.text;
  Process daemon({bin("isorigd"), "--rig", patient_rig(dir).string(), "--runs", (dir / "runs").string(), "--socket",
                  (dir / "s.sock").string()},
                 dir / "isorigd.log");
  ASSERT_TRUE(wait_until(30.0, [&] {
    return isorig(dir, {"status", "--socket", (dir / "s.sock").string()}).code == 0;
  })) << daemon.output();
  EXPECT_EQ(daemon.stop(SIGTERM), 0) << daemon.output();
  const auto setting = slurp("/proc/sys/vm/compact_unevictable_allowed");
  EXPECT_EQ(daemon.output().find("vm.compact_unevictable_allowed is 1") != std::string::npos, setting.starts_with("1"))
      << setting << daemon.output();
}

TEST(Daemon, AFullDiskStopsTheRunBeforeDataIsLost) {
  const TempDir dir;
  const auto runs = dir / "runs";
  std::filesystem::create_directories(runs);
  if (::mount("tmpfs", runs.c_str(), "tmpfs", 0, "size=24m") != 0) {
    GTEST_SKIP() << "mounting a small disk needs root: " << std::strerror(errno);
  }
  struct Unmount {
    std::string path;
    ~Unmount() { ::umount2(path.c_str(), MNT_DETACH); }
  } unmount{runs.string()};

  DaemonProcess daemon(dir, patient_rig(dir, "[recorder]\nmin_free_MiB = 8\nreserve_MiB = 4\n"));
  ASSERT_TRUE(daemon.reach("ready")) << daemon.log();
  const auto id = started_run(daemon.call({"start", kSmoke}));
  ASSERT_TRUE(wait_until(20.0, [&] { return daemon.status().value("pressure_psi", 0.0) > 2.0; }));
  // Somebody else fills the disk: what is left is below what the recorder wants free.
  {
    std::ofstream hog(runs / "hog", std::ios::binary);
    const std::string block(1 << 20, 'x');
    while (hog.write(block.data(), static_cast<std::streamsize>(block.size())).flush()) {
    }
  }
  ASSERT_TRUE(daemon.reach("faulted", 20.0)) << daemon.status().dump(2);
  const auto faulted = daemon.status();
  EXPECT_THAT(faulted.value("fault", ""), HasSubstr("recorder")) << faulted.dump(2);
  ASSERT_TRUE(faulted.contains("recorder")) << faulted.dump(2);
  EXPECT_EQ(faulted["recorder"]["lost_messages"], 0);
  EXPECT_EQ(faulted["recorder"]["dropped_records"], 0);
  const auto position_mm = faulted.value("position_mm", 0.0);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_NEAR(daemon.status().value("position_mm", 99.0), position_mm, 0.01);  // stopped, held

  EXPECT_EQ(daemon.call({"abort"}).code, 0);
  EXPECT_TRUE(wait_until(30.0, [&] { return !daemon.status().contains("run"); }));
  LastSample last;
  const auto report = messages::read_run(runs / id, last);
  EXPECT_TRUE(report.whole()) << testing::PrintToString(report.complaints());
  EXPECT_EQ(last.codes.count("recorder"), 1U);
  // With room again the next protocol starts, without a new daemon.
  std::filesystem::remove(runs / "hog");
  EXPECT_TRUE(daemon.reach("ready", 20.0));
  EXPECT_EQ(daemon.call({"start", kSmoke}).code, 0);
  EXPECT_EQ(daemon.status().value("fault", "-"), "");
  EXPECT_EQ(daemon.call({"abort"}).code, 0);
  EXPECT_EQ(daemon.process().stop(SIGTERM), 0);
}

}  // namespace
}  // namespace isorig::system_test
