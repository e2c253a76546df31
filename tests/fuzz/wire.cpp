#include "wire.hpp"

#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>

#include "drivers/api/error.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/transport/serial_port.hpp"
#include "drivers/transport/tcp_connect.hpp"

namespace isorig::fuzz {
namespace {

Peer* the_peer = nullptr;
int peer_fd = -1, driver_fd = -1;
std::int64_t now_ns = 1'000'000'000;  // of RealClock

void hang_up() {
  if (peer_fd >= 0) ::close(peer_fd);
  peer_fd = -1;
}

int connect_pair() {
  hang_up();
  std::array<int, 2> ends{-1, -1};
  require(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends.data()) == 0, "no pair of sockets");
  driver_fd = ends[0];
  peer_fd = ends[1];
  return driver_fd;
}

/// The peer reads what was written and answers. False: it keeps silent.
bool let_answer() {
  if (peer_fd < 0) return false;
  std::string written;
  std::array<char, 4096> bytes{};
  for (ssize_t size = 0; (size = ::recv(peer_fd, bytes.data(), bytes.size(), 0)) > 0;)
    written.append(bytes.data(), static_cast<std::size_t>(size));
  const auto answer = the_peer->answer(written);
  const bool closes = the_peer->closes();
  if (!answer.empty()) (void)!::send(peer_fd, answer.data(), answer.size(), MSG_NOSIGNAL);
  if (closes) hang_up();
  return closes || !answer.empty();
}

}  // namespace

OnTheWire::OnTheWire(Peer& peer) {
  ::signal(SIGPIPE, SIG_IGN);  // a tty that hangs up sends none
  the_peer = &peer;
}
OnTheWire::~OnTheWire() {
  hang_up();
  the_peer = nullptr;
}

void use(Input& in, frame::Device& device, std::span<frame::Sample> samples, const Use& how) {
  for (int turn = 0; turn < 4 && !(turn > 0 && in.empty()); ++turn) {
    driver_fd = -1;
    try {
      (void)device.connect();
      for (int i = 0; i < how.acts && !in.empty(); ++i) {
        const auto what = in.byte() % how.kinds;
        try {
          if (what == 1) {
            device.start_segment({static_cast<std::uint16_t>(i + 1), static_cast<float>(in.byte()) / 64.0F, 2.0F});
          } else if (what == 2) {
            device.stop();
          } else if (what == 3) {
            device.heartbeat(static_cast<std::uint16_t>(i));
          } else {
            require(device.poll(samples).samples <= samples.size(), "more samples than room");
          }
        } catch (const drivers::DeviceError& error) {
          refused(error.what());
          if (error.fault() == drivers::Fault::kDisconnected) break;
        }
      }
    } catch (const drivers::DeviceError& error) {
      refused(error.what());
    }
    require(driver_fd >= 0, "the driver did not ask for the connection of this file: the linker took another");
    device.disconnect();
  }
}

int wait_on_the_wire(pollfd* of, nfds_t count, std::int64_t timeout_ns) {
  require(count == 1 && the_peer != nullptr, "a wait that is none for the wire");
  if ((of->events & POLLIN) != 0 && ::poll(of, 1, 0) == 0 && of->fd == driver_fd && !let_answer()) {
    now_ns += std::max<std::int64_t>(timeout_ns, 0) + 1;
    the_peer->waited(timeout_ns);
    return 0;
  }
  return ::poll(of, 1, 0);
}

}  // namespace isorig::fuzz

namespace isorig::drivers {

int connect_tcp(const std::string&, std::uint16_t, int, const std::string&) {
  return fuzz::connect_pair();
}
int open_serial(const SerialSettings&, const std::string&) {
  return fuzz::connect_pair();
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

// In place of libc's, for the drivers in this program.
extern "C" int ppoll(pollfd* of, nfds_t count, const timespec* timeout, const sigset_t*) {
  const std::int64_t timeout_ns =
      timeout == nullptr ? 0 : std::int64_t{timeout->tv_sec} * 1'000'000'000 + timeout->tv_nsec;
  return isorig::fuzz::wait_on_the_wire(of, count, timeout_ns);
}
