#pragma once
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <thread>
#include <vector>

#include "daemon/io/frame_service.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/frame/instron8800_frame.hpp"
#include "drivers/frame/modbus_frame.hpp"
#include "sim/rig.hpp"
#include "sim/wire/frame/instron8800_server.hpp"
#include "sim/wire/frame/modbus_server.hpp"
#include "tree.hpp"

namespace isorig::sim {

enum class Wire { kModbusTcp, kModbusRtu, kInstron8800 };

inline std::string name_of(Wire wire) {
  return wire == Wire::kModbusTcp ? "ModbusTcp" : wire == Wire::kModbusRtu ? "ModbusRtu" : "Instron8800";
}

inline void PrintTo(Wire wire, std::ostream* out) {
  *out << name_of(wire);
}

/// How long this machine let a thread that only sleeps wait beyond its time: what a limit in real time has to allow.
class Stalls {
 public:
  Stalls() : thread_([this] { watch(); }) {}
  ~Stalls() {
    over_ = true;
    thread_.join();
  }
  Stalls(const Stalls&) = delete;
  Stalls& operator=(const Stalls&) = delete;
  [[nodiscard]] double total_s() const { return 1e-9 * static_cast<double>(total_ns_.load()); }

 private:
  void watch() {
    const clock::RealClock clock;
    while (!over_) {
      const auto from_ns = clock.now_ns();
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      const auto over_ns = clock.now_ns() - from_ns - 5'000'000;
      if (over_ns > 0) total_ns_ += over_ns;
    }
  }
  std::atomic<bool> over_{false};
  std::atomic<std::int64_t> total_ns_{0};
  std::thread thread_;
};

/// A driver whose heartbeats are counted on their way.
class CountedDevice final : public frame::Device {
 public:
  explicit CountedDevice(std::unique_ptr<frame::Device> device) : device_(std::move(device)) {}
  frame::Identity connect() override {
    ++connects;
    return device_->connect();
  }
  void disconnect() noexcept override { device_->disconnect(); }
  frame::Poll poll(std::span<frame::Sample> out) override { return device_->poll(out); }
  void start_segment(const frame::Segment& segment) override { device_->start_segment(segment); }
  void stop() override {
    ++stops;
    device_->stop();
  }
  void heartbeat(std::uint16_t counter) override {
    ++heartbeats;
    device_->heartbeat(counter);
  }
  int heartbeats = 0, stops = 0, connects = 0;

 private:
  std::unique_ptr<frame::Device> device_;
};

/// The daemon's frame service and a real driver on one side of a real line, the emulator and the plant on the other.
class StopWireRig {
 public:
  struct Times {
    double watchdog_s = 1.0;  ///< of the frame
    int response_timeout_ms = 200;
    int off_ms = 400;  ///< 8800: C23,0 follows a stop that is not confirmed
    bool watchdog_can_be_asked = true;
    int gap_us = 200;         ///< 8800: between two lines
    int answer_ms = 0;        ///< 8800: how much later than at once every answer comes
    int heartbeat_ms = 5000;  ///< 8800: heartbeat_timeout_ms
  };

  StopWireRig(Wire wire, const Times& times) : wire_(wire) {
    auto sim = load_sim(test::source_path("/config/rigs/sim-wire.toml"));
    sim.frame.request = sim.frame.reply = {0.0, 0.0, 0.0, 0.0};
    sim.frame.exchange_interval_ms = 0.0;
    sim.frame.ring_samples = 4096;
    const bool is_8800 = wire == Wire::kInstron8800;
    sim.frame.heartbeat_timeout_s = is_8800 ? 1000.0 : times.watchdog_s;  // the 8800's is the controller's
    RigOptions live;
    live.start_ns = clock_.now_ns();
    live.clock = &clock_;
    live.threaded = true;
    live.keep_truth = true;
    rig_ = std::make_unique<Rig>(sim, load_specimen(sim.specimen), live);
    std::unique_ptr<frame::Device> driver;
    if (is_8800) {
      driver = make_8800(times);
    } else {
      driver = make_modbus(times);
    }
    device_ = std::make_unique<CountedDevice>(std::move(driver));
    service_ = std::make_unique<daemon::FrameService>(*device_, link_, daemon::ServiceConfig{}, clock_);
  }

  [[nodiscard]] StopFaults& faults() {
    return wire_ == Wire::kInstron8800 ? controller_faults_.stop : gateway_faults_.stop;
  }
  FrameFaults& plant_faults() { return rig_->frame().faults; }
  [[nodiscard]] CountedDevice& device() { return *device_; }
  [[nodiscard]] const frame::Instron8800Config& config_8800() const { return config_8800_; }
  [[nodiscard]] const daemon::FrameReport& report() const { return report_; }
  /// A report ever said so.
  [[nodiscard]] bool heartbeat_was_lost() const { return heartbeat_was_lost_; }
  [[nodiscard]] std::int64_t now_ns() const { return clock_.now_ns(); }
  [[nodiscard]] const std::string& detail() const { return detail_; }

