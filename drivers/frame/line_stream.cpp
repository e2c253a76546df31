#include "drivers/frame/line_stream.hpp"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "drivers/api/error.hpp"
#include "drivers/transport/serial_port.hpp"
#include "drivers/transport/tcp_connect.hpp"

namespace isorig::frame {
namespace {

using drivers::DeviceError;
using drivers::Fault;

constexpr std::size_t kLongestLine = 256;
constexpr int kWriteTimeout_ms = 100;

bool wait_for(int fd, short events, std::int64_t timeout_ns) {
  pollfd waiting{fd, events, 0};
  const std::int64_t wait_ns = std::max<std::int64_t>(timeout_ns, 0);
  const timespec timeout{static_cast<time_t>(wait_ns / 1'000'000'000), static_cast<long>(wait_ns % 1'000'000'000)};
  return ::ppoll(&waiting, 1, &timeout, nullptr) > 0;
}

}  // namespace

void LineStream::fail_disconnected(const std::string& what) {
  close();
  throw DeviceError(Fault::kDisconnected, options_.name + ": " + what);
}

void LineStream::open() {
  close();
  if (options_.tcp) {
    fd_ = drivers::connect_tcp(options_.host, options_.port, options_.connect_timeout_ms, options_.name);
  } else {
    fd_ = drivers::open_serial({options_.tty, options_.baud, options_.parity, 8, options_.stop_bits}, options_.name);
  }
  received_.clear();
}

void LineStream::close() noexcept {
  if (fd_ < 0) return;
  if (options_.tcp) {
    ::close(fd_);
  } else {
    drivers::close_serial(fd_);
  }
  fd_ = -1;
}

void LineStream::write_line(std::string_view line) {
  if (fd_ < 0) fail_disconnected("not connected");
  std::string bytes(line);
  bytes += "\r\n";
  std::string_view left = bytes;
  while (!left.empty()) {
    const ssize_t size =
        options_.tcp ? ::send(fd_, left.data(), left.size(), MSG_NOSIGNAL) : ::write(fd_, left.data(), left.size());
    if (size > 0) {
      left.remove_prefix(static_cast<std::size_t>(size));
      continue;
    }
    if (size < 0 && errno != EAGAIN && errno != EINTR)
      fail_disconnected(std::string("connection lost (") + std::strerror(errno) + ")");
    if (!wait_for(fd_, POLLOUT, std::int64_t{kWriteTimeout_ms} * 1'000'000)) {
      // Half a line may have gone: whatever is sent next would be glued to it.
      fail_disconnected("takes no more data");
    }
  }
}

void LineStream::fill(std::int64_t until_ns) {
  if (fd_ < 0) fail_disconnected("not connected");
  if (!wait_for(fd_, POLLIN, until_ns - clock_.now_ns())) return;
  std::array<char, 512> bytes{};
  const ssize_t size = ::read(fd_, bytes.data(), bytes.size());
  received_ns_ = clock_.now_ns();
  if (size > 0) {
    received_.append(bytes.data(), static_cast<std::size_t>(size));
  } else if (size == 0) {
    fail_disconnected("connection closed by the other side");
  } else if (errno != EAGAIN && errno != EINTR) {
    fail_disconnected(std::string("connection lost (") + std::strerror(errno) + ")");
  }
}

std::optional<LineStream::Line> LineStream::read_line(std::int64_t until_ns) {
  bool looked = false;
  for (;;) {
    if (const auto end = received_.find('\n'); end != std::string::npos) {
      Line line{received_.substr(0, end), received_ns_};
      received_.erase(0, end + 1);
      if (!line.text.empty() && line.text.back() == '\r') line.text.pop_back();
      return line;
    }
    if (received_.size() > kLongestLine) {
      received_.clear();
      throw DeviceError(Fault::kProtocol,
                        options_.name + ": what comes in has no lines; check baud, parity and what is connected");
    }
    if (looked && clock_.now_ns() >= until_ns) return std::nullopt;
    fill(until_ns);
    looked = true;
  }
}

bool LineStream::discard_input() {
  bool any = !received_.empty();
  received_.clear();
  for (;;) {
    fill(0);
    if (received_.empty()) return any;
    any = true;
    received_.clear();
  }
}

}  // namespace isorig::frame
