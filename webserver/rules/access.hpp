#pragma once
#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

/// Who may do what on the page: nobody without a session, which begins with a one-time token that was asked for over a
/// Unix socket. Which of them has control is the daemon's to say, since terminals ask for it, too: here is what it said
/// last. Asks for no time and does no I/O but for the random numbers.
namespace isorig::web {

using Time = std::chrono::steady_clock::time_point;

/// A user of the page: as the kernel said of the process that asked for the link, but for the name, which is his word.
struct Who {
  std::string name;
  uid_t uid = 0;
  gid_t gid = 0;
  std::vector<gid_t> groups;
  std::string page;  ///< how the daemon tells sessions apart; no secret
};

/// 256 bits of the kernel's random numbers, as 64 hexadecimal digits. Throws std::system_error.
[[nodiscard]] std::string random_secret();

class Access {
 public:
  struct Limits {
    std::chrono::seconds token{120};  ///< a token that nobody used by then is void
    std::chrono::hours session{12};   ///< a session without an open page that was not used for so long has ended
    std::size_t tokens = 32;
    std::size_t sessions = 64;
  };
  Access() = default;
  explicit Access(const Limits& limits) : limits_(limits) {}

  class TooMany : public std::runtime_error {
    using std::runtime_error::runtime_error;
  };

  /// A token for one use. Throws TooMany.
  [[nodiscard]] std::string mint(const Who& who, Time now);
  /// A session for a token that is valid; the token is void then. Where there are too many sessions, the one that was
  /// not used for the longest ends, of those that no page is open of. Throws TooMany, and the token is good still.
  [[nodiscard]] std::optional<std::string> redeem(const std::string& token, Time now);
  /// Whose session it is, and that it is used.
  [[nodiscard]] std::optional<Who> who(const std::string& session, Time now);
  /// Ends a session.
  void leave(const std::string& session);

  /// Who has control, as the daemon says.
  struct Control {
    std::string holder;
    std::uint64_t term = 0;
    bool operator==(const Control&) const = default;
  };
  /// True: it is not as it was.
  bool control_is(const std::optional<Control>& control);
  [[nodiscard]] std::optional<Control> control() const;
  /// The daemon gave control to this session for that term.
  void won(const std::string& session, std::uint64_t term);
  [[nodiscard]] bool has_control(const std::string& session) const;
  /// The session that has control, if somebody looks at a page of it: the daemon is to be told that somebody is there.
  [[nodiscard]] std::optional<std::string> present_holder() const;
  /// Somebody looks at a page of this session.
  [[nodiscard]] bool is_present(const std::string& session) const;

  /// A page of this session is there, or gone.
  void connected(const std::string& session, bool there, Time now);
  /// Ends what has expired.
  void expire(Time now);

 private:
  struct Token {
    Who who;
    Time until;
  };
  struct Session {
    Who who;
    Time used;
    int pages = 0;
    std::uint64_t term = 0;  // of its control, now or once
  };
  void make_room(Time now);
  /// An open page is use: who looks on at a run of a day may pause it on the second morning.
  [[nodiscard]] bool has_ended(const Session& session, Time now) const;

  mutable std::mutex mutex_;  // tokens are minted by another thread
  Limits limits_;
  std::map<std::string, Token> tokens_;
  std::map<std::string, Session> sessions_;
  std::optional<Control> control_;
};

}  // namespace isorig::web
