#include "wire.hpp"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "drivers/api/error.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/transport/serial_port.hpp"
#include "drivers/transport/tcp_connect.hpp"

namespace isorig::fuzz {
namespace {

Peer* the_peer = nullptr;
constexpr std::int64_t kFirst_ns = 1'000'000'000;
std::int64_t now_ns = kFirst_ns;  // of RealClock

/// What a pair of sockets does, without the kernel: an input is some hundred requests, each of them some calls.
struct Line {
  const int fd = ::open("/dev/null", O_RDWR | O_CLOEXEC);  // of the driver's end: nobody else gets this number
  bool connected = false;                                  // since the driver was last asked for it
  bool is_open = false, peer_is_open = false;
  bool used = false;
  std::string to_peer, to_driver;
};
/// As much as a socket holds, by and large.
constexpr std::size_t kHolds = std::size_t{128} << 10U;

Line& line() {
  static Line the_line;
  return the_line;
}

int connect_line() {
  require(line().fd >= 0, "no descriptor for the line");
  line().connected = line().is_open = line().peer_is_open = true;
  line().to_peer.clear();
  line().to_driver.clear();
  return line().fd;
}

bool is_line(int fd) {
  if (fd != line().fd || !line().is_open) return false;
  line().used = true;
  return true;
}

ssize_t put_on_line(std::string_view bytes) {
  if (!line().peer_is_open) {
    errno = EPIPE;
    return -1;
  }
  line().to_peer += bytes;
  return static_cast<ssize_t>(bytes.size());
}

ssize_t take_from_line(void* to, std::size_t room) {
  auto& coming = line().to_driver;
  if (coming.empty() && line().peer_is_open) {
    errno = EAGAIN;
    return -1;
  }
  const auto size = std::min(room, coming.size());
  std::memcpy(to, coming.data(), size);
  coming.erase(0, size);
  return static_cast<ssize_t>(size);
}

/// The peer reads what was written and answers. False: it keeps silent.
bool let_answer() {
  if (!line().peer_is_open) return false;
  const auto written = std::exchange(line().to_peer, {});
  auto answer = the_peer->answer(written);
  answer.resize(std::min(answer.size(), kHolds));
  line().to_driver = std::move(answer);
  line().peer_is_open = !the_peer->closes();
  return !line().peer_is_open || !line().to_driver.empty();
}

}  // namespace

OnTheWire::OnTheWire(Peer& peer) {
  now_ns = kFirst_ns;
  the_peer = &peer;
}
OnTheWire::~OnTheWire() {
  line().peer_is_open = false;
  the_peer = nullptr;
}

void use(Input& in, frame::Device& device, std::span<frame::Sample> samples, const Use& how) {
  const auto act = [&](int i) {
    const auto what = in.byte() % how.kinds;
    if (what == 1) {
      device.start_segment({static_cast<std::uint16_t>(i + 1), static_cast<float>(in.byte()) / 64.0F, 2.0F});
    } else if (what == 2) {
      device.stop();
    } else if (what == 3) {
      device.heartbeat(static_cast<std::uint16_t>(i));
    } else {
      require(device.poll(samples).samples <= samples.size(), "more samples than room");
    }
  };
  use(in, {[&] { (void)device.connect(); }, [&] { device.disconnect(); }, act}, how.acts);
}

void use(Input& in, const Device& device, int acts) {
  for (int turn = 0; turn < 4 && !(turn > 0 && in.empty()); ++turn) {
    line().connected = line().used = false;
    try {
      device.connect();
      for (int i = 0; i < acts && !in.empty(); ++i) {
        try {
          device.act(i);
        } catch (const drivers::DeviceError& error) {
          refused(error.what());
          if (error.fault() == drivers::Fault::kDisconnected) break;
        }
      }
    } catch (const drivers::DeviceError& error) {
      refused(error.what());
    }
    require(line().connected && line().used,
            "the driver did not ask for the connection of this file, or not use it: the linker took another");
    device.disconnect();
  }
}

namespace {

/// Where nothing is to be read the peer has its turn; time passes when it keeps silent.
int wait_on_line(pollfd* of, std::int64_t timeout_ns) {
  const auto readable = [] { return !line().to_driver.empty() || !line().peer_is_open; };
  require(the_peer != nullptr, "a wait that is none for the wire");
  of->revents = static_cast<short>(of->events & POLLOUT);
  if ((of->events & POLLIN) != 0) {
    if (!readable() && !let_answer()) {
      now_ns += std::max<std::int64_t>(timeout_ns, 0) + 1;
      the_peer->waited(timeout_ns);
      return 0;
    }
    if (readable()) of->revents = static_cast<short>(of->revents | POLLIN);
  }
  return of->revents != 0 ? 1 : 0;
}

}  // namespace
}  // namespace isorig::fuzz

namespace isorig::drivers {

int connect_tcp(const std::string&, std::uint16_t, int, const std::string&) {
  return fuzz::connect_line();
}
int open_serial(const SerialSettings&, const std::string&) {
  return fuzz::connect_line();
}
void close_serial(int fd) noexcept {
  ::close(fd);
}

}  // namespace isorig::drivers

namespace isorig::clock {

std::int64_t RealClock::now_ns() const noexcept {
  return fuzz::now_ns += 1000;
}
void RealClock::sleep_until_ns(std::int64_t deadline_ns) noexcept {
  fuzz::now_ns = std::max(fuzz::now_ns, deadline_ns);
}

}  // namespace isorig::clock

// In place of libc's, for the drivers in this program: the linker's --wrap.
extern "C" {

ssize_t __real_read(int fd, void* to, size_t room);
ssize_t __real_write(int fd, const void* bytes, size_t size);
ssize_t __real_send(int fd, const void* bytes, size_t size, int flags);
int __real_close(int fd);
int __real_tcflush(int fd, int queue);
int __real_ppoll(pollfd* of, nfds_t count, const timespec* timeout, const sigset_t* mask);

ssize_t __wrap_read(int fd, void* to, size_t room) {
  return isorig::fuzz::is_line(fd) ? isorig::fuzz::take_from_line(to, room) : __real_read(fd, to, room);
}
ssize_t __wrap_write(int fd, const void* bytes, size_t size) {
  return isorig::fuzz::is_line(fd) ? isorig::fuzz::put_on_line({static_cast<const char*>(bytes), size})
                                   : __real_write(fd, bytes, size);
}
ssize_t __wrap_send(int fd, const void* bytes, size_t size, int flags) {
  return isorig::fuzz::is_line(fd) ? isorig::fuzz::put_on_line({static_cast<const char*>(bytes), size})
                                   : __real_send(fd, bytes, size, flags);
}
int __wrap_close(int fd) {
  if (!isorig::fuzz::is_line(fd)) return __real_close(fd);
  isorig::fuzz::line().is_open = false;
  return 0;
}
/// What is on its way arrives behind a flush: nothing is dropped, which is worse than what a line does.
int __wrap_tcflush(int fd, int queue) {
  return isorig::fuzz::is_line(fd) ? 0 : __real_tcflush(fd, queue);
}
int __wrap_ppoll(pollfd* of, nfds_t count, const timespec* timeout, const sigset_t* mask) {
  if (count != 1 || !isorig::fuzz::is_line(of->fd)) return __real_ppoll(of, count, timeout, mask);
  const std::int64_t timeout_ns =
      timeout == nullptr ? 0 : std::int64_t{timeout->tv_sec} * 1'000'000'000 + timeout->tv_nsec;
  return isorig::fuzz::wait_on_line(of, timeout_ns);
}

}  // extern "C"
