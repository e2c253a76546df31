#include "daemon/host/audit_log.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <map>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "base/formatted.hpp"
#include "base/text_file.hpp"
#include "base/utc_text.hpp"

namespace isorig::daemon {
namespace {

using nlohmann::json;

constexpr const char* kFile = "commands.jsonl";
constexpr const char* kNumbered = "commands-";
constexpr const char* kEnding = ".jsonl";
constexpr auto kTryAgain = std::chrono::seconds(1);
constexpr std::size_t kTailBytes = std::size_t{64} << 10U;  // longer than any line

std::string utc_with_ms(std::int64_t unix_ms) {
  return base::utc_text(unix_ms / 1000, "%Y-%m-%dT%H:%M:%S") +
         base::formatted(".%03dZ", static_cast<int>(unix_ms % 1000));
}

json who_json(const Peer& peer) {
  return {{"uid", peer.uid}, {"gid", peer.gid}, {"groups", peer.groups}};
}

/// The files with a number, oldest first.
std::map<std::uint64_t, std::string> numbered_files(const std::filesystem::path& folder) {
  std::map<std::uint64_t, std::string> out;
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    const auto name = at->path().filename().string();
    if (!name.starts_with(kNumbered) || !name.ends_with(kEnding)) continue;
    const auto digits =
        name.substr(std::strlen(kNumbered), name.size() - std::strlen(kNumbered) - std::strlen(kEnding));
    if (digits.empty() || digits.size() > 12 || digits.find_first_not_of("0123456789") != std::string::npos) continue;
    out[std::stoull(digits)] = name;
  }
  return out;
}

std::string numbered(std::uint64_t number) {
  return base::formatted("%s%06llu%s", kNumbered, static_cast<unsigned long long>(number), kEnding);
}

/// The number of the last whole line in `text`; 0: there is none.
std::uint64_t last_number(const std::string& text) {
  std::uint64_t last = 0;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const auto entry = json::parse(line, nullptr, false);
    if (!entry.is_object()) continue;
    const auto number = entry.find("number");
    if (number != entry.end() && number->is_number_unsigned()) last = std::max(last, number->get<std::uint64_t>());
  }
  return last;
}

/// What moves the rig has a line each time.
bool may_be_counted(const AuditEntry& e) {
  return e.status != 200 || e.verb == "abort" || e.verb == "pause";
}

bool is_repetition(const AuditEntry& before, const AuditEntry& e) {
  const auto for_uid = [](const AuditEntry& of) { return of.for_whom ? of.for_whom->uid : Peer::kUnknown; };
  return may_be_counted(e) && before.peer.uid == e.peer.uid && for_uid(before) == for_uid(e) && before.verb == e.verb &&
         before.status == e.status && before.outcome == e.outcome;
}

}  // namespace

std::filesystem::path audit_folder_of(const std::filesystem::path& runs_root) {
  return runs_root / "audit";
}

AuditLog::AuditLog(const std::filesystem::path& runs_root, std::function<void(const std::string&)> trouble)
    : AuditLog(runs_root, std::move(trouble), Limits()) {}

AuditLog::AuditLog(const std::filesystem::path& runs_root, std::function<void(const std::string&)> trouble,
                   const Limits& limits)
    : folder_(audit_folder_of(runs_root)), trouble_(std::move(trouble)), limits_(limits) {}

AuditLog::~AuditLog() {
  finish();
  close_file();
}

bool AuditLog::add(AuditEntry entry) {
  bool repeated = false;
  {
    const std::lock_guard lock(mutex_);
    const bool soon = repeats_ > 0 || std::chrono::steady_clock::now() - last_put_ < limits_.repeats;
    repeated = soon && last_ && is_repetition(*last_, entry);
    if (repeated) {
      ++repeats_;
    } else {
      put_repeats();
      put(entry, 1);
    }
    last_ = std::move(entry);
  }
  more_.notify_one();
  return !repeated;
}

