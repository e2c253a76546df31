#pragma once
#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>

namespace isorig::daemon {

/// From where somebody operates: a user's terminals, which are one seat, or one session of the live page.
struct Seat {
  uid_t uid = static_cast<uid_t>(-1);
  std::string name;               ///< for people
  std::string page;               ///< of the live page: which session; empty: a terminal
  uid_t relay = uid;              ///< who spoke for that session: no other user's page is taken for it
  bool relay_is_trusted = false;  ///< to say for whom it speaks

  [[nodiscard]] bool same_as(const Seat& other) const;
  /// It is this user's, by the word of somebody who is to be believed: not of just any process that names him.
  [[nodiscard]] bool is_surely_of_its_user() const { return relay_is_trusted || relay == uid; }
};

/// Who has control of the rig: one operator at a time, whatever he operates from. To look and to stop needs no control.
///
/// A terminal takes it with its first command that needs it, when nobody has it, and loses it five minutes after its
/// last one, but not while the rig is busy. A page asks for it, and has to say once a minute that somebody is there. A
/// terminal of the same user as the holder is the holder: the kernel knows users, not persons. So is a page, if who
/// speaks for it is trusted to say whose it is. Everybody else takes it over, which is said to both, or is refused.
/// Asks for no time; any thread.
class Control {
 public:
  using Time = std::chrono::steady_clock::time_point;
  struct Limits {
    std::chrono::seconds terminal{300};
    std::chrono::seconds page{60};
  };
  struct Holder {
    Seat seat;
    std::int64_t since_unix_s = 0;
    std::uint64_t term = 0;  ///< grows from holder to holder, over restarts of the daemon, too
  };
  struct Answer {
    bool ok = false;
    std::string text;        ///< for people
    std::string taken_from;  ///< the name of the holder until now
    std::uint64_t term = 0;  ///< of whoever asked, if he has control
  };
  /// `busy`: the rig is not between runs: a run is open or about to be, the rig is in setup or has a fault. `ended`
  /// hears of control that nobody used any more.
  explicit Control(std::function<bool()> busy, std::function<void(const Holder&)> ended = {});
  Control(std::function<bool()> busy, std::function<void(const Holder&)> ended, const Limits& limits);

  /// Nobody, or who.
  [[nodiscard]] std::optional<Holder> holder(Time now);
  /// `over`: from whoever has it.
  Answer take(const Seat& seat, bool over, Time now, std::int64_t unix_s);
  Answer give_back(const Seat& seat, Time now);
  /// Somebody is at that page still. False: it has no control (any more).
  bool keep(const Seat& seat, Time now);

  /// For a command that needs control. Refused, with why; or let through, and `newly` is the term when it was taken for
  /// this command just now: undo() gives it back if the command is refused, unless the holder has used it for something
  /// else meanwhile.
  struct Use {
    std::string refused;
    std::uint64_t newly = 0;
  };
  /// `before`: of a command that is judged a second time, the `newly` of the first.
  Use use(const Seat& seat, Time now, std::int64_t unix_s, std::uint64_t before = 0);
  void undo(std::uint64_t newly);

 private:
  [[nodiscard]] std::uint64_t next_term(std::int64_t unix_s);
  void end_what_is_over(Time now);
  [[nodiscard]] std::string held_text() const;

  const std::function<bool()> busy_;
  const std::function<void(const Holder&)> ended_;
  const Limits limits_;
  std::mutex mutex_;
  std::optional<Holder> holder_;  // guarded by mutex_, as all below
  Time used_{};
  std::uint64_t terms_ = 0;
  std::uint64_t provisional_ = 0;  ///< the term that one command alone took, of which nobody knows yet what comes
};

/// "ann at a terminal", "Ann on the live page".
[[nodiscard]] std::string where_text(const Seat& seat);

}  // namespace isorig::daemon
