#include "webserver/rules/saved_protocols.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <system_error>
#include <utility>

#include "base/beneath.hpp"
#include "base/fingerprint.hpp"
#include "base/printable.hpp"
#include "webserver/rules/requests.hpp"

namespace isorig::web {
namespace {

using Saved = SavedProtocols::Saved;

std::string errno_text() {
  return std::generic_category().message(errno);
}

constexpr const char* kAside = ".saving-";

/// A file under a name of its own that goes with this object, synced: half a protocol must not stand where a whole one
/// is looked for.
class Aside {
 public:
  Aside(const std::filesystem::path& folder, const std::string& text) {
    // Not mkstemp: its files are 0600, and the umask that others are due is for the kernel to apply.
    for (int n = 0; n < kTries && fd_ < 0; ++n) {
      path_ = (folder / (kAside + std::to_string(::getpid()) + "-" + std::to_string(n))).string();
      fd_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
      if (fd_ < 0 && errno != EEXIST) break;
    }
    if (fd_ < 0) {
      why_ = errno_text();
      path_.clear();
      return;
    }
    for (std::size_t at = 0; at < text.size() && why_.empty();) {
      const auto n = ::write(fd_, text.data() + at, text.size() - at);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) why_ = errno_text();
      at += n < 0 ? 0 : static_cast<std::size_t>(n);
    }
    if (why_.empty() && ::fsync(fd_) != 0) why_ = errno_text();
  }
  ~Aside() {
    if (fd_ >= 0) ::close(fd_);
    if (!path_.empty()) ::unlink(path_.c_str());
  }
  Aside(const Aside&) = delete;
  Aside& operator=(const Aside&) = delete;

  [[nodiscard]] const std::string& why() const { return why_; }  ///< empty: it is there
  [[nodiscard]] const std::string& path() const { return path_; }
  /// 0, or -1 with errno. Afterwards there is nothing to remove.
  [[nodiscard]] int rename_to(const std::filesystem::path& name) {
    if (::rename(path_.c_str(), name.c_str()) != 0) return -1;
    path_.clear();
    return 0;
  }

 private:
  static constexpr int kTries = 100;
  std::string path_, why_;
  int fd_ = -1;
};

/// What a process that was killed has left aside. Another one may be saving in the same folder.
void remove_left_aside(const std::filesystem::path& folder) {
  const auto long_ago = std::filesystem::file_time_type::clock::now() - std::chrono::hours(1);
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    std::error_code ignored;
    if (!at->path().filename().string().starts_with(kAside) || !at->is_regular_file(ignored)) continue;
    const auto written = at->last_write_time(ignored);
    if (!ignored && written < long_ago) std::filesystem::remove(at->path(), ignored);
  }
}

std::optional<SavedProtocols::Protocol> protocol_at(const std::filesystem::path& file) {
  try {
    // A link in the folder leads to what is not its.
    auto text = base::read_text_beneath(file.parent_path(), file.filename(), SavedProtocols::kBytes + 1);
    if (text.size() > SavedProtocols::kBytes) return std::nullopt;
    auto version = base::fingerprint(text);
    return SavedProtocols::Protocol{std::move(text), std::move(version)};
  } catch (const base::FileError&) {
    return std::nullopt;
  }
}

Saved failed(const std::filesystem::path& file) {
  return {Saved::Is::kFailed, file.string() + ": " + errno_text(), {}};
}
Saved changed(const std::string& name, std::string version) {
  return {Saved::Is::kThereAlready, name + " was changed by somebody else since it was opened here",
          std::move(version)};
}

int swap_names(const std::string& one, const std::string& other) {
  return ::renameat2(AT_FDCWD, one.c_str(), AT_FDCWD, other.c_str(), RENAME_EXCHANGE);
}

void sync_folder(const std::filesystem::path& folder) {
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  (void)::fsync(fd);
  ::close(fd);
}

}  // namespace

std::vector<std::string> toml_files(const std::filesystem::path& folder, bool with_links) {
  std::vector<std::string> out;
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    const auto name = at->path().filename().string();
    std::error_code ignored;
    if (is_plain_toml_name(name) && at->is_regular_file(ignored) && (with_links || !at->is_symlink(ignored)))
      out.push_back(name);
  }
  std::sort(out.begin(), out.end());
  return out;
}