void AuditLog::put(const AuditEntry& entry, std::uint64_t count) {
  last_put_ = std::chrono::steady_clock::now();
  if (queue_.size() >= limits_.queued) {
    lost_ += count;
  } else {
    queue_.push_back({entry, std::exchange(lost_, 0), count});
  }
}

void AuditLog::put_repeats() {
  if (repeats_ > 0) put(*last_, std::exchange(repeats_, 0));
}

void AuditLog::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  more_.notify_all();
}

void AuditLog::run() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    more_.wait(lock, [this] { return stopping_ || !queue_.empty() || repeats_ > 0; });
    if (queue_.empty()) {
      more_.wait_until(lock, last_put_ + limits_.repeats, [this] { return stopping_ || !queue_.empty(); });
      if (queue_.empty()) put_repeats();
      continue;
    }
    auto batch = std::exchange(queue_, {});
    lock.unlock();
    const bool written = write(batch);
    lock.lock();
    if (written) continue;
    // Kept for the next attempt, before what came meanwhile.
    queue_.insert(queue_.begin(), std::make_move_iterator(batch.begin()), std::make_move_iterator(batch.end()));
    more_.wait_for(lock, kTryAgain, [this] { return stopping_; });
  }
}

void AuditLog::finish() {
  std::deque<Queued> batch;
  {
    const std::lock_guard lock(mutex_);
    put_repeats();
    batch = std::exchange(queue_, {});
  }
  if (!batch.empty()) (void)write(batch);
}

bool AuditLog::failed(const std::string& what, const std::string& why) {
  const auto told =
      (folder_ / kFile).string() + " " + what + ": " + why + "; commands are kept in memory and written when it can be";
  if (told != told_ && trouble_) trouble_(told);
  told_ = told;
  close_file();
  return false;
}

bool AuditLog::failed(const std::string& what, int error) {
  return failed(what, std::string(std::strerror(error)));
}

void AuditLog::close_file() {
  if (fd_ >= 0) ::close(fd_);
  if (folder_fd_ >= 0) ::close(folder_fd_);
  fd_ = folder_fd_ = -1;
}

/// No link is followed: neither the folder nor the file may be one.
bool AuditLog::open_file() {
  if (fd_ >= 0) return true;
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  folder_fd_ = ::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  // Why the folder could not be made, not that it is not there.
  if (folder_fd_ < 0) return failed("cannot be made", errno == ENOENT && error ? error.value() : errno);
  fd_ = ::openat(folder_fd_, kFile, O_RDWR | O_APPEND | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0644);
  struct stat status {};
  if (fd_ < 0 || ::fstat(fd_, &status) != 0) return failed("cannot be opened", errno);
  if (!S_ISREG(status.st_mode)) return failed("is no file", EINVAL);
  bytes_ = static_cast<std::uint64_t>(status.st_size);
  const auto from = bytes_ > kTailBytes ? bytes_ - kTailBytes : 0;
  std::string tail(static_cast<std::size_t>(bytes_ - from), '\0');
  const auto got = ::pread(fd_, tail.data(), tail.size(), static_cast<off_t>(from));
  tail.resize(got < 0 ? 0 : static_cast<std::size_t>(got));
  auto last = last_number(tail);
  if (last == 0) {
    if (const auto older = numbered_files(folder_); !older.empty()) {
      try {
        last = last_number(base::read_text_file(folder_ / older.rbegin()->second));
      } catch (const base::FileError&) {  // its numbers begin anew
      }
    }
  }
  number_ = std::max(number_, last);
  // Of a power cut half a line may be left: the next one does not go on with it.
  if (!tail.empty() && tail.back() != '\n') {
    if (::write(fd_, "\n", 1) != 1) return failed("cannot be written", errno);
    ++bytes_;
  }
  return true;
}

bool AuditLog::rotate() {
  auto older = numbered_files(folder_);
  const auto name = numbered(older.empty() ? 1 : older.rbegin()->first + 1);
  // Never over one that is there.
  if (::renameat2(folder_fd_, kFile, folder_fd_, name.c_str(), RENAME_NOREPLACE) != 0)
    return failed("cannot be renamed", errno);
  older = numbered_files(folder_);
  while (older.size() > limits_.files) {
    (void)::unlinkat(folder_fd_, older.begin()->second.c_str(), 0);
    older.erase(older.begin());
  }
  (void)::fsync(folder_fd_);
  close_file();
  return open_file();
}

