#include "daemon/host/storage_watch.hpp"

#include <pthread.h>

#include <exception>
#include <utility>

namespace isorig::daemon {

StorageWatch::StorageWatch(Look look) : look_(std::move(look)) {
  thread_ = std::thread([this] {
    pthread_setname_np(pthread_self(), "isorig-disk");
    run();
  });
}

StorageWatch::~StorageWatch() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

std::string StorageWatch::look_here() const noexcept {
  try {
    return look_();
  } catch (const std::exception& e) {
    return e.what();
  }
}

void StorageWatch::ask(std::int64_t now_ns) {
  {
    const std::lock_guard lock(mutex_);
    if (asked_ns_) return;
    asked_ns_ = now_ns;
    answer_.reset();
  }
  wake_.notify_one();
}

std::optional<std::string> StorageWatch::take() {
  const std::lock_guard lock(mutex_);
  return std::exchange(answer_, std::nullopt);
}

std::optional<std::int64_t> StorageWatch::asked_ns() const {
  const std::lock_guard lock(mutex_);
  return asked_ns_;
}

void StorageWatch::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    wake_.wait(lock, [this] { return stop_ || asked_ns_; });
    if (stop_) return;
    lock.unlock();
    std::string why = look_here();
    lock.lock();
    answer_ = std::move(why);
    asked_ns_.reset();
  }
}

}  // namespace isorig::daemon
