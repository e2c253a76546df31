#pragma once
#include <gtest/gtest.h>

#include <atomic>
#include <barrier>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "api_client.hpp"
#include "daemon/host/api.hpp"
#include "daemon/host/audit_log.hpp"
#include "daemon/host/host.hpp"
#include "daemon/recording/run_directory.hpp"
#include "recording_rig.hpp"
#include "rig_fixture.hpp"
#include "wait_until.hpp"

namespace isorig::daemon::test {

/// Vented, then a hold that nobody waits for.
inline constexpr const char* kLongProtocol = R"(format = "isorig-protocol/1"
name = "test"
steps = [
  { do = "pressurize", pressure_psi = 0, rate_psi_s = 5, settled_for_s = 0.01, timeout_s = 20 },
  { do = "hold", duration_s = 1000 } ]
)";

/// `call` by so many threads in the same moment.
template <typename Call>
void at_once(int clients, Call call) {
  std::barrier line(clients);
  std::vector<std::thread> crowd;
  for (int i = 0; i < clients; ++i) {
    crowd.emplace_back([&, i] {
      line.arrive_and_wait();
      call(i);
    });
  }
  for (auto& t : crowd) t.join();
}

/// The daemon as its clients see it: host and API on real sockets, over a simulated rig that ticks in a thread of its
/// own, about as fast as it can.
class ServedRig : public ::testing::Test {
 protected:
  explicit ServedRig(const char* folder) : folder_(folder), config_(load_rig(source("config/rigs/sim.toml"))) {
    // Virtual time does not wait for a disk: only the test that asks for it judges the recorder's pace.
    config_.core.recorder_age_max_s = 1e6;
    config_.recording.min_free_bytes = config_.recording.reserve_bytes = 1 << 20U;
  }

  void serve() {
    rig_ = std::make_unique<VirtualRig>(config_);
    Host::Options options;
    options.runs_root = runs_;
    options.revision = "0123456789ab";
    options.epoch_unix_us = [this] { return epoch_unix_us_.load(); };
    options.free_bytes = [this](const std::filesystem::path& path) {
      while (disk_hangs_) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      return disk_is_nearly_full_ ? std::uint64_t{1} << 19U : free_bytes(path);
    };
    options.on_parted = [this](const std::string& run, const std::string& text, const std::string& then) {
      const std::lock_guard lock(parted_mutex_);
      parted_.push_back(run + " " + then + ": " + text);
    };
    host_ = std::make_unique<Host>(config_, rig_->core(), rig_->streams, options);
    audit_ = std::make_unique<AuditLog>(runs_, [](const std::string& why) { ADD_FAILURE() << why; });
    api_ = std::make_unique<Api>(*host_, socket_, socket_mode_, Api::Audit(), roles_, audit_.get());
    done_ = false;
    threads_.emplace_back([this] {
      while (!done_) {
        if (!loop_waits_) rig_->tick();
        std::this_thread::sleep_for(std::chrono::microseconds(100));
      }
    });
    threads_.emplace_back([this] {
      while (!done_) {
        if (!recorder_waits_) host_->turn(rig_->core().status().control.mono_ns);
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
      }
    });
    threads_.emplace_back([this] { api_->serve(); });
    threads_.emplace_back([this] { api_->serve_stops(); });
    threads_.emplace_back([this] { api_->work(); });
    threads_.emplace_back([this] { audit_->run(); });
    ASSERT_TRUE(reach(RunState::kReady));
  }
  void stop_serving() {
    if (!api_) return;
    api_->stop();
    audit_->stop();
    done_ = true;
    disk_hangs_ = false;
    for (auto& t : threads_) t.join();
    threads_.clear();
    host_->shut_down();
    api_.reset();
    audit_.reset();
    host_.reset();
    rig_.reset();
  }

  [[nodiscard]] RunState state() const { return rig_->core().status().control.state; }
  [[nodiscard]] bool reach(RunState wanted) const {
    return wait_until(60.0, [&] { return state() == wanted; });
  }

  using Answer = ApiAnswer;
  /// `line`: "GET /v1/status". `stops`: over the second socket. `headers`: each with its end of line.
  [[nodiscard]] Answer call(const std::string& line, const std::string& body = {}, bool stops = false,
                            const std::string& headers = {}) const {
    return call_api(socket_ + (stops ? ".stop" : ""), line, body, headers);
  }

  /// What was to be told of partings.
  [[nodiscard]] std::vector<std::string> parted() const {
    const std::lock_guard lock(parted_mutex_);
    return parted_;
  }

  mutable std::mutex parted_mutex_;
  std::vector<std::string> parted_;
  daemon::testing::TemporaryDirectory folder_;
  std::filesystem::path runs_ = folder_.path() / "runs";
  std::string socket_ = (folder_.path() / "s").string();
  RigConfig config_;
  std::unique_ptr<VirtualRig> rig_;
  std::unique_ptr<Host> host_;
  unsigned socket_mode_ = 0600;
  Roles roles_;
  std::unique_ptr<AuditLog> audit_;
  std::unique_ptr<Api> api_;
  std::vector<std::thread> threads_;
  std::atomic<bool> done_{false};
  std::atomic<bool> recorder_waits_{false};
  std::atomic<std::int64_t> epoch_unix_us_{0};  ///< the wall clock at the rig's time 0
  std::atomic<bool> loop_waits_{false};
  std::atomic<bool> disk_is_nearly_full_{false}, disk_hangs_{false};
};

}  // namespace isorig::daemon::test
