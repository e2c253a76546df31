#include "drivers/transport/serial_port.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "drivers/api/error.hpp"

namespace isorig::drivers {
namespace {

speed_t speed_of(int baud) {
  constexpr std::array<std::pair<int, speed_t>, 19> kSpeeds{{{1200, B1200},
                                                             {2400, B2400},
                                                             {4800, B4800},
                                                             {9600, B9600},
                                                             {19200, B19200},
                                                             {38400, B38400},
                                                             {57600, B57600},
                                                             {115200, B115200},
                                                             {230400, B230400},
                                                             {460800, B460800},
                                                             {500000, B500000},
                                                             {576000, B576000},
                                                             {921600, B921600},
                                                             {1000000, B1000000},
                                                             {1152000, B1152000},
                                                             {1500000, B1500000},
                                                             {2000000, B2000000},
                                                             {3000000, B3000000},
                                                             {4000000, B4000000}}};
  for (const auto& [number, speed] : kSpeeds) {
    if (number == baud) return speed;
  }
  return B0;
}

bool set_up(int fd, const SerialSettings& settings) {
  termios tio{};
  const speed_t speed = speed_of(settings.baud);
  if (speed == B0 || tcgetattr(fd, &tio) != 0) return false;
  cfmakeraw(&tio);
  tio.c_cflag |= CLOCAL | CREAD;
  tio.c_cflag &= ~static_cast<tcflag_t>(CRTSCTS | PARENB | PARODD | CSTOPB | CSIZE);
  tio.c_cflag |= settings.data_bits == 7 ? CS7 : CS8;
  if (settings.parity != 'N') tio.c_cflag |= PARENB;
  if (settings.parity == 'O') tio.c_cflag |= PARODD;
  if (settings.stop_bits == 2) tio.c_cflag |= CSTOPB;
  tio.c_cc[VMIN] = 1;  // an empty line then reads EAGAIN, and 0 means hung up
  tio.c_cc[VTIME] = 0;
  return cfsetspeed(&tio, speed) == 0 && tcsetattr(fd, TCSANOW, &tio) == 0;
}

}  // namespace

int open_serial(const SerialSettings& settings, const std::string& name) {
  const int fd = ::open(settings.tty.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) {
    const int error = errno;
    if (error == EACCES || error == EPERM) {
      throw DeviceError(Fault::kRefused, name + ": no permission; serial devices belong to the group `dialout`");
    }
    throw DeviceError(Fault::kDisconnected, name + ": cannot open (" + std::strerror(error) +
                                                "); is the adapter plugged in, and this user in the group `dialout`?");
  }
  const auto fail = [&](const std::string& what) {
    ::close(fd);
    throw DeviceError(Fault::kDisconnected, name + ": " + what);
  };
  if (!set_up(fd, settings))
    fail("cannot be set to " + std::to_string(settings.baud) + " baud; is it a serial device?");
  if (ioctl(fd, TIOCEXCL) != 0 || flock(fd, LOCK_EX | LOCK_NB) != 0) {
    fail("another program has it open; `fuser -v " + settings.tty + "` names it");
  }
  tcflush(fd, TCIOFLUSH);
  return fd;
}

void close_serial(int fd) noexcept {
  tcflush(fd, TCIFLUSH);
  int pending = 0;
  for (int tries = 0; tries < 20 && ioctl(fd, TIOCOUTQ, &pending) == 0 && pending > 0; ++tries) ::usleep(5'000);
  // What a dead adapter does not take: close() would wait for it.
  if (pending > 0) tcflush(fd, TCOFLUSH);
  (void)ioctl(fd, TIOCNXCL);  // a pty keeps it as long as its other side is open
  (void)flock(fd, LOCK_UN);
  ::close(fd);
}

}  // namespace isorig::drivers
