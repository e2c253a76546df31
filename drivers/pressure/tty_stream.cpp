#include "drivers/pressure/tty_stream.hpp"

#include <fcntl.h>
#include <linux/serial.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <system_error>
#include <thread>

#include "drivers/api/error.hpp"

namespace isorig::pressure {
namespace {

using drivers::DeviceError;
using drivers::Fault;

constexpr speed_t kBaud = B115200;
static_assert(kBaud != B134, "134 baud reboots a Teensy into its boot loader");

std::string error_text(int error) {
  return std::generic_category().message(error);
}

[[noreturn]] void throw_open_error(const std::string& path, int error) {
  switch (error) {
    case ENOENT:
    case ENODEV:
    case ENXIO:
      throw DeviceError(Fault::kDisconnected, path +
                                                  ": no such device; is it plugged in, and is its program running? "
                                                  "`ls -l /dev/serial/by-id` lists what is there");
    case EACCES:
    case EPERM:
      throw DeviceError(Fault::kRefused, path + ": no permission; serial devices belong to the group `dialout`");
    case EBUSY:
      throw DeviceError(Fault::kDisconnected, path + ": another program has it open; `fuser -v " + path + "` names it");
    default:
      throw DeviceError(Fault::kDisconnected, path + ": cannot open: " + error_text(error));
  }
}

bool make_raw(int fd) {
  termios tio{};
  if (tcgetattr(fd, &tio) != 0) return false;
  cfmakeraw(&tio);
  tio.c_cflag |= CLOCAL | CREAD;
  tio.c_cflag &= ~static_cast<tcflag_t>(CRTSCTS);
  tio.c_cc[VMIN] = 1;  // an empty line then reads EAGAIN, and 0 means hung up and nothing else
  tio.c_cc[VTIME] = 0;
  return cfsetspeed(&tio, kBaud) == 0 && tcsetattr(fd, TCSANOW, &tio) == 0;
}

// Otherwise close() waits up to 30 s for a device that takes nothing. Needs CAP_SYS_ADMIN, and a pty has no
// such setting: close() below does without it.
void do_not_wait_on_close(int fd) {
  serial_struct serial{};
  if (ioctl(fd, TIOCGSERIAL, &serial) != 0) return;
  serial.closing_wait = ASYNC_CLOSING_WAIT_NONE;
  (void)ioctl(fd, TIOCSSERIAL, &serial);
}

}  // namespace

void TtyStream::open() {
  close();
  const int fd = ::open(options_.path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) throw_open_error(options_.path, errno);
  fd_ = fd;
  if (!make_raw(fd)) {
    const int error = errno;
    close();
    if (error == ENOTTY) throw DeviceError(Fault::kIdentity, options_.path + ": not a serial device");
    throw_open_error(options_.path, error);
  }
  if (ioctl(fd, TIOCEXCL) != 0 || flock(fd, LOCK_EX | LOCK_NB) != 0) {
    const int error = errno;
    close();
    throw_open_error(options_.path, error == EWOULDBLOCK ? EBUSY : error);
  }
  do_not_wait_on_close(fd);
  tcflush(fd, TCIOFLUSH);
}

void TtyStream::close() noexcept {
  if (fd_ < 0) return;
  const int fd = fd_;
  fd_ = -1;
  tcflush(fd, TCIOFLUSH);
  // Both locks are given back by hand: a pty keeps TIOCEXCL as long as its other side is open.
  (void)ioctl(fd, TIOCNXCL);
  (void)flock(fd, LOCK_UN);
  // What a flush does not empty is already in the hands of the USB driver, and close() would wait for the
  // device to take it. Only that rare case gets a thread.
  int pending = 0;
  if (ioctl(fd, TIOCOUTQ, &pending) == 0 && pending > 0) {
    try {
      std::thread([fd] { ::close(fd); }).detach();
      return;
    } catch (const std::system_error&) {  // no thread to be had: better to wait than to leak the device
    }
  }
  ::close(fd);
}

void TtyStream::fail_disconnected(const std::string& what) {
  throw DeviceError(Fault::kDisconnected, options_.path + ": " + what);
}

bool TtyStream::wait_for(short events, std::int64_t timeout_ns) {
  pollfd waiting{fd_, events, 0};
  const std::int64_t wait_ns = std::max<std::int64_t>(timeout_ns, 0);
  const timespec timeout{static_cast<time_t>(wait_ns / 1'000'000'000), static_cast<long>(wait_ns % 1'000'000'000)};
  int ready = 0;
  do {
    ready = ppoll(&waiting, 1, &timeout, nullptr);
  } while (ready < 0 && errno == EINTR);
  if (ready < 0) fail_disconnected("poll: " + error_text(errno));
  // After a hang-up what arrived before is still readable; read() tells the end.
  if ((waiting.revents & (POLLHUP | POLLERR | POLLNVAL)) != 0 && (waiting.revents & POLLIN) == 0) {
    fail_disconnected("the device is gone (hang-up)");
  }
  return (waiting.revents & events) != 0;
}

std::size_t TtyStream::read_some(std::span<std::uint8_t> out, std::int64_t timeout_ns) {
  if (!is_open()) fail_disconnected("not open");
  if (!wait_for(POLLIN, timeout_ns)) return 0;
  const ssize_t size = ::read(fd_, out.data(), out.size());
  if (size > 0) return static_cast<std::size_t>(size);
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return 0;
  fail_disconnected(size == 0 ? "the device is gone (end of file)" : "the device is gone (" + error_text(errno) + ")");
}

void TtyStream::write_all(std::span<const std::uint8_t> bytes) {
  if (!is_open()) fail_disconnected("not open");
  while (!bytes.empty()) {
    const ssize_t size = ::write(fd_, bytes.data(), bytes.size());
    if (size > 0) {
      bytes = bytes.subspan(static_cast<std::size_t>(size));
      continue;
    }
    if (size < 0 && errno != EAGAIN && errno != EINTR) {
      fail_disconnected("the device is gone (" + error_text(errno) + ")");
    }
    if (!wait_for(POLLOUT, options_.write_timeout_ns)) {
      throw DeviceError(Fault::kTimeout, options_.path + ": the device takes no data; its program hangs");
    }
  }
}

}  // namespace isorig::pressure
