#include "webserver/rules/access.hpp"

#include <sys/random.h>

#include <array>
#include <cerrno>
#include <system_error>
#include <utility>

namespace isorig::web {

std::string random_secret() {
  std::array<unsigned char, 32> bytes{};
  // Up to 256 bytes come whole, once the kernel has collected enough (getrandom(2)).
  if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    throw std::system_error(errno, std::generic_category(), "no random numbers");
  }
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string out;
  for (const auto b : bytes) {
    out += kDigits[b >> 4U];
    out += kDigits[b & 15U];
  }
  return out;
}

std::string Access::mint(const Who& who, Time now) {
  const std::lock_guard lock(mutex_);
  std::erase_if(tokens_, [&](const auto& t) { return t.second.until <= now; });
  if (tokens_.size() >= limits_.tokens) {
    throw TooMany("there are " + std::to_string(tokens_.size()) +
                  " links that nobody has opened yet; open one, or wait " + std::to_string(limits_.token.count()) +
                  " s");
  }
  auto token = random_secret();
  tokens_[token] = {who, now + limits_.token};
  return token;
}

std::optional<std::string> Access::redeem(const std::string& token, Time now) {
  const std::lock_guard lock(mutex_);
  const auto found = tokens_.find(token);
  if (found == tokens_.end()) return std::nullopt;
  if (found->second.until <= now) {
    tokens_.erase(found);
    return std::nullopt;
  }
  make_room(now);
  const auto given = found->second;
  tokens_.erase(found);
  auto session = random_secret();
  auto who = given.who;
  who.page = random_secret().substr(0, 16);
  sessions_[session] = {std::move(who), now, 0, 0};
  return session;
}

void Access::make_room(Time now) {
  std::erase_if(sessions_, [&](const auto& s) { return has_ended(s.second, now); });
  if (sessions_.size() < limits_.sessions) return;
  auto longest = sessions_.end();
  for (auto at = sessions_.begin(); at != sessions_.end(); ++at) {
    if (at->second.pages == 0 && (longest == sessions_.end() || at->second.used < longest->second.used)) longest = at;
  }
  if (longest == sessions_.end()) {
    throw TooMany("there are " + std::to_string(sessions_.size()) +
                  " sessions, and a page of each is open; leave one first");
  }
  sessions_.erase(longest);
}

std::optional<Who> Access::who(const std::string& session, Time now) {
  const std::lock_guard lock(mutex_);
  const auto found = sessions_.find(session);
  if (found == sessions_.end() || has_ended(found->second, now)) return std::nullopt;
  found->second.used = now;
  return found->second.who;
}

void Access::leave(const std::string& session) {
  const std::lock_guard lock(mutex_);
  sessions_.erase(session);
}

bool Access::control_is(const std::optional<Control>& control) {
  const std::lock_guard lock(mutex_);
  const bool changed = control_ != control;
  control_ = control;
  return changed;
}

std::optional<Access::Control> Access::control() const {
  const std::lock_guard lock(mutex_);
  return control_;
}

void Access::won(const std::string& session, std::uint64_t term) {
  const std::lock_guard lock(mutex_);
  if (const auto found = sessions_.find(session); found != sessions_.end()) found->second.term = term;
}

bool Access::has_control(const std::string& session) const {
  const std::lock_guard lock(mutex_);
  const auto found = sessions_.find(session);
  return control_ && found != sessions_.end() && found->second.term == control_->term;
}

std::optional<std::string> Access::present_holder() const {
  const std::lock_guard lock(mutex_);
  if (!control_) return std::nullopt;
  for (const auto& [secret, session] : sessions_) {
    if (session.term == control_->term && session.pages > 0) return secret;
  }
  return std::nullopt;
}

bool Access::is_present(const std::string& session) const {
  const std::lock_guard lock(mutex_);
  const auto found = sessions_.find(session);
  return found != sessions_.end() && found->second.pages > 0;
}

void Access::connected(const std::string& session, bool there, Time now) {
  const std::lock_guard lock(mutex_);
  const auto found = sessions_.find(session);
  if (found == sessions_.end()) return;
  found->second.pages += there ? 1 : -1;
  found->second.used = now;
}

void Access::expire(Time now) {
  const std::lock_guard lock(mutex_);
  std::erase_if(tokens_, [&](const auto& t) { return t.second.until <= now; });
  std::erase_if(sessions_, [&](const auto& s) { return has_ended(s.second, now); });
}

bool Access::has_ended(const Session& session, Time now) const {
  return session.pages == 0 && now - session.used > limits_.session;
}

}  // namespace isorig::web
