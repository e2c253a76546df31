// Writes what a rig publishes to an LCM log, as lcm-logger does, and says what was missed.
//
//   c++ -std=c++17 logger.cpp $(pkg-config --cflags --libs isorig-msgs) -o logger
//   ./logger [--lcm-url URL] FILE          until Ctrl-C; then `isorig export FILE ...` or lcm-logplayer FILE
//
// LCM drops in silence. Every message of a rig begins with its number, which counts its channel's messages from 0: a
// jump is what was missed, a step back of at most 64 is a message that the network delivered late, a larger one is a
// new daemon.
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <isorig_msgs/frame_batch_t.hpp>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <set>
#include <string>

namespace {

volatile std::sig_atomic_t ended = 0;

/// Of one channel.
struct Count {
  static constexpr std::int64_t kMostLate = 64;
  std::int64_t messages = 0, missed = 0;
  std::int64_t newest = -1;     // number; none yet
  std::set<std::int64_t> gaps;  // of the kMostLate before it, those that did not come
  bool zero_came_again = false;

  /// What this message changes `missed` by: how many were skipped before it, -1 for one that comes late.
  std::int64_t next(std::int64_t number) {
    if (number < 0) return 0;  // no rig's
    const bool again = zero_came_again;
    zero_came_again = false;
    if (newest < 0) newest = number;
    if (newest - number > kMostLate) {  // a new daemon, of which the first were missed
      const std::int64_t first_missed = std::max<std::int64_t>(0, number - kMostLate);
      gaps.clear();
      for (std::int64_t n = first_missed; n < number; ++n) gaps.insert(n);
      newest = number;
      return number;
    }
    if (again && 0 < number && number <= newest) {  // a new daemon, before the old one had sent kMostLate
      gaps.clear();
      newest = 0;
    }
    if (number > newest) {
      const std::int64_t skipped = number - newest - 1, oldest = number - kMostLate;
      for (std::int64_t n = std::max(newest + 1, oldest); n < number; ++n) gaps.insert(n);
      gaps.erase(gaps.begin(), gaps.lower_bound(oldest));
      newest = number;
      return skipped;
    }
    if (gaps.erase(number) > 0) return -1;
    zero_came_again = number == 0;  // a daemon's first, or a repeat: the next one tells
    return 0;
  }
};

struct Logger {
  explicit Logger(const std::string& file) : log(file, "w") {}

  void on_message(const lcm::ReceiveBuffer* buffer, const std::string& channel) {
    lcm::LogEvent event{};
    event.eventnum = events++;
    event.timestamp = buffer->recv_utime;
    event.channel = channel;
    event.datalen = static_cast<std::int32_t>(buffer->data_size);
    event.data = const_cast<void*>(buffer->data);  // LCM's interface; it only reads
    written = written && log.writeEvent(&event) == 0;

    // Of any type: 8 bytes say which, then comes `number`.
    const auto* bytes = static_cast<const std::uint8_t*>(buffer->data);
    if (buffer->data_size < 16) return;
    std::uint64_t number = 0;
    for (int i = 8; i < 16; ++i) number = number << 8U | bytes[i];
    auto& count = counts[channel];
    const std::int64_t change = count.next(static_cast<std::int64_t>(number));
    if (change > 0) std::printf("%s: missed %lld\n", channel.c_str(), static_cast<long long>(change));
    ++count.messages;
    count.missed += change;
    // And decoded, as any program that wants the numbers does.
    isorig_msgs::frame_batch_t frame;
    if (channel == "ISORIG_FRAME" && frame.decode(buffer->data, 0, static_cast<int>(buffer->data_size)) >= 0) {
      samples += frame.count;
    }
  }

  lcm::LogFile log;
  std::map<std::string, Count> counts;
  std::int64_t events = 0, samples = 0;
  bool written = true;
};

}  // namespace

int main(int argc, char** argv) {
  std::string url = "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304", file;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--lcm-url") == 0 && i + 1 < argc) {
      url = argv[++i];
    } else if (argv[i][0] != '-' && file.empty()) {
      file = argv[i];
    } else {
      file.clear();
      break;
    }
  }
  if (file.empty()) {
    std::fprintf(stderr, "usage: %s [--lcm-url URL] FILE\n", argv[0]);
    return 2;
  }
  lcm::LCM lcm(url);
  Logger logger(file);
  if (!lcm.good() || !logger.log.good()) {
    std::fprintf(stderr, "%s: no LCM at %s (see docs/lcm-channels.md), or %s cannot be written\n", argv[0], url.c_str(),
                 file.c_str());
    return 1;
  }
  // Without a limit of its own: LCM's 30 messages are 0.3 s of a channel.
  lcm.subscribe("ISORIG_.*", &Logger::on_message, &logger)->setQueueCapacity(0);
  std::signal(SIGINT, [](int) { ended = 1; });
  std::signal(SIGTERM, [](int) { ended = 1; });
  std::printf("listening\n");
  std::fflush(stdout);
  while (ended == 0 && logger.written) {
    // Ctrl-C interrupts the wait, which is no fault.
    if (lcm.handleTimeout(100) < 0 && ended == 0) return 1;
  }
  for (const auto& [channel, count] : logger.counts) {
    std::printf("%s: %lld messages, %lld missed\n", channel.c_str(), static_cast<long long>(count.messages),
                static_cast<long long>(count.missed));
  }
  std::printf("%lld frame samples\n", static_cast<long long>(logger.samples));
  if (!logger.written) std::fprintf(stderr, "%s: %s cannot be written: is the disk full?\n", argv[0], file.c_str());
  return logger.written ? 0 : 1;
}
