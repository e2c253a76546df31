#include "webserver/rules/asked_once.hpp"

#include <utility>

namespace isorig::web {

void AskedOnce::get(const std::string& what, Time now, const PageReply& reply) {
  // Who may see is a question for each session: those of sessions that have gone are not kept.
  std::erase_if(questions_, [&](const auto& q) { return !q.second.under_way && now >= q.second.until; });
  Question& question = questions_[what];
  if (question.under_way) return (question.stale ? question.next : question.waiting).push_back(reply);
  if (now < question.until) return reply(question.answer);
  question.under_way = true;
  question.waiting.push_back(reply);
  ask_(what);
}

void AskedOnce::answered(const std::string& what, const PageAnswer& answer, Time now) {
  Question& question = questions_[what];
  const auto waiting = std::exchange(question.waiting, std::exchange(question.next, {}));
  const bool stale = std::exchange(question.stale, false);
  question.under_way = !question.waiting.empty();
  // A refusal is not kept: the daemon may be there again at once.
  if (!stale && answer.status == 200) {
    question.answer = answer;
    question.until = now + kKept;
  }
  if (question.under_way) ask_(what);
  for (const PageReply& reply : waiting) reply(answer);
}

void AskedOnce::forget() {
  for (auto& [what, question] : questions_) {
    question.until = {};
    question.stale = question.under_way;
  }
}

}  // namespace isorig::web
