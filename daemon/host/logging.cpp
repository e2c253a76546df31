#include "daemon/host/logging.hpp"

#include <spdlog/async.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <mutex>
#include <thread>
#include <utility>
#include <vector>

namespace isorig::daemon {
namespace {

constexpr std::size_t kLinesQueued = 8192;

/// Behind the terminal's sink: when a flush arrives here, everything before it has gone out.
class FlushMark final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit FlushMark(std::shared_ptr<std::atomic<bool>> flushed) : flushed_(std::move(flushed)) {}

 private:
  void sink_it_(const spdlog::details::log_msg&) override {}
  void flush_() override { flushed_->store(true); }
  std::shared_ptr<std::atomic<bool>> flushed_;
};

}  // namespace

Logging::Logging() : flushed_(std::make_shared<std::atomic<bool>>(false)) {
  spdlog::init_thread_pool(kLinesQueued, 1);
  const std::vector<spdlog::sink_ptr> sinks{std::make_shared<spdlog::sinks::stdout_color_sink_mt>(),
                                            std::make_shared<FlushMark>(flushed_)};
  spdlog::set_default_logger(std::make_shared<spdlog::async_logger>(
      "", sinks.begin(), sinks.end(), spdlog::thread_pool(), spdlog::async_overflow_policy::overrun_oldest));
}

Logging::~Logging() {
  spdlog::shutdown();
}

std::size_t Logging::lost() {
  const auto pool = spdlog::thread_pool();
  return pool ? pool->overrun_counter() : 0;
}

bool Logging::drain(std::chrono::milliseconds patience) {
  flushed_->store(false);
  spdlog::default_logger()->flush();
  const auto deadline = std::chrono::steady_clock::now() + patience;
  while (!flushed_->load()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

}  // namespace isorig::daemon
