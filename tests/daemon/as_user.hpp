#pragma once
#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>

#include <exception>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

namespace isorig::daemon::test {

inline constexpr const char* kNeedsRoot = "only root may become other users: run it as root (sudo ctest ...)";

/// Runs `body` as that user, in a thread of its own: for the kernel users and groups are a thread's, and glibc's own
/// calls, which change all threads, are gone round. A connection that it opens has that user's credentials.
template <typename Body>
void as_user(uid_t uid, gid_t gid, const std::vector<gid_t>& groups, Body&& body) {
  std::exception_ptr thrown;
  std::thread([&] {
    try {
      if (::syscall(SYS_setgroups, groups.size(), groups.data()) != 0 || ::syscall(SYS_setresgid, gid, gid, gid) != 0 ||
          ::syscall(SYS_setresuid, uid, uid, uid) != 0) {
        throw std::runtime_error("could not become another user");
      }
      std::forward<Body>(body)();
    } catch (...) {
      thrown = std::current_exception();
    }
  }).join();
  (void)::prctl(PR_SET_DUMPABLE,
                1);  // taken from the process with the change; the leak checker looks into it at the end
  if (thrown) std::rethrow_exception(thrown);
}

}  // namespace isorig::daemon::test
