// Preloaded into a daemon: what its real-time threads may not do (docs/threads.md) is written down in the file that
// ISORIG_CALL_WATCH names, with the thread and where it was called from. Nothing is prevented.
#include "call_watch.hpp"

#include <dlfcn.h>
#include <execinfo.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <sys/epoll.h>
#include <sys/mman.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string_view>
#include <typeinfo>

namespace {

using isorig::system_test::CallWatch;
using isorig::system_test::ForbiddenCall;
using isorig::system_test::WatchedThread;

struct Known {
  std::string_view name;
  std::int64_t longest_pause_ns;  ///< its next turn is no further away; 0: it has ticks
};
constexpr std::int64_t kMs = 1'000'000;
constexpr std::array<Known, 5> kThreads{{{"isorig-loop", 0},
                                         {"isorig-frame", 20 * kMs},
                                         {"isorig-pressure", 20 * kMs},
                                         {"isorig-regul", 60 * kMs},
                                         {"isorig-chain", 20 * kMs}}};

CallWatch* watch = nullptr;

// This library is there from the start: no access allocates.
#define ISORIG_OWN thread_local __attribute__((tls_model("initial-exec")))
ISORIG_OWN WatchedThread* own = nullptr;
ISORIG_OWN bool is_loop = false;
ISORIG_OWN std::int64_t longest_pause_ns = 0;
ISORIG_OWN bool is_noting = false;
ISORIG_OWN std::int64_t last_deadline_ns = 0;

bool watched() {
  return own != nullptr && !is_noting && watch->is_on.load(std::memory_order_relaxed) != 0;
}

template <std::size_t kSize>
void put(std::array<char, kSize>& into, std::string_view text) {
  *std::copy_n(text.begin(), std::min(text.size(), kSize - 1), into.begin()) = '\0';
}

/// Without this library's own frames.
void put_stack(decltype(ForbiddenCall::stack)& into) {
  std::array<void*, std::tuple_size_v<decltype(ForbiddenCall::stack)> + 4> addresses{};
  const int count = ::backtrace(addresses.data(), static_cast<int>(addresses.size()));
  Dl_info here{}, info{};
  ::dladdr(reinterpret_cast<void*>(&put_stack), &here);
  auto place = into.begin();
  for (int i = 0; i < count && place != into.end(); ++i) {
    void* address = addresses[static_cast<std::size_t>(i)];
    if (::dladdr(address, &info) == 0 || info.dli_fname == nullptr || info.dli_fbase == here.dli_fbase) continue;
    std::snprintf(place->data(), place->size(), "%s+0x%tx", info.dli_fname,
                  static_cast<char*>(address) - static_cast<char*>(info.dli_fbase));
    ++place;
  }
}

void note(const char* call) {
  if (!watched()) return;
  is_noting = true;
  const int error = errno;
  ForbiddenCall fresh{};
  put(fresh.thread, own->name.data());
  put(fresh.call, call);
  put_stack(fresh.stack);
  const auto same = [&](const ForbiddenCall& c) {
    return c.thread == fresh.thread && c.call == fresh.call && c.stack == fresh.stack;
  };
  // Only this thread writes what could be the same.
  const auto so_far = std::min(watch->found.load(), CallWatch::kMostCalls);
  const auto known = std::find_if(watch->calls.begin(), watch->calls.begin() + so_far, same);
  if (known != watch->calls.begin() + so_far) {
    ++known->times;
  } else if (const auto place = watch->found++; place < CallWatch::kMostCalls) {
    auto& call_found = watch->calls[place];
    call_found.thread = fresh.thread;
    call_found.call = fresh.call;
    call_found.stack = fresh.stack;
    ++call_found.times;
    ++watch->told;
  }
  errno = error;
  is_noting = false;
}

/// The next definition behind this one. No function-local static: its guard is a lock.
template <typename Function>
Function* next(Function*& kept, const char* name) {
  if (kept == nullptr) {
    const bool before = is_noting;
    is_noting = true;
    kept = reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
    is_noting = before;
    if (kept == nullptr) ::abort();
  }
  return kept;
}

/// A device's thread talks to its device; to a file nobody does.
void note_talk(const char* call, int fd) {
  if (!watched()) return;
  struct stat what {};
  if (is_loop || ::fstat(fd, &what) != 0 || S_ISREG(what.st_mode)) {
    note(call);
  } else {
    ++own->talks;
  }
}

/// A device's thread waits for its device, for as long as that may take to answer.
void note_wait(const char* call) {
  if (is_loop) note(call);
}

/// The loop sleeps up to its next tick; a device's thread up to its next turn.
void note_sleep(clockid_t clock, int flags, const timespec& until) {
  const std::int64_t deadline_ns = std::int64_t{until.tv_sec} * 1'000'000'000 + until.tv_nsec;
  const std::int64_t before_ns = last_deadline_ns;
  if (!watched()) {
    last_deadline_ns = deadline_ns;
    return;
  }
  bool is_own = clock == CLOCK_MONOTONIC && flags == TIMER_ABSTIME;
  if (is_own && is_loop) {
    const auto period_ns = static_cast<std::int64_t>(watch->loop_period_ns.load());
    is_own = deadline_ns > before_ns && (deadline_ns - before_ns) % period_ns == 0;
  } else if (is_own) {
    timespec now{};
    ::clock_gettime(CLOCK_MONOTONIC, &now);
    is_own = deadline_ns - (std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec) <= longest_pause_ns;
  }
  if (is_own) {
    last_deadline_ns = deadline_ns;
    ++own->waits;
  } else {
    note("clock_nanosleep, not up to its next turn");
  }
}

__attribute__((constructor)) void begin() {
  const char* path = std::getenv("ISORIG_CALL_WATCH");
  if (path == nullptr) return;
  const int fd = ::open(path, O_RDWR | O_CLOEXEC);
  void* shared = fd < 0 ? MAP_FAILED : ::mmap(nullptr, sizeof(CallWatch), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  if (shared == MAP_FAILED) ::abort();  // else nothing would be seen, and nobody would know
  ::close(fd);
  // The first one loads the unwinder.
  std::array<void*, 4> warmed{};
  (void)::backtrace(warmed.data(), static_cast<int>(warmed.size()));
  watch = static_cast<CallWatch*>(shared);
}

}  // namespace

// Defines a function of the C library again: `what`, then what the library's own does.
#define ISORIG_WATCH(what, returns, name, parameters, arguments) \
  extern "C" returns name parameters {                           \
    static returns(*kept) parameters = nullptr;                  \
    what;                                                        \
    return next(kept, #name) arguments;                          \
  }

extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void __libc_free(void*);

// ---- the heap: dlsym() itself allocates
void* malloc(std::size_t size) {
  note("malloc");
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  note("calloc");
  return __libc_calloc(count, size);
}
void* realloc(void* block, std::size_t size) {
  note("realloc");
  return __libc_realloc(block, size);
}
void free(void* block) {
  if (block != nullptr) note("free");
  __libc_free(block);
}
void* memalign(std::size_t alignment, std::size_t size) {
  note("memalign");
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  note("aligned_alloc");
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** block, std::size_t alignment, std::size_t size) {
  note("posix_memalign");
  *block = __libc_memalign(alignment, size);
  return *block == nullptr ? ENOMEM : 0;
}
}

// ---- locks
ISORIG_WATCH(note("pthread_mutex_lock"), int, pthread_mutex_lock, (pthread_mutex_t * m), (m))
ISORIG_WATCH(note("pthread_mutex_timedlock"), int, pthread_mutex_timedlock, (pthread_mutex_t * m, const timespec* t),
             (m, t))
ISORIG_WATCH(note("pthread_rwlock_rdlock"), int, pthread_rwlock_rdlock, (pthread_rwlock_t * l), (l))
ISORIG_WATCH(note("pthread_rwlock_wrlock"), int, pthread_rwlock_wrlock, (pthread_rwlock_t * l), (l))
ISORIG_WATCH(note("pthread_mutex_clocklock"), int, pthread_mutex_clocklock,
             (pthread_mutex_t * m, clockid_t clock, const timespec* t), (m, clock, t))
ISORIG_WATCH(note("pthread_cond_clockwait"), int, pthread_cond_clockwait,
             (pthread_cond_t * c, pthread_mutex_t* m, clockid_t clock, const timespec* t), (c, m, clock, t))
ISORIG_WATCH(note("sem_wait"), int, sem_wait, (sem_t * s), (s))
ISORIG_WATCH(note("sem_timedwait"), int, sem_timedwait, (sem_t * s, const timespec* t), (s, t))

// ---- files
ISORIG_WATCH(note("fopen"), FILE*, fopen, (const char* path, const char* mode), (path, mode))
ISORIG_WATCH(note("fopen64"), FILE*, fopen64, (const char* path, const char* mode), (path, mode))
ISORIG_WATCH(note("fwrite"), std::size_t, fwrite, (const void* d, std::size_t s, std::size_t n, FILE* f), (d, s, n, f))
ISORIG_WATCH(note("fread"), std::size_t, fread, (void* d, std::size_t s, std::size_t n, FILE* f), (d, s, n, f))
ISORIG_WATCH(note("fflush"), int, fflush, (FILE * f), (f))
ISORIG_WATCH(note("fclose"), int, fclose, (FILE * f), (f))
ISORIG_WATCH(note("fsync"), int, fsync, (int fd), (fd))
ISORIG_WATCH(note("fdatasync"), int, fdatasync, (int fd), (fd))
ISORIG_WATCH(note("rename"), int, rename, (const char* from, const char* to), (from, to))
ISORIG_WATCH(note("unlink"), int, unlink, (const char* path), (path))
ISORIG_WATCH(note_talk("read", fd), ssize_t, read, (int fd, void* d, std::size_t n), (fd, d, n))
ISORIG_WATCH(note_talk("readv", fd), ssize_t, readv, (int fd, const iovec* v, int n), (fd, v, n))
ISORIG_WATCH(note_talk("pread", fd), ssize_t, pread, (int fd, void* d, std::size_t n, off_t at), (fd, d, n, at))
ISORIG_WATCH(note_talk("pread64", fd), ssize_t, pread64, (int fd, void* d, std::size_t n, off64_t at), (fd, d, n, at))
ISORIG_WATCH(note_talk("write", fd), ssize_t, write, (int fd, const void* d, std::size_t n), (fd, d, n))
ISORIG_WATCH(note_talk("writev", fd), ssize_t, writev, (int fd, const iovec* v, int n), (fd, v, n))
ISORIG_WATCH(note_talk("pwrite", fd), ssize_t, pwrite, (int fd, const void* d, std::size_t n, off_t at), (fd, d, n, at))
ISORIG_WATCH(note_talk("pwrite64", fd), ssize_t, pwrite64, (int fd, const void* d, std::size_t n, off64_t at),
             (fd, d, n, at))

// ---- lines
ISORIG_WATCH(note_talk("send", fd), ssize_t, send, (int fd, const void* d, std::size_t n, int f), (fd, d, n, f))
ISORIG_WATCH(note_talk("recv", fd), ssize_t, recv, (int fd, void* d, std::size_t n, int f), (fd, d, n, f))
ISORIG_WATCH(note_talk("sendmsg", fd), ssize_t, sendmsg, (int fd, const msghdr* m, int f), (fd, m, f))
ISORIG_WATCH(note_talk("recvmsg", fd), ssize_t, recvmsg, (int fd, msghdr* m, int f), (fd, m, f))
ISORIG_WATCH(note_wait("poll"), int, poll, (pollfd * of, nfds_t n, int ms), (of, n, ms))
ISORIG_WATCH(note_wait("ppoll"), int, ppoll, (pollfd * of, nfds_t n, const timespec* t, const sigset_t* s),
             (of, n, t, s))
ISORIG_WATCH(note_wait("select"), int, select, (int n, fd_set* r, fd_set* w, fd_set* e, timeval* t), (n, r, w, e, t))
ISORIG_WATCH(note_wait("epoll_wait"), int, epoll_wait, (int fd, epoll_event* of, int n, int ms), (fd, of, n, ms))

// ---- sleeping
ISORIG_WATCH(note_sleep(clock, flags, *until), int, clock_nanosleep,
             (clockid_t clock, int flags, const timespec* until, timespec* left), (clock, flags, until, left))
ISORIG_WATCH(note("nanosleep"), int, nanosleep, (const timespec* t, timespec* left), (t, left))
ISORIG_WATCH(note("usleep"), int, usleep, (useconds_t us), (us))
ISORIG_WATCH(note("sleep"), unsigned, sleep, (unsigned s), (s))

extern "C" {
// ---- with a mode, or not (nobody here opens a nameless file with O_TMPFILE)
#define ISORIG_OPEN(name, before, arguments)         \
  int name before {                                  \
    static int(*kept) before = nullptr;              \
    note(#name);                                     \
    mode_t mode = 0;                                 \
    if ((flags & O_CREAT) != 0) {                    \
      va_list more;                                  \
      va_start(more, flags);                         \
      mode = static_cast<mode_t>(va_arg(more, int)); \
      va_end(more);                                  \
    }                                                \
    return next(kept, #name) arguments;              \
  }
ISORIG_OPEN(open, (const char* path, int flags, ...), (path, flags, mode))
ISORIG_OPEN(open64, (const char* path, int flags, ...), (path, flags, mode))
ISORIG_OPEN(openat, (int at, const char* path, int flags, ...), (at, path, flags, mode))
ISORIG_OPEN(openat64, (int at, const char* path, int flags, ...), (at, path, flags, mode))

// ---- condition variables: the C library keeps an older kind under the same names, which dlsym() may give
#define ISORIG_CONDITION(name, parameters, arguments)                                                           \
  int name parameters {                                                                                         \
    static int(*kept) parameters = nullptr;                                                                     \
    note(#name);                                                                                                \
    if (kept == nullptr) kept = reinterpret_cast<int(*) parameters>(::dlvsym(RTLD_NEXT, #name, "GLIBC_2.3.2")); \
    return next(kept, #name) arguments;                                                                         \
  }
ISORIG_CONDITION(pthread_cond_wait, (pthread_cond_t * c, pthread_mutex_t* m), (c, m))
ISORIG_CONDITION(pthread_cond_timedwait, (pthread_cond_t * c, pthread_mutex_t* m, const timespec* t), (c, m, t))
ISORIG_CONDITION(pthread_cond_signal, (pthread_cond_t * c), (c))
ISORIG_CONDITION(pthread_cond_broadcast, (pthread_cond_t * c), (c))

// ---- what has no name in the C library: std::binary_semaphore and the waits of std::atomic
long syscall(long number, ...) {
  static long (*kept)(long, ...) = nullptr;
  note("syscall");
  std::array<long, 6> more{};
  va_list given;
  va_start(given, number);
  for (auto& one : more) one = va_arg(given, long);
  va_end(given);
  return next(kept, "syscall")(number, more[0], more[1], more[2], more[3], more[4], more[5]);
}

// ---- exceptions
void* __cxa_allocate_exception(std::size_t size) noexcept {
  static void* (*kept)(std::size_t) = nullptr;
  note("__cxa_allocate_exception");
  return next(kept, "__cxa_allocate_exception")(size);
}
[[noreturn]] void __cxa_throw(void* thrown, std::type_info* type, void (*destructor)(void*)) {
  static void (*kept)(void*, std::type_info*, void (*)(void*)) = nullptr;
  note("__cxa_throw");
  next(kept, "__cxa_throw")(thrown, type, destructor);
  ::abort();
}
[[noreturn]] void __cxa_rethrow() {
  static void (*kept)() = nullptr;
  note("__cxa_rethrow");
  next(kept, "__cxa_rethrow")();
  ::abort();
}

// ---- who is who: a thread gives itself its name
int pthread_setname_np(pthread_t thread, const char* name) {
  static int (*kept)(pthread_t, const char*) = nullptr;
  const auto* known = std::find_if(kThreads.begin(), kThreads.end(), [&](const Known& k) { return k.name == name; });
  if (watch != nullptr && pthread_equal(thread, pthread_self()) != 0 && known != kThreads.end()) {
    own = &watch->threads[static_cast<std::size_t>(known - kThreads.begin())];
    put(own->name, name);
    is_loop = known == kThreads.begin();
    longest_pause_ns = known->longest_pause_ns;
  }
  return next(kept, "pthread_setname_np")(thread, name);
}
}
