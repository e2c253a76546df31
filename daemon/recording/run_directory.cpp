#include "daemon/recording/run_directory.hpp"

#include <fcntl.h>
#include <sys/statvfs.h>
#include <toml++/toml.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <sstream>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <utility>

#include "messages/channels.hpp"

namespace isorig::daemon {
namespace {

std::filesystem::path lock_file(const std::filesystem::path& run_dir) {
  return run_dir / ".lock";
}

/// On the disk when it returns: a power cut must not leave an empty file under a run that is there.
void write_file(const std::filesystem::path& path, const std::string& text) {
  const auto fail = [&] { throw std::runtime_error("cannot write " + path.string() + ": " + std::strerror(errno)); };
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0644);
  if (fd < 0) fail();
  const struct Close {
    int fd;
    ~Close() { ::close(fd); }
  } close{fd};
  for (std::size_t done = 0; done < text.size();) {
    const auto n = ::write(fd, text.data() + done, text.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) fail();
    done += static_cast<std::size_t>(n);
  }
  if (::fsync(fd) != 0) fail();
}

}  // namespace

std::string why_not_writable(const std::filesystem::path& directory) {
  std::error_code failed;
  std::filesystem::create_directories(directory, failed);
  if (failed) return failed.message();
  // Without a name where the file system can do that: then nobody ever sees it, whatever kills us.
  int fd = ::open(directory.c_str(), O_WRONLY | O_TMPFILE | O_CLOEXEC, 0600);
  if (fd < 0 && (errno == EOPNOTSUPP || errno == EISDIR)) {
    std::string name = (directory / ".write-test-XXXXXX").string();
    fd = ::mkostemp(name.data(), O_CLOEXEC);
    if (fd >= 0) ::unlink(name.c_str());
  }
  if (fd < 0) return std::strerror(errno);
  constexpr std::string_view kSome = "isorig";
  const auto written = ::write(fd, kSome.data(), kSome.size());
  const bool whole = written == static_cast<ssize_t>(kSome.size()) && ::fsync(fd) == 0;
  std::string why;
  if (!whole) why = written >= 0 && written < static_cast<ssize_t>(kSome.size()) ? "no room" : std::strerror(errno);
  ::close(fd);
  return why;
}

std::uint64_t free_bytes(const std::filesystem::path& path) {
  struct statvfs s {};
  if (::statvfs(path.c_str(), &s) != 0) {
    throw std::system_error(errno, std::generic_category(), "cannot ask for the free space of " + path.string());
  }
  return std::uint64_t{s.f_bavail} * s.f_frsize;
}

void sync_directory(const std::filesystem::path& directory) {
  const int fd = ::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  ::fsync(fd);
  ::close(fd);
}

isorig_msgs::run_header_t make_header(const RunInfo& info, const RecorderOptions& options, std::int32_t attempt) {
  isorig_msgs::run_header_t h{};
  h.format = std::string(messages::kLogFormat);
  h.attempt = attempt;
  h.epoch_unix_us = info.epoch_unix_us;
  h.virtual_time = info.virtual_time ? 1 : 0;
  h.seed = info.seed;
  h.rig = info.rig;
  h.specimen = info.specimen;
  h.rest_length_mm = info.rest_length_mm;
  h.plan_summary = info.plan_summary;
  h.average_interval_s = options.average_interval_s;
  h.before_s = options.before_s;
  const auto copy = [](const auto& from, auto& to, std::int32_t& count) {
    for (const auto& [name, text] : from) {
      isorig_msgs::named_text_t t;
      t.name = name;
      t.text = text;
      to.push_back(std::move(t));
    }
    count = static_cast<std::int32_t>(to.size());
  };
  auto texts = info.texts;
  if (!info.operator_name.empty()) texts.emplace_back("operator", info.operator_name);
  copy(texts, h.texts, h.text_count);
  copy(info.versions, h.versions, h.version_count);
  // A run without sessions is one.
  for (const auto& s : info.sessions.empty() ? std::vector<SessionInfo>{SessionInfo{}} : info.sessions) {
    isorig_msgs::session_t m{};
    m.session = static_cast<std::int32_t>(h.sessions.size());
    m.first_step = static_cast<std::int32_t>(s.first_step);
    m.repetition = s.repetition;
    m.pressure_psi = s.pressure_psi;
    m.pressurized_rest_length_mm = s.pressurized_rest_length_mm;
    h.sessions.push_back(m);
  }
  h.session_count = static_cast<std::int32_t>(h.sessions.size());
  return h;
}

