#pragma once
#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <map>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>

/// Who may do what on the page: nobody without a session, which begins with a one-time token that was asked for over a
/// Unix socket; of those one has control at a time. Asks for no time and does no I/O but for the random numbers.
namespace isorig::web {

using Time = std::chrono::steady_clock::time_point;

struct Who {
  std::string name;
  uid_t uid = 0;
};

/// 256 bits of the kernel's random numbers, as 64 hexadecimal digits. Throws std::system_error.
[[nodiscard]] std::string random_secret();

class Access {
 public:
  struct Limits {
    std::chrono::seconds token{120};   ///< a token that nobody used by then is void
    std::chrono::hours session{12};    ///< a session that nobody used for so long has ended
    std::chrono::seconds absence{60};  ///< a holder whose page is gone for so long loses control
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
  /// A session for a token that is valid; the token is void then. Throws TooMany.
  [[nodiscard]] std::optional<std::string> redeem(const std::string& token, Time now);
  /// Whose session it is, and that it is used.
  [[nodiscard]] std::optional<Who> who(const std::string& session, Time now);
  /// Ends a session; control that it had is given back.
  void leave(const std::string& session);

  struct Lease {
    std::string session;  ///< secret
    Who who;
    Time since;
  };
  struct Taken {
    bool ok = false;
    std::string text;        ///< for people
    std::string taken_from;  ///< the name of the holder until now
  };
  /// Control for this session: if nobody else has it, or with `over` from who has it.
  [[nodiscard]] Taken take(const std::string& session, bool over, Time now);
  /// True if it had control.
  bool give_back(const std::string& session);
  [[nodiscard]] bool has_control(const std::string& session) const;
  [[nodiscard]] std::optional<Lease> lease() const;

  /// A page of this session is there, or gone.
  void connected(const std::string& session, bool there, Time now);
  /// Ends what has expired. The holder whose control ended with it, if any.
  std::optional<Who> expire(Time now);

 private:
  struct Token {
    Who who;
    Time until;
  };
  struct Session {
    Who who;
    Time used;
    int pages = 0;
    Time last_page;
  };

  mutable std::mutex mutex_;  // tokens are minted by another thread
  Limits limits_;
  std::map<std::string, Token> tokens_;
  std::map<std::string, Session> sessions_;
  std::optional<Lease> lease_;
};

}  // namespace isorig::web
