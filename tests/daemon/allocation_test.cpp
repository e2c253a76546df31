#include <dlfcn.h>
#include <pthread.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>

#include "rig_fixture.hpp"

/// The contract of the real-time loop, proved: across a whole protocol, a fault and its reset, no tick allocates,
/// frees, takes a mutex or makes a blocking call. The C library's own functions are interposed here and count while
/// `guarded` is set, which is only inside Core::tick().
namespace {
thread_local bool guarded = false;
std::atomic<int> violations{0};
const char* volatile last_violation = "";

void note(const char* what) {
  if (guarded) {
    last_violation = what;
    violations.fetch_add(1);
  }
}

template <typename Function>
Function next(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}
}  // namespace

extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void __libc_free(void*);

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
int pthread_mutex_lock(pthread_mutex_t* mutex) {
  note("pthread_mutex_lock");
  static const auto real = next<int (*)(pthread_mutex_t*)>("pthread_mutex_lock");
  return real(mutex);
}
int pthread_cond_signal(pthread_cond_t* condition) {
  note("pthread_cond_signal");
  static const auto real = next<int (*)(pthread_cond_t*)>("pthread_cond_signal");
  return real(condition);
}
ssize_t write(int fd, const void* data, std::size_t size) {
  note("write");
  static const auto real = next<ssize_t (*)(int, const void*, std::size_t)>("write");
  return real(fd, data, size);
}
ssize_t read(int fd, void* data, std::size_t size) {
  note("read");
  static const auto real = next<ssize_t (*)(int, void*, std::size_t)>("read");
  return real(fd, data, size);
}
int clock_nanosleep(clockid_t clock, int flags, const timespec* request, timespec* remain) {
  note("clock_nanosleep");
  static const auto real = next<int (*)(clockid_t, int, const timespec*, timespec*)>("clock_nanosleep");
  return real(clock, flags, request, remain);
}
}

namespace isorig::daemon::test {
namespace {

class AllocationTest : public RigFixture {
 protected:
  void SetUp() override {
    RigFixture::SetUp();
    guard_ticks();
  }
  void guard_ticks() {
    virtual_rig->around_core = [](Core& core, std::int64_t now_ns) {
      guarded = true;
      core.tick(now_ns, 0, 0);
      guarded = false;
    };
  }
};

TEST_F(AllocationTest, TheGuardSeesAnAllocation) {
  const int before = violations;
  guarded = true;
  void* volatile block = std::malloc(16);
  std::free(block);
  guarded = false;
  EXPECT_EQ(violations, before + 2);
  violations = before;
}

TEST_F(AllocationTest, NoTickOfAWholeProtocolAllocatesLocksOrBlocks) {
  violations = 0;
  plan = protocol::compile_file(source("config/protocols/vma-short.toml"), config.limits);
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  ASSERT_TRUE(ask(Request::Verb::kStart, &plan).accepted);
  run_for(20.0);
  ASSERT_TRUE(ask(Request::Verb::kPause).accepted);
  run_for(1.0);
  ASSERT_TRUE(ask(Request::Verb::kResume).accepted);
  ASSERT_TRUE(run_until(600.0, [&] { return virtual_rig->core().outcome() == Outcome::kDone; }))
      << to_text(virtual_rig->core().state()) << ": " << virtual_rig->core().status().fault;
  ASSERT_TRUE(reach(RunState::kReady, 30.0));

  ASSERT_TRUE(ask(Request::Verb::kStart, &plan).accepted);
  run_for(5.0);
  virtual_rig->rig().interlock().estop_closed = false;
  ASSERT_TRUE(reach(RunState::kFaulted, 1.0));
  run_for(5.0);
  virtual_rig->rig().interlock().estop_closed = true;
  run_for(0.5);
  ASSERT_TRUE(ask(Request::Verb::kReset).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 30.0));

  // Faults upon a fault, a frame that does not stop, and the driver's words in each of them.
  ASSERT_TRUE(ask(Request::Verb::kStart, &plan).accepted);
  run_for(5.0);
  virtual_rig->rig().frame().faults.stop_lost = 100;
  virtual_rig->core().tick(virtual_rig->now_ns() + 1, 400'000'000, 0);
  run_for(0.5);
  virtual_rig->rig().frame().faults.silent = true;
  virtual_rig->rig().pressure().faults.sensor_fault = true;
  run_for(1.0);
  EXPECT_GE(virtual_rig->core().status().fault_count, 3U);
  virtual_rig->rig().frame().faults.silent = virtual_rig->rig().pressure().faults.sensor_fault = false;
  run_for(3.0);
  ASSERT_TRUE(ask(Request::Verb::kReset).accepted);
  ASSERT_TRUE(ask(Request::Verb::kConfirmZero).accepted || virtual_rig->core().status().zero_confirmed);
  ASSERT_TRUE(ask(Request::Verb::kAbort).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 30.0));
  EXPECT_EQ(violations, 0) << "first seen: " << last_violation;
}

TEST_F(AllocationTest, NoTickOfArmingCountdownSetupAndJogAllocatesLocksOrBlocks) {
  config.core.operating.arming_required = true;
  rebuild();
  guard_ticks();
  violations = 0;
  plan = protocol::compile_file(source("config/protocols/vma-short.toml"), config.limits);
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  ASSERT_TRUE(ask(Request::Verb::kArm).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 11.0));
  ASSERT_TRUE(ask(Request::Verb::kSetup).accepted);
  run_for(0.5);
  ASSERT_TRUE(ask(Request::Verb::kGo, &plan).accepted == false);
  Request jog;
  jog.verb = Request::Verb::kJog;
  jog.target_mm = 1.0;
  virtual_rig->core().requests.push(jog);
  run_for(3.0);
  EXPECT_NE(event("jog.done"), nullptr);
  Reply reply;
  ASSERT_TRUE(virtual_rig->core().replies.pop(reply));
  ASSERT_TRUE(ask(Request::Verb::kLeaveSetup).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  ASSERT_TRUE(ask(Request::Verb::kArm).accepted);
  ASSERT_TRUE(ask(Request::Verb::kGo, &plan).accepted);
  run_for(2.0);
  ASSERT_TRUE(ask(Request::Verb::kPause).accepted);
  ASSERT_TRUE(reach(RunState::kReady, 5.0));
  ASSERT_TRUE(ask(Request::Verb::kArm).accepted);
  ASSERT_TRUE(ask(Request::Verb::kGo, &plan).accepted);
  ASSERT_TRUE(reach(RunState::kRunning, 6.0));
  run_for(1.0);
  EXPECT_EQ(violations, 0) << "first seen: " << last_violation;
}

}  // namespace
}  // namespace isorig::daemon::test
