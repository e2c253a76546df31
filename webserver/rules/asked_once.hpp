#pragma once
#include <chrono>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "webserver/rules/access.hpp"

namespace isorig::web {

/// The answer to a request of a page.
struct PageAnswer {
  int status = 0;
  std::string text;                     ///< JSON, or a run's own page
  std::shared_ptr<const void> place{};  ///< kept until it is sent: where there is room for one alone
};
using PageReply = std::function<void(PageAnswer)>;

/// What many pages may ask of the daemon: of each question one is under way at a time, whose answer is for all who
/// wait, and for who asks within `kKept` after it. The daemon answers with one thread, which a `start` waits for, too.
/// Asks for no time and does no I/O.
class AskedOnce {
 public:
  static constexpr std::chrono::seconds kKept{2};
  /// Asks the daemon; the answer has to be given to answered().
  using Ask = std::function<void(const std::string& what)>;
  explicit AskedOnce(Ask ask) : ask_(std::move(ask)) {}

  void get(const std::string& what, Time now, const PageReply& reply);
  void answered(const std::string& what, const PageAnswer& answer, Time now);
  /// Something has changed: who asks from now on gets no answer to a question of before.
  void forget();
  [[nodiscard]] std::size_t kept() const { return questions_.size(); }

 private:
  struct Question {
    bool under_way = false;
    bool stale = false;                    // was forgotten while under way
    std::vector<PageReply> waiting, next;  // `next` came after it was forgotten
    PageAnswer answer;
    Time until{};  // before which `answer` is good
  };
  Ask ask_;
  std::map<std::string, Question> questions_;  // under way, or answered within kKept
};

}  // namespace isorig::web