/// Lets no exception out: the thread that writes has other lines to write, and the way out other things to do.
bool AuditLog::write(const std::deque<Queued>& batch) {
  try {
    return write_lines(batch);
  } catch (const std::exception& e) {
    return failed("cannot be written", std::string(e.what()));
  }
}

/// Asked for once: the name service may be a server elsewhere.
std::string AuditLog::name_of(uid_t uid) {
  if (const auto known = names_.find(uid); known != names_.end()) return known->second;
  if (names_.size() >= kUserNamesKept) names_.clear();
  return names_[uid] = user_name(uid);
}

bool AuditLog::write_lines(const std::deque<Queued>& batch) {
  if (!open_file() || (bytes_ >= limits_.file_bytes && !rotate())) return false;
  std::string text;
  auto number = number_;
  for (const auto& [e, lost_before, count] : batch) {
    json line{{"number", ++number},
              {"utc", utc_with_ms(e.unix_ms)},
              {"verb", e.verb},
              {"arguments", e.arguments},
              {"user", name_of(e.peer.uid)},
              {"pid", e.peer.pid},
              {"ok", e.status == 200},
              {"status", e.status},
              {"outcome", e.outcome}};
    line.update(who_json(e.peer));
    if (e.for_whom) {
      line["for"] = who_json(*e.for_whom);
      line["for"]["user"] = name_of(e.for_whom->uid);
      line["for"]["name"] = e.for_name;
    }
    if (count > 1) line["count"] = count;
    if (lost_before > 0) line["lost_before"] = lost_before;
    text += line.dump(-1, ' ', false, json::error_handler_t::replace) + "\n";
  }
  // One write for all: a line is in one piece, unless the disk is full or the power goes.
  const auto written = ::write(fd_, text.data(), text.size());
  if (written != static_cast<ssize_t>(text.size())) {
    const int error = written < 0 ? errno : ENOSPC;
    // What of it is there would stand twice.
    if (written > 0) (void)::ftruncate(fd_, static_cast<off_t>(bytes_));
    return failed("cannot be written", error);
  }
  bytes_ += text.size();
  number_ = number;
  if (::fdatasync(fd_) != 0 && trouble_)
    trouble_((folder_ / kFile).string() + " is not on the disk: " + std::strerror(errno));
  told_.clear();
  return true;
}

std::vector<json> read_audit(const std::filesystem::path& runs_root, std::size_t most,
                             const std::function<void(double)>& on_progress) {
  const auto folder = audit_folder_of(runs_root);
  std::vector<std::string> names;
  for (const auto& [number, name] : numbered_files(folder)) names.push_back(name);
  names.emplace_back(kFile);
  std::vector<json> newest_first;
  for (auto name = names.rbegin(); name != names.rend() && newest_first.size() < most; ++name) {
    if (on_progress) on_progress(static_cast<double>(name - names.rbegin()) / static_cast<double>(names.size()));
    std::string text;
    try {
      text = base::read_text_file(folder / *name);
    } catch (const base::FileError& e) {
      if (e.missing() && names.size() > 1) continue;  // renamed a moment ago
      throw std::runtime_error(e.missing() ? "no command was ever given here: there is no " +
                                                 (folder / kFile).string() + "; name the place of the runs with --runs"
                                           : std::string(e.what()));
    }
    std::vector<json> lines;
    std::istringstream all(text);
    for (std::string line; std::getline(all, line);) {
      auto entry = json::parse(line, nullptr, false);
      if (entry.is_object() && entry.contains("verb")) lines.push_back(std::move(entry));
    }
    for (auto line = lines.rbegin(); line != lines.rend() && newest_first.size() < most; ++line)
      newest_first.push_back(std::move(*line));
  }
  std::reverse(newest_first.begin(), newest_first.end());
  return newest_first;
}

}  // namespace isorig::daemon