void write_inputs(const std::filesystem::path& run_dir, const RunInfo& info) {
  toml::table versions;
  for (const auto& [name, version] : info.versions) versions.insert_or_assign(name, version);
  const toml::table run{
      {"format", "isorig-run/1"},
      {"run", info.run_id},
      {"started_utc", info.started_utc},
      {"operator", info.operator_name},
      {"rig", info.rig},
      {"specimen", info.specimen},
      {"rest_length_mm", info.rest_length_mm},
      {"seed", info.seed},
      {"virtual_time", info.virtual_time},
      {"sessions", static_cast<std::int64_t>(info.sessions.size())},
      {"plan", info.plan_summary},
      {"versions", versions},
  };
  std::ostringstream text;
  text << run << "\n";
  write_file(run_dir / "run.toml", text.str());
  std::filesystem::create_directories(run_dir / "inputs");
  for (const auto& [name, content] : info.texts) {
    // A name from a config must not lead out of the directory.
    write_file(run_dir / "inputs" / std::filesystem::path(name).filename(), content);
  }
  sync_directory(run_dir / "inputs");
  sync_directory(run_dir);
  sync_directory(run_dir.parent_path());
}

Reserve::Reserve(std::filesystem::path file, std::uint64_t bytes) : file_(std::move(file)), bytes_(bytes) {}

Reserve::~Reserve() {
  release();
}

bool Reserve::allocate() {
  if (held_ || bytes_ == 0) return held_;
  const int fd = ::open(file_.c_str(), O_WRONLY | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0644);
  if (fd < 0) return false;
  // Not posix_fallocate: where a file system cannot do it, glibc writes zeros, which may take long.
  held_ = ::fallocate(fd, 0, 0, static_cast<off_t>(bytes_)) == 0;
  ::close(fd);
  if (!held_) ::unlink(file_.c_str());
  return held_;
}

bool Reserve::release() noexcept {
  if (!held_) return false;
  held_ = false;
  return ::unlink(file_.c_str()) == 0;
}

void remove_stale_reserve(const std::filesystem::path& run_dir) noexcept {
  std::error_code none;
  const auto file = run_dir / kReserveName;
  if (!std::filesystem::exists(file, none)) return;
  try {
    const RunLock mine(run_dir);  // a recorder that begins here at this moment keeps its own
    std::filesystem::remove(file, none);
  } catch (const std::exception&) {  // it is being written
  }
}

// Locks of the open file description: they go with the process, whatever kills it, and can be asked for
// without taking them (asking must not make a daemon's start fail).
RunLock::RunLock(const std::filesystem::path& run_dir) {
  const auto path = lock_file(run_dir);
  fd_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0644);
  if (fd_ < 0) throw std::runtime_error("cannot open " + path.string() + ": " + std::strerror(errno));
  struct flock whole {};
  whole.l_type = F_WRLCK;
  whole.l_whence = SEEK_SET;
  if (::fcntl(fd_, F_OFD_SETLK, &whole) != 0) {
    ::close(fd_);
    throw std::runtime_error(run_dir.string() +
                             " is being written by another process; `isorig status` asks the "
                             "daemon what it does");
  }
}

RunLock::~RunLock() {
  ::close(fd_);
}

bool RunLock::is_held(const std::filesystem::path& run_dir) {
  const int fd = ::open(lock_file(run_dir).c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
  if (fd < 0) return false;
  struct flock whole {};
  whole.l_type = F_RDLCK;
  whole.l_whence = SEEK_SET;
  const bool held = ::fcntl(fd, F_OFD_GETLK, &whole) == 0 && whole.l_type != F_UNLCK;
  ::close(fd);
  return held;
}

bool RunLock::can_tell(const std::filesystem::path& run_dir) {
  std::error_code error;
  if (!std::filesystem::is_directory(run_dir, error)) return false;
  const auto lock = lock_file(run_dir);
  return ::access(lock.c_str(), R_OK) == 0 || errno == ENOENT;
}

}  // namespace isorig::daemon
