#include "cli/screen/terminal.hpp"

#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <string_view>

namespace isorig::cli {
namespace {

volatile std::sig_atomic_t left = 0, resized = 0;
constexpr std::array kLeaving{SIGINT, SIGTERM, SIGHUP, SIGQUIT};
std::array<struct sigaction, kLeaving.size() + 1> former{};

void write_all(std::string_view text) {
  while (!text.empty()) {
    const auto n = ::write(STDOUT_FILENO, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return;  // the terminal is gone: whoever waits for it hears so by SIGHUP
    text.remove_prefix(static_cast<std::size_t>(n));
  }
}

std::string_view environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? std::string_view() : std::string_view(value);
}

}  // namespace

TerminalSize terminal_size(int fd) {
  winsize size{};
  TerminalSize out;
  if (::ioctl(fd, TIOCGWINSZ, &size) == 0) {
    if (size.ws_col > 0) out.columns = size.ws_col;
    if (size.ws_row > 0) out.rows = size.ws_row;
  }
  return out;
}

bool wants_colour() {
  return environment("NO_COLOR").empty() && environment("TERM") != "dumb";
}

bool is_utf8_locale() {
  for (const char* name : {"LC_ALL", "LC_CTYPE", "LANG"}) {
    const auto value = environment(name);
    if (value.empty()) continue;
    return value.find("UTF-8") != value.npos || value.find("utf8") != value.npos || value.find("utf-8") != value.npos;
  }
  return false;
}

AlternateScreen::AlternateScreen() {
  left = 0;
  resized = 0;
  // Delivered in wait() alone: a change of size between drawing and waiting is not missed.
  sigset_t mine;
  sigemptyset(&mine);
  struct sigaction action {};
  sigemptyset(&action.sa_mask);
  action.sa_handler = [](int) { left = 1; };
  for (std::size_t i = 0; i < kLeaving.size(); ++i) {
    sigaddset(&mine, kLeaving[i]);
    ::sigaction(kLeaving[i], &action, &former[i]);
  }
  action.sa_handler = [](int) { resized = 1; };
  sigaddset(&mine, SIGWINCH);
  ::sigaction(SIGWINCH, &action, &former.back());
  ::sigprocmask(SIG_BLOCK, &mine, &outside_);
  keys_ = ::isatty(STDIN_FILENO) != 0 && ::tcgetattr(STDIN_FILENO, &before_) == 0;
  if (keys_) {
    termios raw = before_;
    raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
    raw.c_cc[VMIN] = 1;
    raw.c_cc[VTIME] = 0;
    raw.c_cc[VSUSP] = _POSIX_VDISABLE;  // stopped on the alternate screen, the shell's line would be on it
    ::tcsetattr(STDIN_FILENO, TCSANOW, &raw);
  }
  write_all("\x1b[?1049h\x1b[?25l\x1b[?7l");
}

AlternateScreen::~AlternateScreen() {
  write_all("\x1b[0m\x1b[?7h\x1b[?25h\x1b[?1049l");
  if (keys_) ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &before_);
  for (std::size_t i = 0; i < kLeaving.size(); ++i) ::sigaction(kLeaving[i], &former[i], nullptr);
  ::sigaction(SIGWINCH, &former.back(), nullptr);
  // What is still pending was answered by leaving.
  const timespec now{};
  sigset_t pending;
  sigemptyset(&pending);
  for (const int number : kLeaving) sigaddset(&pending, number);
  while (::sigtimedwait(&pending, nullptr, &now) > 0) {
  }
  ::sigprocmask(SIG_SETMASK, &outside_, nullptr);
}

void AlternateScreen::draw(const std::vector<std::string>& lines) const {
  std::string out = "\x1b[H";
  for (std::size_t i = 0; i < lines.size(); ++i) {
    out += lines[i] + "\x1b[0m\x1b[K";
    if (i + 1 < lines.size()) out += "\r\n";
  }
  write_all(out + "\x1b[J");
}

AlternateScreen::Key AlternateScreen::wait(double seconds) const {
  pollfd keys{keys_ ? STDIN_FILENO : -1, POLLIN, 0};
  const double whole_s = std::floor(seconds);
  const timespec limit{static_cast<time_t>(whole_s), static_cast<long>((seconds - whole_s) * 1e9)};
  if (::ppoll(&keys, 1, &limit, &outside_) > 0) {
    char c = 0;
    if (::read(STDIN_FILENO, &c, 1) <= 0) return Key::kLeave;
    if (c == 'q' || c == 'Q' || c == '\x03' || c == '\x04') return Key::kLeave;
  }
  if (left != 0) return Key::kLeave;
  if (resized != 0) {
    resized = 0;
    return Key::kResized;
  }
  return Key::kNone;
}

}  // namespace isorig::cli
