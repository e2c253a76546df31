#pragma once
#include <termios.h>

#include <csignal>
#include <string>
#include <vector>

/// The terminal itself. Four control sequences that every terminal of the last forty years knows (ECMA-48, and the
/// private modes 25, 7 and 1049 of xterm) and a whole redraw twice a second: a library for windows would be more.
namespace isorig::cli {

struct TerminalSize {
  int columns = 80, rows = 24;
};
[[nodiscard]] TerminalSize terminal_size(int fd);

/// NO_COLOR (no-color.org: set and not empty) and TERM=dumb are respected.
[[nodiscard]] bool wants_colour();
/// Whether what is written is read as UTF-8: LC_ALL, LC_CTYPE, LANG in this order.
[[nodiscard]] bool is_utf8_locale();

/// While it lives, standard output is the alternate screen, the cursor is hidden, lines do not wrap, keys come one by
/// one and unseen. Ends on every way out, Ctrl-C, a time limit and a closed terminal included, which it turns into Key.
class AlternateScreen {
 public:
  AlternateScreen();
  ~AlternateScreen();
  AlternateScreen(const AlternateScreen&) = delete;
  AlternateScreen& operator=(const AlternateScreen&) = delete;

  void draw(const std::vector<std::string>& lines) const;

  enum class Key { kNone, kLeave, kResized };
  /// Waits for a key, a signal or the time. q, Q, Ctrl-C, Ctrl-D, SIGINT, SIGTERM and SIGHUP leave.
  [[nodiscard]] Key wait(double seconds) const;

 private:
  bool keys_ = false;  // standard input is a terminal too
  termios before_{};
  sigset_t outside_{};  // the signal mask of before
};

}  // namespace isorig::cli