  /// One turn of the I/O thread, and what the loop would make of it.
  void turn() {
    link_.loop_beat.fetch_add(1);
    const auto from_ns = clock_.now_ns();
    service_->run_once(from_ns);
    Stamped sample;
    while (link_.samples.pop(sample)) {
    }
    clock::Exchange exchange;
    while (link_.exchanges.pop(exchange)) {
    }
    daemon::LinkHealth health;
    while (link_.health.pop(health)) detail_ = health.detail;
    for (daemon::FrameReport r; link_.reports.pop(r);) {
      report_ = r;
      heartbeat_was_lost_ = heartbeat_was_lost_ || (r.state.fault_bits & frame::kHeartbeatLost) != 0;
      if (r.stop_request == request_ && r.stop_confirmed && confirmed_ns_ < 0) confirmed_ns_ = r.mono_ns;
    }
    clock_.sleep_until_ns(from_ns + 5'000'000);
  }
  bool until(double seconds, const std::function<bool()>& condition) {
    const auto end_ns = clock_.now_ns() + static_cast<std::int64_t>(1e9 * seconds);
    while (!condition()) {
      if (clock_.now_ns() > end_ns) return false;
      turn();
    }
    return true;
  }

  /// On the way to `target_mm` at 1 mm/s. A machine that stands still may cost a connection: then again.
  bool move_to(float target_mm) {
    const double from_mm = rig_->truth().position_mm;
    std::int64_t sent_ns = -1;
    return until(60.0, [&] {
      const bool moving = report_.state.motion == frame::Motion::kMoving && report_.stop_confirmed;
      if (!moving && confirmed_ns_ >= 0 && clock_.now_ns() - sent_ns > 2'000'000'000) {
        sent_ns = clock_.now_ns();
        link_.commands.push({{++segment_, target_mm, 1.0F}, segment_, request_});
      }
      return moving && std::abs(rig_->truth().position_mm - from_mm) > 0.3;
    });
  }

  void request() {
    (void)rig_->take_truth();
    confirmed_ns_ = -1;
    request_ns_ = clock_.now_ns();
    link_.stops_requested.store(++request_);
  }
  [[nodiscard]] std::int64_t request_ns() const { return request_ns_; }
  /// When the request was reported to have ended in standstill; -1: not yet.
  [[nodiscard]] std::int64_t confirmed_ns() const { return confirmed_ns_; }

  /// Of the plant, since the request: when it moved last, and whether it did after it was said to stand.
  struct Seen {
    std::int64_t moved_ns = 0;
    bool moved_after_confirmation = false;
  };
  Seen look() {
    const auto steps = rig_->take_truth();
    for (const auto& step : steps) {
      if (std::abs(step.velocity_mm_s) <= kStanding_mm_s) continue;
      seen_.moved_ns = step.mono_ns;
      if (confirmed_ns_ >= 0 && step.mono_ns > confirmed_ns_) seen_.moved_after_confirmation = true;
    }
    return seen_;
  }
  static constexpr double kStanding_mm_s = 0.03;  ///< as the slope of noisy samples can tell

 private:
  using Stamped = daemon::Stamped<frame::Sample>;

  std::unique_ptr<frame::Device> make_modbus(const Times& times) {
    ModbusServer::Options options;
    options.map = modbus::read_register_map(test::source_path("/config/frames/isorig-gateway.toml"));
    options.tcp = wire_ == Wire::kModbusTcp;
    options.pty = !options.tcp;
    modbus_ = std::make_unique<ModbusServer>(options, rig_->frame(), gateway_faults_);
    modbus::ModbusConfig config;
    config.map = options.map;
    config.transport = options.tcp ? modbus::ModbusTransport::kTcp : modbus::ModbusTransport::kRtu;
    config.port = modbus_->port();
    config.tty = modbus_->tty();
    config.response_timeout_ms = times.response_timeout_ms;
    config.start_confirm_ms = 2000;
    return std::make_unique<frame::ModbusFrame>(config, clock_);
  }
  std::unique_ptr<frame::Device> make_8800(const Times& times) {
    Instron8800Server::Options options;
    options.watchdog_s = times.watchdog_s;
    if (!times.watchdog_can_be_asked) options.watchdog = Instron8800Server::Options::Watchdog::kNotAsked;
    controller_ = std::make_unique<Instron8800Server>(options, rig_->frame(), controller_faults_);
    controller_faults_.delay_ms = times.answer_ms;
    auto& config = config_8800_;
    config.port = controller_->port();
    config.response_timeout_ms = times.response_timeout_ms;
    config.gap_us = times.gap_us;
    config.quiet_ms = 30;
    config.position_full_scale_mm = options.position_full_scale_mm;
    config.force_full_scale_N = options.force_full_scale_N;
    config.reading_age_max_ms = 1.2;
    config.start_confirm_ms = 2000;
    config.stop_confirm_ms = times.off_ms;
    config.watchdog_feed_ms = 100;
    config.watchdog_tested = !times.watchdog_can_be_asked;
    config.heartbeat_timeout_ms = times.heartbeat_ms;
    return std::make_unique<frame::Instron8800Frame>(config, clock_);
  }

  Wire wire_;
  frame::Instron8800Config config_8800_;
  clock::RealClock clock_;
  FrameWireFaults gateway_faults_;
  Instron8800Faults controller_faults_;
  std::unique_ptr<Rig> rig_;
  std::unique_ptr<ModbusServer> modbus_;
  std::unique_ptr<Instron8800Server> controller_;
  daemon::FrameLink link_;
  std::unique_ptr<CountedDevice> device_;
  std::unique_ptr<daemon::FrameService> service_;
  daemon::FrameReport report_;
  bool heartbeat_was_lost_ = false;
  std::string detail_;
  std::uint32_t request_ = 0;
  std::int64_t request_ns_ = 0, confirmed_ns_ = -1;
  std::uint16_t segment_ = 0;
  Seen seen_;
};

}  // namespace isorig::sim