std::optional<SavedProtocols::Protocol> SavedProtocols::read(const std::string& name) const {
  if (folder_.empty() || !is_plain_toml_name(name)) return std::nullopt;
  return protocol_at(folder_ / name);
}

Saved SavedProtocols::replace(const std::string& name, const std::string& text, const std::string& replaces) const {
  const auto target = folder_ / name, before = folder_ / (name + "~");
  Aside aside(folder_, text);
  if (!aside.why().empty()) return {Saved::Is::kFailed, folder_.string() + ": " + aside.why(), {}};
  // Exchanged first and looked at then: nobody's edit gets in between. A hard link to the old one would need its owner
  // (fs.protected_hardlinks), an exchange does not.
  if (swap_names(aside.path(), target.string()) == 0) {
    const auto was = protocol_at(aside.path());
    if (!was || was->version != replaces) {
      if (swap_names(aside.path(), target.string()) != 0) return failed(target);
      return changed(name, was ? was->version : "");
    }
    if (aside.rename_to(before) != 0) return failed(before);
  } else if (errno == ENOENT) {
    return changed(name, "");
  } else if (errno == EINVAL || errno == ENOSYS) {  // NFS cannot exchange
    const auto was = protocol_at(target);
    if (!was || was->version != replaces) return changed(name, was ? was->version : "");
    Aside old(folder_, was->text);
    if (!old.why().empty()) return {Saved::Is::kFailed, folder_.string() + ": " + old.why(), {}};
    if (old.rename_to(before) != 0) return failed(before);
    if (aside.rename_to(target) != 0) return failed(target);
  } else {
    return failed(target);
  }
  sync_folder(folder_);
  return {Saved::Is::kDone, name + " saved in " + folder_.string() + "; the one before is " + name + "~",
          base::fingerprint(text)};
}

Saved SavedProtocols::save(const std::string& name, const std::string& text, const std::string& replaces) const {
  using Is = Saved::Is;
  if (folder_.empty())
    return {Is::kRefused, "there is no folder to save protocols in: isorig-web --saved-protocols DIR", {}};
  if (!is_plain_toml_name(name)) {
    return {
        Is::kRefused,
        "\"" + base::printable(name) +
            "\" is no name for a protocol: letters, digits, - _ and ., not first a dot, at most 128, .toml at the end",
        {}};
  }
  if (text.size() > kBytes) return {Is::kRefused, "a protocol may have 1 MiB", {}};
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error) return {Is::kFailed, folder_.string() + ": " + error.message(), {}};
  const auto target = folder_ / name;
  const auto now = read(name);
  const bool there = std::filesystem::exists(std::filesystem::symlink_status(target, error));
  if (there && !now) {
    return {Is::kRefused,
            target.string() + " is there already and cannot be read as a protocol; save it by another name",
            {}};
  }
  if (there && now->text == text) {
    return {Is::kDone, name + " is saved in " + folder_.string() + " already", now->version};
  }
  if (there && now->version != replaces) {
    if (!replaces.empty()) return changed(name, now->version);
    return {Is::kThereAlready, "there is a protocol " + name + " already", now->version};
  }
  if (!there && toml_files(folder_, false).size() >= kFiles) {
    return {Is::kRefused, folder_.string() + " holds " + std::to_string(kFiles) + " protocols; remove some", {}};
  }
  remove_left_aside(folder_);
  if (there) return replace(name, text, replaces);
  const Aside aside(folder_, text);
  if (!aside.why().empty()) return {Is::kFailed, folder_.string() + ": " + aside.why(), {}};
  if (::link(aside.path().c_str(), target.c_str()) != 0) {  // never over one that has come since
    if (errno != EEXIST) return failed(target);
    const auto other = read(name);
    return {Is::kThereAlready, "there is a protocol " + name + " already", other ? other->version : ""};
  }
  sync_folder(folder_);
  return {Is::kDone, name + " saved in " + folder_.string(), base::fingerprint(text)};
}

}  // namespace isorig::web
