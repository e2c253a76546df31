#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>

#include "daemon/export/writer.hpp"

/// Compressing takes longer than reading the log: both go on at once.
namespace isorig::daemon {
namespace {

/// Blocks that wait for a thread at most: 2 MB each.
constexpr std::size_t kMostWaiting = 8;

/// One thread that does what it is given, in order. After a failure it does nothing more, and says so to who gives.
class Worker {
 public:
  Worker() : thread_([this] { run(); }) {}
  ~Worker() {
    {
      const std::lock_guard lock(mutex_);
      over_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  void add(std::function<void()> task) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return tasks_.size() < kMostWaiting || failed_; });
    if (failed_) std::rethrow_exception(failed_);
    tasks_.push_back(std::move(task));
    changed_.notify_all();
  }
  /// What has to go in that thread, whether or not all is well.
  void release(std::function<void()> task) {
    const std::lock_guard lock(mutex_);
    tasks_.push_back(std::move(task));
    changed_.notify_all();
  }
  void drain() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return (tasks_.empty() && !busy_) || failed_; });
    if (failed_) std::rethrow_exception(failed_);
  }

 private:
  void run() {
    std::unique_lock lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] { return !tasks_.empty() || over_; });
      if (tasks_.empty()) return;
      auto task = std::move(tasks_.front());
      tasks_.pop_front();
      const bool wanted = !failed_ && !over_;
      busy_ = true;
      lock.unlock();
      std::exception_ptr failed;
      if (wanted) {
        try {
          task();
        } catch (...) {
          failed = std::current_exception();
        }
      }
      task = nullptr;  // what it holds goes here, in this thread
      lock.lock();
      busy_ = false;
      if (failed) failed_ = failed;
      changed_.notify_all();
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> tasks_;
  std::exception_ptr failed_;
  bool busy_ = false, over_ = false;
  std::thread thread_;
};

/// A session whose writer is made, used and destroyed by one thread: HDF5 bears no second.
class BackgroundSession : public SessionWriter {
 public:
  BackgroundSession(ExportWriter& to, Worker& worker, const SessionHead& head)
      : worker_(worker), inner_(std::make_shared<std::unique_ptr<SessionWriter>>()) {
    worker_.add([&to, head, inner = inner_] { *inner = to.open(head); });
  }
  ~BackgroundSession() override {
    worker_.release([inner = std::move(inner_)]() mutable { inner.reset(); });
  }
  void rows(Stream stream, const Table& block) override {
    if (block.rows() == 0) return;
    worker_.add([stream, block, inner = inner_] { (*inner)->rows(stream, block); });
  }
  void finish(const SessionTail& tail) override {
    worker_.add([tail, inner = inner_] {
      (*inner)->finish(tail);
      inner->reset();
    });
  }

 private:
  Worker& worker_;
  std::shared_ptr<std::unique_ptr<SessionWriter>> inner_;
};

class BackgroundWriter : public ExportWriter {
 public:
  BackgroundWriter(std::unique_ptr<ExportWriter> to, std::size_t threads) : to_(std::move(to)), workers_(threads) {}

  std::unique_ptr<SessionWriter> open(const SessionHead& head) override {
    return std::make_unique<BackgroundSession>(*to_, workers_[next_++ % workers_.size()], head);
  }
  [[nodiscard]] std::filesystem::path path_of(const std::string& session) const override {
    return to_->path_of(session);
  }
  bool drop(const std::string& name, const std::string& run, std::int32_t session) override {
    return to_->drop(name, run, session);
  }
  void close(const Attributes& run, const Table& sessions,
             const std::vector<std::pair<std::string, std::string>>& texts) override {
    for (auto& worker : workers_) worker.drain();
    to_->close(run, sessions, texts);
  }

 private:
  std::unique_ptr<ExportWriter> to_;  // outlives the threads
  std::deque<Worker> workers_;
  std::size_t next_ = 0;
};

}  // namespace

std::unique_ptr<ExportWriter> make_background_writer(std::unique_ptr<ExportWriter> to, std::size_t threads) {
  return std::make_unique<BackgroundWriter>(std::move(to), threads);
}

}  // namespace isorig::daemon
