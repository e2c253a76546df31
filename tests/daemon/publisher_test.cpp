#include "daemon/recording/publisher.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sched.h>
#include <spawn.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>
#include <isorig_msgs/frame_batch_t.hpp>
#include <isorig_msgs/progress_t.hpp>
#include <lcm/lcm-cpp.hpp>
#include <sstream>
#include <thread>

#include "recording_rig.hpp"

/// The real LCM over multicast, with its own tools. In a network of our own where that is allowed, so that
/// neither a missing route nor somebody else's LCM traffic matters.
namespace isorig::daemon::testing {
namespace {

constexpr int kNoMulticast = 77;  // what a child exits with when the machine has no multicast at all
constexpr const char* kWithoutMulticast =
    "LCM needs multicast, and neither a network namespace of its own nor this machine's loopback takes it: run it as "
    "root, allow user namespaces (sysctl user.max_user_namespaces), or give the loopback multicast (ip link set lo "
    "multicast on; ip route add 224.0.0.0/4 dev lo)";

bool shell(const std::string& command) {
  return std::system(command.c_str()) == 0;
}

bool write_to(const char* file, const std::string& text) {
  std::ofstream out(file);
  return static_cast<bool>(out << text << std::flush);
}

/// Who is not root is root in a user namespace of his own, which is enough for a network in it.
bool become_root_here() {
  const std::string uid = std::to_string(::geteuid()), gid = std::to_string(::getegid());
  return ::unshare(CLONE_NEWUSER | CLONE_NEWNET) == 0 && write_to("/proc/self/setgroups", "deny") &&
         write_to("/proc/self/uid_map", "0 " + uid + " 1") && write_to("/proc/self/gid_map", "0 " + gid + " 1");
}

void own_network() {
  // Not allowed: the machine's own loopback has to do.
  if (::geteuid() == 0 ? ::unshare(CLONE_NEWNET) != 0 : !become_root_here()) return;
  shell("ip link set lo up multicast on 2>/dev/null");
  shell("ip route add 224.0.0.0/4 dev lo 2>/dev/null");
}

/// Runs `body` in a process of its own, which may leave this network; its exit code is the result.
template <typename Body>
int in_own_network(Body body) {
  const pid_t child = ::fork();
  if (child == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    own_network();
    ::_exit(body());
  }
  int state = 0;
  ::waitpid(child, &state, 0);
  return WIFEXITED(state) ? WEXITSTATUS(state) : -1;
}

pid_t spawn_tool(std::vector<std::string> arguments) {
  std::vector<char*> argv;
  for (auto& a : arguments) argv.push_back(a.data());
  argv.push_back(nullptr);
  pid_t pid = -1;
  posix_spawn_file_actions_t quiet;
  posix_spawn_file_actions_init(&quiet);
  posix_spawn_file_actions_addopen(&quiet, 1, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&quiet, 2, "/dev/null", O_WRONLY, 0);
  if (::posix_spawnp(&pid, argv[0], &quiet, nullptr, argv.data(), environ) != 0) pid = -1;
  posix_spawn_file_actions_destroy(&quiet);
  return pid;
}

void end_tool(pid_t pid) {
  ::kill(pid, SIGTERM);
  ::waitpid(pid, nullptr, 0);
}

struct Received {
  std::vector<std::int64_t> frame_ns;
  std::int64_t missed = 0;
  std::size_t largest = 0;
  std::size_t progress = 0;
  messages::GapCounter gaps;

