// Preloaded into a daemon: a disk whose syncs take their time. As long as the file named by ISORIG_SLOW_SYNC exists, no
// fsync or fdatasync comes back; while one waits, that name with ".waiting" exists.
#include <dlfcn.h>
#include <fcntl.h>
#include <unistd.h>

#include <cstdlib>
#include <ctime>
#include <string>

namespace {

void wait_for_disk() {
  const char* gate = std::getenv("ISORIG_SLOW_SYNC");
  if (gate == nullptr || ::access(gate, F_OK) != 0) return;
  const std::string waiting = std::string(gate) + ".waiting";
  ::close(::open(waiting.c_str(), O_CREAT | O_WRONLY | O_CLOEXEC, 0600));
  while (::access(gate, F_OK) == 0) {
    const timespec pause{0, 10'000'000};
    ::nanosleep(&pause, nullptr);
  }
}

int really(const char* name, int fd) {
  using Sync = int (*)(int);
  return reinterpret_cast<Sync>(::dlsym(RTLD_NEXT, name))(fd);
}

}  // namespace

extern "C" {
int fsync(int fd) {
  wait_for_disk();
  return really("fsync", fd);
}
int fdatasync(int fd) {
  wait_for_disk();
  return really("fdatasync", fd);
}
}
