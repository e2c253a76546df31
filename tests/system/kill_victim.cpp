// `isorig run` on the simulated rig as kill_test.cpp and power_cut_test.cpp need it:
//
//   kill_victim PROTOCOL RIG RUNS CLOCK [TRACE]
//
// CLOCK, mapped, holds the rig's time and outlives a SIGKILL; TRACE gets what is done to segments on its way to the
// disk: every write with its bytes, every sync that has succeeded, in their order (write_trace.hpp). A CLOCK that is a
// block device gets the rig's time into its last sector, past all caches, so that it is in the order of the disk's
// writes.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string>

#include "base/text_file.hpp"
#include "daemon/host/virtual_run.hpp"
#include "messages/segment_files.hpp"
#include "write_trace.hpp"

namespace {

using isorig::system_test::TraceEntry;

int trace_fd = -1;
volatile std::int64_t* rig_ns = nullptr;

template <typename Function>
Function* really(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

std::filesystem::path path_of(int fd) {
  std::error_code none;
  return std::filesystem::read_symlink("/proc/self/fd/" + std::to_string(fd), none);
}

/// The number of the segment that a descriptor is of; 0 for any other file.
int segment_of(int fd) {
  return trace_fd < 0 || fd == trace_fd ? 0 : isorig::messages::segment_number(path_of(fd));
}

void note(TraceEntry::Kind kind, int segment, std::uint64_t offset, const void* bytes, std::uint64_t size) {
  static auto* const write_really = really<ssize_t(int, const void*, std::size_t)>("write");
  const TraceEntry entry{kind, segment, *rig_ns, offset, size};
  if (write_really(trace_fd, &entry, sizeof entry) != static_cast<ssize_t>(sizeof entry) ||
      (bytes != nullptr && write_really(trace_fd, bytes, size) != static_cast<ssize_t>(size))) {
    std::fputs("kill_victim: the trace cannot be written\n", stderr);
    ::_exit(3);
  }
}

/// The last sector of a disk, written in order with what a file system on it writes: a write is done before the run
/// goes on.
class DiskClock {
 public:
  explicit DiskClock(int fd) : fd_(fd), at_(::lseek(fd, 0, SEEK_END) - static_cast<off_t>(sizeof sector_)) {}
  void set(std::int64_t now_ns) {
    if (now_ns - written_ns_ < kEvery_ns) return;
    written_ns_ = now_ns;
    std::memcpy(sector_, &now_ns, sizeof now_ns);
    if (::pwrite(fd_, sector_, sizeof sector_, at_) == static_cast<ssize_t>(sizeof sector_)) return;
    std::perror("kill_victim: the clock's sector");
    ::_exit(3);
  }

 private:
  static constexpr std::int64_t kEvery_ns = 100'000'000;
  int fd_;
  off_t at_;
  std::int64_t written_ns_ = -kEvery_ns;
  alignas(4096) char sector_[512] = {};  // O_DIRECT takes aligned memory alone
};

}  // namespace

// In place of libc's: messages/log_writer.cpp is linked into this program.
extern "C" ssize_t write(int fd, const void* bytes, std::size_t size) {
  static auto* const write_really = really<ssize_t(int, const void*, std::size_t)>("write");
  const int segment = segment_of(fd);
  const auto offset = segment > 0 ? ::lseek(fd, 0, SEEK_CUR) : 0;
  const auto written = write_really(fd, bytes, size);
  if (segment > 0 && written > 0)
    note(TraceEntry::Kind::kWrite, segment, static_cast<std::uint64_t>(offset), bytes,
         static_cast<std::uint64_t>(written));
  return written;
}

extern "C" int fdatasync(int fd) {
  static auto* const fdatasync_really = really<int(int)>("fdatasync");
  const int result = fdatasync_really(fd);
  if (const int segment = segment_of(fd); segment > 0 && result == 0)
    note(TraceEntry::Kind::kSync, segment, 0, nullptr, 0);
  return result;
}

extern "C" int fsync(int fd) {
  static auto* const fsync_really = really<int(int)>("fsync");
  const int result = fsync_really(fd);
  const auto path = path_of(fd);
  if (trace_fd >= 0 && result == 0 && std::filesystem::is_directory(path)) {
    const auto segments = isorig::messages::list_segments(path);
    if (!segments.empty())
      note(TraceEntry::Kind::kNames, isorig::messages::segment_number(segments.back()), 0, nullptr, 0);
  }
  return result;
}

int main(int argc, char** argv) {
  using namespace isorig;
  if (argc != 5 && argc != 6) {
    std::fprintf(stderr, "usage: %s PROTOCOL RIG RUNS CLOCK [TRACE]\n", argv[0]);
    return 2;
  }
  const bool on_disk = std::filesystem::is_block_file(argv[4]);
  const int clock = ::open(argv[4], on_disk ? O_WRONLY | O_DIRECT | O_CLOEXEC : O_CREAT | O_RDWR | O_CLOEXEC, 0600);
  std::int64_t own_ns = 0;
  void* const at = on_disk ? (clock >= 0 ? &own_ns : MAP_FAILED)
                   : clock >= 0 && ::ftruncate(clock, sizeof(std::int64_t)) == 0
                       ? ::mmap(nullptr, sizeof(std::int64_t), PROT_READ | PROT_WRITE, MAP_SHARED, clock, 0)
                       : MAP_FAILED;
  if (at == MAP_FAILED) {
    std::fprintf(stderr, "%s: the clock %s cannot be written\n", argv[0], argv[4]);
    return 1;
  }
  rig_ns = static_cast<std::int64_t*>(at);
  if (argc == 6) trace_fd = ::open(argv[5], O_CREAT | O_WRONLY | O_TRUNC | O_CLOEXEC, 0600);
  DiskClock disk_clock(on_disk ? clock : -1);
  try {
    daemon::VirtualRunOptions options;
    options.start.protocol_text = base::read_config_file(argv[1]);
    options.start.protocol_name = "three.toml";
    options.runs_root = argv[3];
    options.seed = 7;
    options.on_tick = [&](sim::Rig&, daemon::Core&, std::int64_t now_ns) {
      *rig_ns = now_ns;
      if (on_disk) disk_clock.set(now_ns);
    };
    const auto result = daemon::run_virtual(daemon::load_rig(argv[2]), options);
    if (result.outcome != "done") std::fprintf(stderr, "%s: %s\n", result.outcome.c_str(), result.fault.c_str());
    return result.outcome == "done" ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