  void frame(const lcm::ReceiveBuffer* b, const std::string&, const isorig_msgs::frame_batch_t* m) {
    missed += gaps.next(m->number);
    largest = std::max(largest, static_cast<std::size_t>(b->data_size));
    for (std::size_t i = 0; i < static_cast<std::size_t>(m->count); ++i) {
      frame_ns.push_back(m->mono_ns + m->mono_offset_ns[i]);
    }
  }
  void on_progress(const lcm::ReceiveBuffer*, const std::string&, const isorig_msgs::progress_t*) { ++progress; }
};

constexpr const char* kUrl = "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304";

TEST(Publisher, ASubscriberGetsEverySampleInMessagesThatFitOneFrame) {
  const int result = in_own_network([] {
    lcm::LCM lcm(kUrl);
    if (!lcm.good()) return kNoMulticast;
    Received got;
    lcm.subscribe("ISORIG_FRAME", &Received::frame, &got)->setQueueCapacity(0);
    lcm.subscribe("ISORIG_PROGRESS", &Received::on_progress, &got);
    Publisher publisher;
    Streams streams;
    for (std::int64_t i = 0; i < 5'000; ++i) {
      push_ms(streams, i, {5'000, 3, Keep::kAveraged});  // Keep is the recording's: live is always everything
      if (i % 50 != 49) continue;
      publisher.drain(streams, i * kMs);
      while (lcm.handleTimeout(0) > 0) {
      }
    }
    while (lcm.handleTimeout(200) > 0) {
    }
    if (publisher.failed() != 0 || streams.dropped() != 0) return 1;
    if (got.missed != 0 || got.frame_ns.size() != 5'000) return 2;
    for (std::size_t i = 0; i < got.frame_ns.size(); ++i) {
      if (got.frame_ns[i] != frame_record(static_cast<std::int64_t>(i), 3, Keep::kFull).mono_ns) return 3;
    }
    if (got.largest >= messages::kMaxMessageBytes) return 4;
    return got.progress == 10 ? 0 : 5;
  });
  if (result == kNoMulticast) GTEST_SKIP() << kWithoutMulticast;
  EXPECT_EQ(result, 0);
}

TEST(Publisher, ASubscriberWithTheDefaultQueueCountsWhatItMissed) {
  const int result = in_own_network([] {
    lcm::LCM lcm(kUrl);
    if (!lcm.good()) return kNoMulticast;
    Received got;
    lcm.subscribe("ISORIG_FRAME", &Received::frame, &got);  // 30 messages, then LCM drops in silence
    Publisher publisher;
    Streams streams;
    lcm.handleTimeout(100);  // the self-test, before anything is sent
    std::int64_t i = 0;
    const auto burst = [&](std::int64_t samples) {
      for (const auto end = i + samples; i < end; ++i) streams.frame.push(frame_record(i, 0, Keep::kFull));
      publisher.drain(streams, i * kMs);
    };
    burst(30 * 100);  // 100 messages while the subscriber is busy elsewhere
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    while (lcm.handleTimeout(50) > 0) {
    }
    burst(30);
    while (lcm.handleTimeout(200) > 0) {
    }
    const auto messages = static_cast<std::int64_t>(got.frame_ns.size() / 30);
    if (got.missed == 0) return 1;
    return messages + got.missed == 101 ? 0 : 2;
  });
  if (result == kNoMulticast) GTEST_SKIP() << kWithoutMulticast;
  EXPECT_EQ(result, 0);
}

TEST(Publisher, LcmLoggerRecordsItAndLcmLogplayerPlaysASegment) {
  const TemporaryDirectory dir("lcm-tools");
  {
    Streams streams;
    Recorder recorder(recorder_options(dir.path() / "run"), run_info());
    run_plan(recorder, streams, {{2'000, 0, Keep::kFull}}, 20);
    recorder.finish(streams, true);
  }
  const int result = in_own_network([&] {
    lcm::LCM lcm(kUrl);
    if (!lcm.good()) return kNoMulticast;
    const auto log = (dir.path() / "live.lcm").string();
    const pid_t logger = spawn_tool({"lcm-logger", "--lcm-url=" + std::string(kUrl), "--flush-interval=10", log});
    if (logger < 0) return 1;
    Publisher publisher;
    Streams streams;
    // The logger listens when its file has something in it: events are sent until then, a second apart in
    // time.
    std::int64_t i = 0;
    for (int tries = 0; tries < 300 && (!std::filesystem::exists(log) || std::filesystem::file_size(log) == 0);
         ++tries) {
      streams.events.push(event_record(i, 0, "mark", Severity::kInfo));
      publisher.drain(streams, i * kMs);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    for (; i < 2'000; ++i) {
      push_ms(streams, i, {2'000, 1, Keep::kFull});
      if (i % 20 == 19) {
        publisher.drain(streams, i * kMs);
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
      }
    }
    const auto logged = [&] {
      messages::LogReader reader(log);
      int frames = 0;
      while (const auto event = reader.next()) {
        if (event->channel != "ISORIG_FRAME") continue;
        isorig_msgs::frame_batch_t m;
        if (m.decode(event->data.data(), 0, static_cast<int>(event->data.size())) < 0) return -1;
        frames += m.count;
      }
      return frames;
    };
    // Debian 12's logger forgets its buffer when it is ended: later messages push it out, on a busy machine not at
    // once.
    for (int tries = 0; tries < 500 && logged() < 2'000; ++tries) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      streams.events.push(event_record(i, 1, "mark", Severity::kInfo));
      publisher.drain(streams, i * kMs);
    }
    end_tool(logger);
    if (logged() != 2'000) return 3;

    // And the other way round: our segment through LCM's player.
    Received got;
    lcm.subscribe("ISORIG_FRAME", &Received::frame, &got)->setQueueCapacity(0);
    lcm.handleTimeout(100);
    const pid_t player = spawn_tool({"lcm-logplayer", "--speed=4", "--lcm-url=" + std::string(kUrl),
                                     (dir.path() / "run" / "segment-0001.lcm").string()});
    if (player < 0) return 4;
    while (lcm.handleTimeout(3'000) > 0 && got.frame_ns.size() < 2'000) {
    }
    end_tool(player);
    return got.frame_ns.size() == 2'000 && got.missed == 0 ? 0 : 5;
  });
  if (result == kNoMulticast) GTEST_SKIP() << kWithoutMulticast;
  EXPECT_EQ(result, 0);
}

TEST(Publisher, AQueueThatOverflowedIsAnEvent) {
  const int result = in_own_network([] {
    lcm::LCM lcm(kUrl);
    if (!lcm.good()) return kNoMulticast;
    struct Events {
      std::string code;
      double value = 0.0;
      void on(const lcm::ReceiveBuffer*, const std::string&, const isorig_msgs::event_t* m) {
        code = m->code;
        value = m->value;
      }
    } events;
    lcm.subscribe("ISORIG_EVENT", &Events::on, &events);
    Publisher publisher;
    Streams streams(64);
    for (std::int64_t i = 0; i < 100; ++i) streams.frame.push(frame_record(i, 0, Keep::kFull));
    publisher.drain(streams, 0);
    while (lcm.handleTimeout(200) > 0) {
    }
    return events.code == "publisher.dropped" && events.value == 36.0 ? 0 : 1;
  });
  if (result == kNoMulticast) GTEST_SKIP() << kWithoutMulticast;
  EXPECT_EQ(result, 0);
}

/// In this network: is anything bound to LCM's port, as a subscriber is? Group membership tells nothing: LCM's sending
/// socket is in the group too, on a port of its own, and is never read.
bool somebody_listens() {
  std::ifstream sockets("/proc/self/net/udp");
  std::string line, number, local;
  while (std::getline(sockets, line)) {
    if (std::istringstream(line) >> number >> local && local.ends_with(":1DF3")) return true;  // 7667
  }
  return false;
}

/// What this process' datagram sockets let through, at most; -1: there is none.
int longest_way() {
  int most = -1;
  for (int fd = 0; fd < 1024; ++fd) {
    int domain = 0, ttl = 0;
    socklen_t size = sizeof domain;
    if (::getsockopt(fd, SOL_SOCKET, SO_DOMAIN, &domain, &size) != 0 || domain != AF_INET) continue;
    size = sizeof ttl;
    if (::getsockopt(fd, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, &size) == 0) most = std::max(most, ttl);
  }
  return most;
}

TEST(Publisher, ListensToNothingAndStaysOnThisMachineUnlessAsked) {
  const int result = in_own_network([] {
    if (somebody_listens()) return kNoMulticast;  // not a network of our own: somebody else's LCM is in it
    {
      lcm::LCM subscriber(kUrl);
      if (!subscriber.good()) return kNoMulticast;
      Received got;
      subscriber.subscribe("ISORIG_FRAME", &Received::frame, &got);
      if (!somebody_listens()) return 1;  // this is how it would be seen
    }
    if (somebody_listens()) return 2;
    {
      Publisher publisher;
      Streams streams;
      for (std::int64_t i = 0; i < 500; ++i) push_ms(streams, i, {500, 0, Keep::kFull});
      publisher.drain(streams, 500 * kMs);
      if (publisher.published() == 0) return 3;
      if (somebody_listens()) return 4;
      if (longest_way() != 0) return 5;
    }
    const Publisher further("udpm://239.255.76.67:7667?ttl=3");
    return longest_way() == 3 ? 0 : 6;
  });
  if (result == kNoMulticast) GTEST_SKIP() << kWithoutMulticast;
  EXPECT_EQ(result, 0);
}

TEST(Publisher, AUrlThatCannotBeOpenedSaysWhatToDo) {
  EXPECT_THAT([] { Publisher p("nonsense://"); },
              ::testing::ThrowsMessage<std::runtime_error>(::testing::HasSubstr("ip route add")));
}

TEST(PublishWatch, TellsWhenItBeginsAndWhenItIsOverAndNotEachSecond) {
  PublishWatch watch;
  EXPECT_EQ(watch.look(0, 0), "");
  EXPECT_THAT(watch.look(3, ENETUNREACH),
              ::testing::AllOf(::testing::HasSubstr("Network is unreachable"), ::testing::HasSubstr("ip route add")));
  EXPECT_EQ(watch.look(300, ENETUNREACH), "");
  for (int quiet = 1; quiet < PublishWatch::kQuietLooks; ++quiet) EXPECT_EQ(watch.look(300, ENETUNREACH), "");
  EXPECT_EQ(watch.look(301, ENETUNREACH), "") << "not over yet: the same failure, and told";
  for (int quiet = 1; quiet < PublishWatch::kQuietLooks; ++quiet) EXPECT_EQ(watch.look(301, ENETUNREACH), "");
  EXPECT_THAT(watch.look(301, ENETUNREACH), ::testing::HasSubstr("again; 301 were never sent"));
  EXPECT_EQ(watch.look(301, ENETUNREACH), "");
  EXPECT_THAT(watch.look(305, ENOBUFS), ::testing::AllOf(::testing::HasSubstr("No buffer space"),
                                                         ::testing::Not(::testing::HasSubstr("ip route add"))));
  for (int quiet = 1; quiet < PublishWatch::kQuietLooks; ++quiet) EXPECT_EQ(watch.look(305, ENOBUFS), "");
  EXPECT_THAT(watch.look(305, ENOBUFS), ::testing::HasSubstr("again; 4 were never sent"));
}

}  // namespace
}  // namespace isorig::daemon::testing
