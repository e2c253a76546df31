#include "daemon/host/storage_watch.hpp"

#include <pthread.h>

#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>

namespace isorig::daemon {
namespace {

constexpr std::chrono::seconds kPatience{1};

std::string answer_of(const StorageWatch::Look& look) noexcept {
  try {
    return look();
  } catch (const std::exception& e) {
    return e.what();
  }
}

}  // namespace

/// Of the watch and of its thread, whichever is there longer.
struct StorageWatch::Shared {
  explicit Shared(Look l) : look(std::move(l)) {}

  const Look look;
  std::mutex mutex;  // guards all below
  std::condition_variable wake, rested;
  bool stop = false, has_ended = false;
  std::optional<std::int64_t> asked_ns;
  std::optional<std::string> answer;

  void run() {
    std::unique_lock lock(mutex);
    for (;;) {
      wake.wait(lock, [this] { return stop || asked_ns; });
      if (stop) break;
      lock.unlock();
      std::string why = answer_of(look);
      lock.lock();
      answer = std::move(why);
      asked_ns.reset();
      rested.notify_all();
    }
    has_ended = true;
    rested.notify_all();
  }
};

StorageWatch::StorageWatch(Look look)
    : shared_(std::make_shared<Shared>(std::move(look))), thread_([shared = shared_] {
        pthread_setname_np(pthread_self(), "isorig-disk");
        shared->run();
      }) {}

StorageWatch::~StorageWatch() {
  std::unique_lock lock(shared_->mutex);
  shared_->stop = true;
  shared_->wake.notify_one();
  const bool has_ended = shared_->rested.wait_for(lock, kPatience, [this] { return shared_->has_ended; });
  lock.unlock();
  if (has_ended) {
    thread_.join();
  } else {
    thread_.detach();
  }
}

std::string StorageWatch::look_here() const noexcept {
  return answer_of(shared_->look);
}

void StorageWatch::ask(std::int64_t now_ns) {
  {
    const std::lock_guard lock(shared_->mutex);
    if (shared_->asked_ns) return;
    shared_->asked_ns = now_ns;
    shared_->answer.reset();
  }
  shared_->wake.notify_one();
}

std::optional<std::string> StorageWatch::take() {
  const std::lock_guard lock(shared_->mutex);
  return std::exchange(shared_->answer, std::nullopt);
}

bool StorageWatch::answers(std::int64_t now_ns) {
  ask(now_ns);
  std::unique_lock lock(shared_->mutex);
  return shared_->rested.wait_for(lock, kPatience, [this] { return !shared_->asked_ns; });
}

std::optional<std::int64_t> StorageWatch::asked_ns() const {
  const std::lock_guard lock(shared_->mutex);
  return shared_->asked_ns;
}

}  // namespace isorig::daemon
