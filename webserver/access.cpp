#include "webserver/access.hpp"

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
  const auto given = found->second;
  tokens_.erase(found);
  if (given.until <= now) return std::nullopt;
  if (sessions_.size() >= limits_.sessions) {
    throw TooMany("there are " + std::to_string(sessions_.size()) + " sessions; leave one first");
  }
  auto session = random_secret();
  sessions_[session] = {given.who, now, 0, now};
  return session;
}

std::optional<Who> Access::who(const std::string& session, Time now) {
  const std::lock_guard lock(mutex_);
  const auto found = sessions_.find(session);
  if (found == sessions_.end() || now - found->second.used > limits_.session) return std::nullopt;
  found->second.used = now;
  return found->second.who;
}

void Access::leave(const std::string& session) {
  const std::lock_guard lock(mutex_);
  sessions_.erase(session);
  if (lease_ && lease_->session == session) lease_.reset();
}

Access::Taken Access::take(const std::string& session, bool over, Time now) {
  const std::lock_guard lock(mutex_);
  const auto found = sessions_.find(session);
  if (found == sessions_.end()) return {false, "this page is view only: isorig web gives a link that may control", ""};
  if (lease_ && lease_->session == session) return {true, "control is held here already", ""};
  if (lease_ && !over) return {false, lease_->who.name + " has control; take it over if that is agreed", ""};
  Taken taken{true, "control is held by " + found->second.who.name, lease_ ? lease_->who.name : ""};
  lease_ = Lease{session, found->second.who, now};
  return taken;
}

bool Access::give_back(const std::string& session) {
  const std::lock_guard lock(mutex_);
  if (!lease_ || lease_->session != session) return false;
  lease_.reset();
  return true;
}

bool Access::has_control(const std::string& session) const {
  const std::lock_guard lock(mutex_);
  return lease_ && !session.empty() && lease_->session == session;
}

std::optional<Access::Lease> Access::lease() const {
  const std::lock_guard lock(mutex_);
  return lease_;
}

void Access::connected(const std::string& session, bool there, Time now) {
  const std::lock_guard lock(mutex_);
  const auto found = sessions_.find(session);
  if (found == sessions_.end()) return;
  found->second.pages += there ? 1 : -1;
  found->second.used = found->second.last_page = now;
}

std::optional<Who> Access::expire(Time now) {
  const std::lock_guard lock(mutex_);
  std::erase_if(tokens_, [&](const auto& t) { return t.second.until <= now; });
  std::erase_if(sessions_, [&](const auto& s) { return s.second.pages == 0 && now - s.second.used > limits_.session; });
  if (!lease_) return std::nullopt;
  const auto holder = sessions_.find(lease_->session);
  const bool there =
      holder != sessions_.end() && (holder->second.pages > 0 || now - holder->second.last_page <= limits_.absence);
  if (there) return std::nullopt;
  return std::exchange(lease_, std::nullopt)->who;
}

}  // namespace isorig::web
