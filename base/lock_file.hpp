#pragma once
#include <filesystem>
#include <stdexcept>
#include <string>
#include <utility>

namespace isorig::base {

/// Why a LockFile could not be had. what() says it with the file's name, and what to do.
class LockError : public std::runtime_error {
 public:
  enum class Why {
    kHeld,        ///< somebody else has it: holder() says who
    kUnwritable,  ///< the file cannot be opened or made
    kNoLocks,     ///< the file system has none
  };
  LockError(Why why, const std::string& what, std::string holder = {})
      : std::runtime_error(what), why_(why), holder_(std::move(holder)) {}
  [[nodiscard]] Why why() const noexcept { return why_; }
  /// "process 1234 on host", for whoever has to look for it.
  [[nodiscard]] const std::string& holder() const noexcept { return holder_; }

 private:
  Why why_;
  std::string holder_;
};

/// What may be done once at a time in a folder, on whichever machine of a shared file system: flock(2) on a file that
/// says who has it. Free when this ends, also by SIGKILL; the file stays.
class LockFile {
 public:
  enum class Shared { kNo, kYes };
  /// Does not wait. Throws LockError. Of several that share it, the file names the last that began.
  explicit LockFile(const std::filesystem::path& file, Shared shared = Shared::kNo);
  ~LockFile();
  LockFile(const LockFile&) = delete;
  LockFile& operator=(const LockFile&) = delete;

 private:
  int fd_ = -1;
};

/// A folder that results go into, for one command at a time: flock(2) on the folder itself, so that nothing of it
/// stays. Makes the folder, and takes it away again if it is empty at the end. Where the file system has no locks for
/// folders it goes without.
class FolderLock {
 public:
  /// Does not wait. Throws LockError: kHeld, kUnwritable.
  explicit FolderLock(std::filesystem::path folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  std::filesystem::path folder_;
  bool made_ = false;
  int fd_ = -1;
};

/// Of this machine, for whoever looks where a file comes from.
[[nodiscard]] std::string host_name();

}  // namespace isorig::base
