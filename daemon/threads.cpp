#include "daemon/threads.hpp"

#include <spdlog/spdlog.h>

#include <cstring>
#include <stdexcept>
#include <string>

namespace isorig::daemon {
namespace {

constexpr auto kComplaintPeriod = std::chrono::seconds(10);

}  // namespace

void set_stack_bytes(std::size_t bytes) {
  pthread_attr_t attributes;
  int error = pthread_attr_init(&attributes);
  if (error == 0) {
    error = pthread_attr_setstacksize(&attributes, bytes);
    if (error == 0) error = pthread_setattr_default_np(&attributes);
    pthread_attr_destroy(&attributes);
  }
  if (error != 0)
    throw std::runtime_error("no thread can have a stack of " + std::to_string(bytes / 1024) + " KiB (" +
                             std::strerror(error) + ")");
}

void Complaint::note(const char* what) noexcept {
  const auto now = std::chrono::steady_clock::now();
  if (now < next_) return;
  next_ = now + kComplaintPeriod;
  try {
    spdlog::error("{}: {}", name_, what);
  } catch (...) {  // no memory for a line: the thread goes on all the same
  }
}

}  // namespace isorig::daemon
