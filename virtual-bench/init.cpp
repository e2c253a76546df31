// The first program of the guest: makes the host's root file system the guest's, with everything written going to
// memory, then runs /run/virtual-bench/guest there, or hands over to the init of that root (kernel argument
// `bench.init=/sbin/init`). Static, freestanding of the root it prepares.
#include <fcntl.h>
#include <sys/mount.h>
#include <sys/reboot.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

constexpr const char* kShare = "/run/virtual-bench";

[[noreturn]] void power_off() {
  sync();
  reboot(RB_POWER_OFF);
  for (;;) pause();
}

void require(bool ok, const char* what) {
  if (ok) return;
  std::printf("virtual-bench: %s: %s\n", what, std::strerror(errno));
  power_off();
}

void mount_at(const char* source, const std::string& target, const char* type, unsigned long flags = 0,
              const char* options = nullptr) {
  mkdir(target.c_str(), 0755);
  require(mount(source, target.c_str(), type, flags, options) == 0, target.c_str());
}

void load_modules() {
  FILE* list = std::fopen("/modules", "r");
  require(list != nullptr, "/modules");
  char name[256];
  while (std::fscanf(list, "%255s", name) == 1) {
    const int fd = open((std::string("/") + name).c_str(), O_RDONLY | O_CLOEXEC);
    require(fd >= 0 && (syscall(SYS_finit_module, fd, "", 0) == 0 || errno == EEXIST), name);
    close(fd);
  }
  std::fclose(list);
}

std::string kernel_argument(const std::string& key) {
  char line[4096] = {};
  FILE* file = std::fopen("/proc/cmdline", "r");
  require(file != nullptr && std::fgets(line, sizeof line, file) != nullptr, "/proc/cmdline");
  std::fclose(file);
  for (char* word = std::strtok(line, " \n"); word != nullptr; word = std::strtok(nullptr, " \n")) {
    if (std::string(word).rfind(key + "=", 0) == 0) return std::string(word).substr(key.size() + 1);
  }
  return "";
}

void enter_root() {
  constexpr const char* k9p = "trans=virtio,version=9p2000.L,msize=262144,cache=loose";
  mount_at("root", "/lower", "9p", MS_RDONLY, k9p);
  mount_at("memory", "/memory", "tmpfs", 0, "size=60%");
  mkdir("/memory/upper", 0755);
  mkdir("/memory/work", 0755);
  mount_at("root", "/root", "overlay", 0, "lowerdir=/lower,upperdir=/memory/upper,workdir=/memory/work");
  const std::string root = "/root";
  mount_at("proc", root + "/proc", "proc");
  mount_at("sysfs", root + "/sys", "sysfs");
  mount_at("devtmpfs", root + "/dev", "devtmpfs");
  mount_at("devpts", root + "/dev/pts", "devpts", 0, "ptmxmode=0666");
  mount_at("shm", root + "/dev/shm", "tmpfs");
  mount_at("run", root + "/run", "tmpfs", 0, "mode=0755");
  mkdir((root + "/lib/modules").c_str(), 0755);
  mount_at("modules", root + "/lib/modules", "9p", MS_RDONLY, k9p);
  mount_at("share", root + kShare, "9p", 0, "trans=virtio,version=9p2000.L,msize=262144,access=any");
  require(
      chdir("/root") == 0 && mount("/root", "/", nullptr, MS_MOVE, nullptr) == 0 && chroot(".") == 0 && chdir("/") == 0,
      "entering the root");
}

}  // namespace

int main() {
  mount_at("devtmpfs", "/dev", "devtmpfs");
  mount_at("proc", "/proc", "proc");
  load_modules();
  const std::string init = kernel_argument("bench.init");
  enter_root();
  if (!init.empty()) {
    execl(init.c_str(), init.c_str(), nullptr);
    require(false, init.c_str());
  }
  const pid_t child = fork();
  require(child >= 0, "fork");
  const std::string guest = std::string(kShare) + "/guest";
  if (child == 0) {
    setsid();
    execl("/bin/bash", "bash", guest.c_str(), nullptr);
    require(false, "/bin/bash");
  }
  while (wait(nullptr) != child || errno == EINTR) errno = 0;  // whoever lost its parent is ours too
  power_off();
}
