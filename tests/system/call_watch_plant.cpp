// Threads with the names of the daemon's, started as the daemon starts them, which do on purpose what those may not do:
// whether call_watch.cpp sees it (realtime_calls_test.cpp). `list` prints each kind with the call that has to be seen.
#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <mutex>
#include <semaphore>
#include <shared_mutex>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "call_watch.hpp"
#include "daemon/threads.hpp"
#include "drivers/clock/real_clock.hpp"

namespace isorig::system_test {
namespace {

constexpr std::int64_t kPeriodNs = 1'000'000;

/// Made before the threads.
struct Things {
  std::string file;
  int file_fd = -1;
  std::array<int, 2> pipe{-1, -1};
  std::mutex mutex;
  std::shared_mutex shared_mutex;
  std::condition_variable condition;
  std::counting_semaphore<> semaphore{0};
  void* block = nullptr;
  std::vector<int> numbers{1, 2, 3};
  clock::RealClock clock;
};

struct Plant {
  const char* kind;
  const char* call;
  bool of_loop_alone;
  void (*act)(Things& t);
};

void* volatile kept_block = nullptr;

const std::array kPlants{
    Plant{"malloc", "malloc", false, [](Things&) { kept_block = std::malloc(24); }},
    Plant{"calloc", "calloc", false, [](Things&) { kept_block = std::calloc(3, 8); }},
    Plant{"realloc", "realloc", false,
          [](Things& t) { kept_block = std::realloc(std::exchange(t.block, nullptr), 99); }},
    Plant{"free", "free", false, [](Things& t) { std::free(std::exchange(t.block, nullptr)); }},
    Plant{"aligned", "aligned_alloc", false, [](Things&) { kept_block = std::aligned_alloc(64, 64); }},
    Plant{"posix_memalign", "posix_memalign", false,
          [](Things&) {
            void* block = nullptr;
            (void)!::posix_memalign(&block, 64, 64);
            kept_block = block;
          }},
    Plant{"new", "malloc", false, [](Things&) { kept_block = new int(1); }},
    Plant{"text", "malloc", false, [](Things& t) { t.file += std::string(100, 'x'); }},
    Plant{"mutex", "pthread_mutex_lock", false, [](Things& t) { const std::lock_guard lock(t.mutex); }},
    Plant{"shared mutex", "pthread_rwlock_wrlock", false,
          [](Things& t) { const std::lock_guard lock(t.shared_mutex); }},
    Plant{"shared lock", "pthread_rwlock_rdlock", false,
          [](Things& t) { const std::shared_lock lock(t.shared_mutex); }},
    Plant{"notify", "pthread_cond_broadcast", false, [](Things& t) { t.condition.notify_all(); }},
    Plant{"wait", "pthread_cond_clockwait", false,
          [](Things& t) {
            std::unique_lock lock(t.mutex);
            t.condition.wait_for(lock, std::chrono::milliseconds(1));
          }},
    Plant{"semaphore", "syscall", false,
          [](Things& t) { (void)t.semaphore.try_acquire_for(std::chrono::milliseconds(1)); }},
    Plant{"open", "open", false, [](Things& t) { ::close(::open(t.file.c_str(), O_RDONLY | O_CLOEXEC)); }},
    Plant{"openat", "openat", false,
          [](Things& t) { ::close(::openat(AT_FDCWD, t.file.c_str(), O_RDONLY | O_CLOEXEC)); }},
    Plant{"read", "read", false,
          [](Things& t) {
            char byte = 0;
            (void)!::read(t.file_fd, &byte, 1);
          }},
    Plant{"write", "write", false, [](Things& t) { (void)!::write(t.file_fd, "x", 1); }},
    Plant{"pwrite", "pwrite", false, [](Things& t) { (void)!::pwrite(t.file_fd, "x", 1, 0); }},
    Plant{"fsync", "fsync", false, [](Things& t) { ::fsync(t.file_fd); }},
    Plant{"fdatasync", "fdatasync", false, [](Things& t) { ::fdatasync(t.file_fd); }},
    Plant{"stream", "fopen64", false, [](Things& t) { std::ofstream(t.file) << "x"; }},
    Plant{"stream's write", "write", false, [](Things& t) { std::ofstream(t.file) << "x"; }},
    Plant{"fopen", "fopen", false, [](Things& t) { std::fclose(std::fopen(t.file.c_str(), "re")); }},
    Plant{"rename", "rename", false, [](Things& t) { ::rename(t.file.c_str(), t.file.c_str()); }},
    Plant{"unlink", "unlink", false, [](Things& t) { ::unlink(t.file.c_str()); }},
    Plant{"log", "fwrite", false, [](Things&) { std::fwrite("log\n", 1, 4, stderr); }},
    Plant{"throw", "__cxa_throw", false,
          [](Things&) {
            try {
              throw 1;
            } catch (int) {
            }
          }},
    Plant{"throw of the library", "__cxa_throw", false,
          [](Things& t) {
            try {
              t.numbers.at(7) = 1;
            } catch (const std::exception&) {
            }
          }},
    Plant{"exception", "__cxa_allocate_exception", false,
          [](Things&) {
            try {
              throw std::runtime_error("");
            } catch (const std::exception&) {
            }
          }},
    Plant{"sleep_for", "nanosleep", false, [](Things&) { std::this_thread::sleep_for(std::chrono::microseconds(1)); }},
    Plant{"usleep", "usleep", false, [](Things&) { ::usleep(1); }},
    Plant{"relative sleep", "clock_nanosleep, not up to its next turn", false,
          [](Things&) {
            const timespec pause{0, 1000};
            ::clock_nanosleep(CLOCK_MONOTONIC, 0, &pause, nullptr);
          }},
    Plant{"long sleep", "clock_nanosleep, not up to its next turn", false,
          [](Things& t) { t.clock.sleep_until_ns(t.clock.now_ns() + 80'000'001); }},
    Plant{"sleep between ticks", "clock_nanosleep, not up to its next turn", true,
          [](Things& t) { t.clock.sleep_until_ns(1 + t.clock.now_ns() / kPeriodNs * kPeriodNs); }},
    Plant{"read of a line", "read", true,
          [](Things& t) {
            char byte = 0;
            (void)!::read(t.pipe[0], &byte, 1);
          }},
    Plant{"poll", "poll", true,
          [](Things& t) {
            pollfd waiting{t.pipe[0], POLLIN, 0};
            ::poll(&waiting, 1, 0);
          }},
};

/// Turns of a thread that keeps to its contract; the plant, if any, in the midst of them.
void turns(CallWatch& watch, Things& things, const Plant* plant) {
  std::int64_t deadline_ns = things.clock.now_ns() / kPeriodNs * kPeriodNs;
  for (int turn = 0; turn < 20; ++turn) {
    deadline_ns += kPeriodNs;
    things.clock.sleep_until_ns(deadline_ns);
    if (turn == 2) watch.is_on = 1;
    if (turn == 10 && plant != nullptr) plant->act(things);
  }
  watch.is_on = 0;
}

int main_of(const std::string_view kind) {
  if (kind == "list") {
    for (const auto& p : kPlants) std::printf("%s\t%s\t%s\n", p.kind, p.call, p.of_loop_alone ? "loop" : "all");
    return 0;
  }
  const auto* plant = std::find_if(kPlants.begin(), kPlants.end(), [&](const Plant& p) { return kind == p.kind; });
  if (plant == kPlants.end()) plant = nullptr;
  if (plant == nullptr && kind != "nothing") return 2;

  const std::string path = std::getenv("ISORIG_CALL_WATCH");
  const int fd = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
  void* shared = ::mmap(nullptr, sizeof(CallWatch), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  if (shared == MAP_FAILED) return 3;
  auto& watch = *static_cast<CallWatch*>(shared);
  watch.loop_period_ns = kPeriodNs;

  daemon::RealtimeConfig realtime;
  realtime.enforce = false;
  for (const char* name : {"isorig-loop", "isorig-frame", "isorig-pressure", "isorig-regul", "isorig-chain"}) {
    Things things;
    things.file = path + ".file";
    things.file_fd = ::open(things.file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    things.block = std::malloc(16);
    if (things.file_fd < 0 || ::pipe2(things.pipe.data(), O_NONBLOCK | O_CLOEXEC) != 0) return 4;
    std::vector<std::thread> threads;
    daemon::spawn(threads, name, 0, realtime, [&] { turns(watch, things, plant); });
    threads.front().join();
    std::free(things.block);
    for (const int each : {things.file_fd, things.pipe[0], things.pipe[1]}) ::close(each);
  }
  return 0;
}

}  // namespace
}  // namespace isorig::system_test

int main(int count, char** arguments) {
  return isorig::system_test::main_of(count == 2 ? arguments[1] : "");
}
