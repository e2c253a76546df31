// A day of samples through the daemon's sample server and isorig-web to pages on real WebSockets, in virtual time: what
// is kept does not grow, what is lost is counted, and the history is the truth. Four hours; all 24 take some minutes:
// ISORIG_STREAM_HOURS=24 build/bin/day_of_streaming_test
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <thread>

#include "daemon/host/paths.hpp"
#include "daemon/host/sample_server.hpp"
#include "daemon/recording/sample_stream.hpp"
#include "processes.hpp"

namespace isorig::system_test {
namespace {

namespace net = boost::asio;
namespace websocket = boost::beast::websocket;
using nlohmann::json;

constexpr std::int64_t kMs = 1'000'000, kFine_ns = 20 * kMs, kCoarse_ns = 5000 * kMs;
constexpr std::int64_t kBegin_ns = 1000 * kCoarse_ns;
/// What is sent at once at first, to nobody's pace: 300 s, of which a queue of 2 MiB holds some 25.
constexpr std::int64_t kBurst = 300'000;

/// Samples whose sums are exact in single precision: whole numbers below 10007, which no period of a stretch divides.
double force_N(std::int64_t i) {
  return static_cast<double>((i * 7919) % 10007);
}
double pressure_psi(std::int64_t i) {
  return static_cast<double>((i * 104'729) % 9973);
}

struct Truth {
  float low = 0.0F, high = 0.0F, mean = 0.0F;
};
/// Of the samples from `first` on, `count` of them.
Truth truth(double (*value)(std::int64_t), std::int64_t first, std::int64_t count) {
  double low = 1e9, high = -1e9, sum = 0.0;
  for (std::int64_t i = first; i < first + count; ++i) {
    low = std::min(low, value(i));
    high = std::max(high, value(i));
    sum += value(i);
  }
  return {static_cast<float>(low), static_cast<float>(high), static_cast<float>(sum / static_cast<double>(count))};
}

/// A block as docs/web.md has it.
struct Block {
  std::uint8_t stream = 0, tier = 0;
  std::int64_t first = 0;
  std::vector<std::uint32_t> index;
  std::vector<std::vector<float>> column;  ///< low, high, mean of each channel
};
Block parsed(const std::string& bytes) {
  Block out;
  std::size_t at = 0;
  const auto take = [&](auto& value) {
    std::memcpy(&value, bytes.data() + at, sizeof value);
    at += sizeof value;
  };
  std::uint16_t columns = 0;
  std::uint32_t count = 0;
  double first = 0.0, width_ns = 0.0;
  take(out.stream), take(out.tier), take(columns), take(count), take(first), take(width_ns);
  out.first = static_cast<std::int64_t>(first);
  out.index.resize(count);
  for (auto& index : out.index) take(index);
  out.column.assign(columns, std::vector<float>(count));
  for (auto& column : out.column)
    for (auto& value : column) take(value);
  EXPECT_EQ(at, bytes.size());
  return out;
}

/// A page: one WebSocket over the loopback, read by whoever calls next().
class Page {
 public:
  explicit Page(unsigned short port, int receive_buffer = 0) : socket_(io_) {
    auto& tcp = socket_.next_layer();
    tcp.open(net::ip::tcp::v4());
    if (receive_buffer > 0) tcp.set_option(net::socket_base::receive_buffer_size(receive_buffer));
    tcp.connect({net::ip::address_v4::loopback(), port});
    const std::string host = "localhost:" + std::to_string(port);
    socket_.set_option(websocket::stream_base::decorator(
        [host](websocket::request_type& request) { request.set("Origin", "http://" + host); }));
    socket_.read_message_max(std::size_t{64} << 20U);
    socket_.handshake(host, "/live");
  }
  /// False when the server has ended it.
  bool next() {
    buffer_.clear();
    boost::system::error_code error;
    socket_.read(buffer_, error);
    if (error) return false;
    text = boost::beast::buffers_to_string(buffer_.data());
    binary = socket_.got_binary();
    if (binary) return true;
    const auto message = json::parse(text);
    const auto kind = message.value("kind", "");
    if (kind == "left-out") left_out = message["messages"].get<std::uint64_t>();
    if (kind == "status") web = message["web"];
    return true;
  }
  /// What goes to all pages, unless it is counted as left out: of a status the newest alone is sent.
  [[nodiscard]] bool to_all() const { return binary; }

  std::string text;
  bool binary = false;
  std::uint64_t left_out = 0;
  json web;

 private:
  net::io_context io_;
  websocket::stream<net::ip::tcp::socket> socket_;
  boost::beast::flat_buffer buffer_;
};

/// Index of the newest stretch of 20 ms of the frame in a live block; nothing for other messages.
std::optional<std::int64_t> newest_of_frame(const std::string& bytes) {
  if (bytes.size() < 2 || bytes[0] != 0 || bytes[1] != 0) return std::nullopt;
  const auto block = parsed(bytes);
  return block.first + block.index.back();
}

/// Subscribes to the daemon's samples and stands still until count().
class Witness {
 public:
  explicit Witness(const std::filesystem::path& path) : fd_(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const timeval patience{1, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
    if (::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) ADD_FAILURE() << path;
    // It gets, or is told of, what comes after it was taken in: a busy machine's thread may need a while for that.
    char bytes[4096];
    daemon::samples::Record record;
    const auto greeted = [&] {
      const auto n = ::read(fd_, bytes, sizeof bytes);
      if (n > 0) reader_.feed({bytes, static_cast<std::size_t>(n)});
      return reader_.next(record) && std::holds_alternative<daemon::samples::Hello>(record);
    };
    if (!wait_until(60, greeted)) ADD_FAILURE() << "not taken in";
  }
  ~Witness() { ::close(fd_); }
  Witness(const Witness&) = delete;
  Witness& operator=(const Witness&) = delete;

  /// Reads until a frame sample of this time: true, or until nothing comes for a second.
  bool read_to(std::int64_t mono_ns) {
    char bytes[65'536];
    for (bool there = false; !there;) {
      const auto n = ::read(fd_, bytes, sizeof bytes);
      if (n <= 0) return false;
      reader_.feed({bytes, static_cast<std::size_t>(n)});
      daemon::samples::Record record;
      while (reader_.next(record)) {
        if (const auto* sample = std::get_if<daemon::FrameRecord>(&record)) {
          ++frame;
          there = there || sample->mono_ns >= mono_ns;
        }
        pressure += std::holds_alternative<daemon::PressureRecord>(record) ? 1 : 0;
        control += std::holds_alternative<daemon::ControlRecord>(record) ? 1 : 0;
        if (const auto* told = std::get_if<daemon::samples::Lost>(&record)) lost = *told;
      }
    }
    return true;
  }
  std::uint64_t frame = 0, pressure = 0, control = 0;
  daemon::samples::Lost lost;

 private:
  int fd_;
  daemon::samples::Reader reader_;
};

/// Memory and descriptors of a process, by /proc. Of the descriptors the least of a second: those of the calls to a
/// control socket that is not there come and go.
struct Footprint {
  double MiB = 0.0;
  std::ptrdiff_t descriptors = 0;
};
Footprint footprint(pid_t pid) {
  const auto proc = std::filesystem::path("/proc") / std::to_string(pid);
  std::istringstream statm(slurp(proc / "statm"));
  double size = 0.0, resident = 0.0;
  statm >> size >> resident;
  Footprint out{resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1048576.0, PTRDIFF_MAX};
  for (int k = 0; k < 20; ++k) {
    const auto list = std::filesystem::directory_iterator(proc / "fd");
    out.descriptors = std::min(out.descriptors, std::distance(begin(list), end(list)));
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return out;
}

class DayOfStreaming : public ::testing::Test {
 protected:
  void SetUp() override {
    server_ = std::make_unique<daemon::SampleServer>(daemon::sample_socket_of(socket_), 0600, "bench", 0,
                                                     daemon::SampleServer::Limits{});
    serving_ = std::thread([this] { server_->run(); });
    web_ = std::make_unique<Process>(
        std::vector<std::string>{bin("isorig-web"), "--socket", socket_, "--port", "0", "--web-socket",
                                 (dir_ / "door").string(), "--saved-protocols", (dir_ / "saved").string()},
        dir_ / "log");
    ASSERT_TRUE(wait_until(60, [&] {
      const auto log = web_->output();
      const auto at = log.find("http://localhost:");
      if (at == std::string::npos || log.find("samples: connected") == std::string::npos) return false;
      port_ = static_cast<unsigned short>(std::atoi(log.c_str() + at + 17));
      return port_ != 0;
    })) << web_->output();
  }
  void TearDown() override {
    web_.reset();
    server_->stop();
    serving_.join();
  }

  /// Ten samples of each kind and a control record, as the daemon's publisher hands them over.
  void turn() {
    for (int k = 0; k < 10; ++k, ++made_) {
      daemon::FrameRecord frame;
      frame.mono_ns = kBegin_ns + made_ * kMs;
      frame.sequence = static_cast<std::uint32_t>(made_);
      frame.force_N = force_N(made_);
      server_->on_frame(frame);
      daemon::PressureRecord pressure;
      pressure.mono_ns = frame.mono_ns;
      pressure.sequence = frame.sequence;
      pressure.pressure_psi = pressure_psi(made_);
      server_->on_pressure(pressure);
    }
    daemon::ControlRecord control;
    control.mono_ns = kBegin_ns + made_ * kMs - kMs;
    server_->on_control(control);
    ++controls_;
    server_->end_of_turn(0, control.mono_ns);
  }

  TempDir dir_;
  const std::string socket_ = (dir_ / "s").string();
  std::unique_ptr<daemon::SampleServer> server_;
  std::thread serving_;
  std::unique_ptr<Process> web_;
  unsigned short port_ = 0;
  std::int64_t made_ = 0, controls_ = 0;
};

TEST_F(DayOfStreaming, GrowsNothingLosesNothingUncountedAndKeepsTheTruth) {
  const char* asked = std::getenv("ISORIG_STREAM_HOURS");
  const std::int64_t hours = asked == nullptr ? 4 : std::atoi(asked);
  ASSERT_GE(hours, 2);

  const auto before = footprint(web_->pid());
  Witness witness(daemon::sample_socket_of(socket_));

  // A burst to whoever reads at leisure: what was sent and what was left out is what was made.
  auto first = std::make_unique<Page>(port_);
  while (made_ < kBurst) turn();
  // Losses lie all through the burst: its whole count is told in the first status after the last of it was seen.
  json web;
  ASSERT_TRUE(wait_until(60, [&] {
    turn();  // a loss is told before the next record
    return first->next() && newest_of_frame(first->text) > (kBegin_ns + kBurst * kMs) / kFine_ns;
  }));
  do {
    ASSERT_TRUE(first->next());
  } while (first->binary || json::parse(first->text).value("kind", "") != "status");
  web = first->web;
  first.reset();
  const std::int64_t clean_from = made_;
  const auto lost_to_web = [&](const json& status) {
    const auto lost = status.value("lost", std::uint64_t{0});
    EXPECT_EQ(lost, status.value("lost_on_the_way", std::uint64_t{0})) << "the gaps are what was counted on the way";
    return lost;
  };

  // Then a day at the pace of those who read.
  std::atomic<std::int64_t> seen{0};         // newest stretch of the frame at the fast page
  std::atomic<std::uint64_t> fast_count{0};  // messages to all pages
  std::atomic<bool> over{false};
  std::atomic<std::uint64_t> slow_count{0};
  Page fast(port_), slow(port_, 65'536);
  const auto dead = std::make_unique<Page>(port_, 65'536);  // never read until the end
  std::map<std::int64_t, std::uint64_t> fast_at;            // messages up to a frame's block, by its newest stretch
  std::vector<std::int64_t> fine;                           // stretches of the frame that the fast page got
  fine.assign(static_cast<std::size_t>(hours * 3600 * 50 + 30'000), 0);  // touched: it counts from the beginning
  fine.clear();
  std::uint64_t wrong = 0;
  json at_end;
  std::thread fast_reader([&] {
    bool counting = false;
    while (fast.next()) {
      const auto newest = fast.binary ? newest_of_frame(fast.text) : std::nullopt;
      // Both pages count from the first block that begins after both were there.
      if (newest && !counting && parsed(fast.text).first * kFine_ns >= kBegin_ns + (clean_from + 60'000) * kMs)
        counting = true;
      if (counting && fast.to_all()) ++fast_count;
      if (newest) {
        const auto block = parsed(fast.text);
        for (std::size_t k = 0; k < block.index.size(); ++k) {
          const auto stretch = block.first + block.index[k];
          const auto sample = (stretch * kFine_ns - kBegin_ns) / kMs;
          if (sample < clean_from) continue;
          fine.push_back(stretch);
          const auto expected = truth(force_N, sample, kFine_ns / kMs);
          if (block.column[3][k] != expected.low || block.column[4][k] != expected.high ||
              block.column[5][k] != expected.mean)
            ++wrong;
        }
        fast_at[*newest] = fast_count;
        seen = std::max(seen.load(), *newest);
      }
    }
    at_end = fast.web;
  });
  std::uint64_t slow_total = 0;  // what it got and what it was told that it did not get, up to `slow_at`
  std::int64_t slow_at = 0;
  std::thread slow_reader([&] {
    bool counting = false;
    std::uint64_t got = 0;
    while (slow.next()) {
      // One message for ten of the other page; at least one a second, so that it is slow and not gone.
      const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(1);
      while (!over && 10 * got > fast_count && std::chrono::steady_clock::now() < until)
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      const auto newest = slow.binary ? newest_of_frame(slow.text) : std::nullopt;
      if (newest && !counting && parsed(slow.text).first * kFine_ns >= kBegin_ns + (clean_from + 60'000) * kMs)
        counting = true;
      if (counting && slow.to_all()) ++got;
      slow_count = got;
      if (newest && counting) {
        slow_total = got + slow.left_out;
        slow_at = *newest;
      }
    }
  });

  Footprint web_after_an_hour, own_after_an_hour;
  const auto pace = [&] {
    // 20 s of samples are 1.7 MiB, of the 2 MiB of the queue.
    const auto ahead = [&] { return kBegin_ns + made_ * kMs - seen * kFine_ns; };
    return wait_until(60, [&] { return ahead() < 20'000 * kMs || made_ < clean_from + 20'000; });
  };
  const std::int64_t end = clean_from + hours * 3'600'000;
  while (made_ < end) {
    if (made_ % 1000 == 0) {
      ASSERT_TRUE(pace()) << "the page got nothing for a minute\n" << web_->output();
    }
    turn();
    if (web_after_an_hour.MiB == 0.0 && made_ >= clean_from + 3'600'000) {
      web_after_an_hour = footprint(web_->pid());
      own_after_an_hour = footprint(::getpid());
    }
  }
  // The slow page catches up; a few turns more, at a rig's own pace, so that it is told what it was not given.
  over = true;
  ASSERT_TRUE(wait_until(120, [&] {
    for (int k = 0; k < 2; ++k) turn();
    return slow_at > (kBegin_ns + end * kMs) / kFine_ns;
  }));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  const auto web_at_end = footprint(web_->pid());
  const auto own_at_end = footprint(::getpid());

  // A page that is opened now gets the day.
  Page late(port_);
  std::map<std::uint8_t, Block> day;
  while (!day.contains(0) || !day.contains(1)) {
    ASSERT_TRUE(late.next());
    if (!late.binary || late.text.at(1) != 1) continue;
    auto block = parsed(late.text);
    if (!day.contains(block.stream)) day.emplace(block.stream, std::move(block));
  }
  for (const auto& [stream, block] : day) {
    if (stream > 1) continue;
    SCOPED_TRACE(static_cast<int>(stream));
    const std::size_t channel = stream == 0 ? 3 : 0;  // frame: position, then force
    std::int64_t compared = 0, differ = 0;
    for (std::size_t k = 0; k < block.index.size(); ++k) {
      const auto sample = ((block.first + block.index[k]) * kCoarse_ns - kBegin_ns) / kMs;
      if (sample < clean_from) continue;
      const auto expected = truth(stream == 0 ? force_N : pressure_psi, sample, kCoarse_ns / kMs);
      if (sample + kCoarse_ns / kMs > made_) continue;
      ++compared;
      if (block.column[channel][k] != expected.low || block.column[channel + 1][k] != expected.high ||
          block.column[channel + 2][k] != expected.mean)
        ++differ;
    }
    EXPECT_EQ(differ, 0);
    // All stretches of 5 s that lie in the clean part as a whole, 24 h of them at most.
    const auto whole = std::min<std::int64_t>(17'280, hours * 720 - 2);
    EXPECT_GE(compared, whole - 1);
  }

  // What lies in its queue is read until a turn's own samples come through; what was lost before is told before these.
  // However long the machine lets the server's thread wait.
  ASSERT_TRUE(wait_until(120, [&] {
    turn();
    return witness.read_to(kBegin_ns + (made_ - 1) * kMs);
  }));
  (void)witness.read_to(kBegin_ns + made_ * kMs);  // the rest of that turn
  web_->stop();                                    // the readers end with it
  fast_reader.join();
  slow_reader.join();
  // Every stretch of the clean part came once, in order, and is exact: nothing was lost on any of the ways.
  EXPECT_EQ(wrong, 0U);
  ASSERT_FALSE(fine.empty());
  EXPECT_EQ(static_cast<std::int64_t>(fine.size()), fine.back() - fine.front() + 1);
  EXPECT_TRUE(std::ranges::is_sorted(fine));
  EXPECT_GE(static_cast<std::int64_t>(fine.size()), hours * 3600 * 50 - 2 * 3000);
  // What the server of the page lost in the burst, and not a sample after it; by the count and by the numbers.
  EXPECT_EQ(lost_to_web(at_end), lost_to_web(web));
  EXPECT_GT(lost_to_web(web), 0U);
  // The slow page was given the same messages or told how many it was not given.
  EXPECT_GT(slow.left_out, 0U);
  ASSERT_TRUE(fast_at.contains(slow_at));
  EXPECT_EQ(slow_total, fast_at.at(slow_at));
  // The one that took nothing was cut off.
  while (dead->next()) {
  }
  EXPECT_EQ(web_at_end.descriptors, before.descriptors + 2) << "the two pages that read";
  // Whoever subscribes and stands still costs its own samples alone, and each of them is counted.
  EXPECT_GT(witness.lost.frame, 0U);
  const auto& lost = witness.lost;
  EXPECT_EQ(witness.frame + witness.pressure + witness.control + lost.frame + lost.pressure + lost.control +
                lost.before_the_socket,
            static_cast<std::uint64_t>(2 * made_ + controls_));
  // What may come after the first hour: the slow page's full queue (24 MiB) and the day's rings, where their memory was
  // not touched before (5 of 17,280 stretches of 32 bytes). A byte a sample would be 27 MiB in four hours.
  EXPECT_LT(web_at_end.MiB - web_after_an_hour.MiB, 24.0 + 2.7 + 4.0);
  // The daemon's side: the queues of two subscribers and of what is handed over, 2 MiB each, and what this test notes.
  EXPECT_LT(own_at_end.MiB - own_after_an_hour.MiB, 6.0 + static_cast<double>(fast_at.size()) * 64.0 / 1048576.0 + 4.0);
  std::printf(
      "isorig-web %.1f MiB after an hour, %.1f at the end (%ld h); %ld and %ld descriptors; own %.1f and %.1f MiB\n",
      web_after_an_hour.MiB, web_at_end.MiB, static_cast<long>(hours), web_after_an_hour.descriptors,
      web_at_end.descriptors, own_after_an_hour.MiB, own_at_end.MiB);
}

}  // namespace
}  // namespace isorig::system_test
