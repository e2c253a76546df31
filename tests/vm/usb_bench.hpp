#pragma once
// The emulated Teensy on the kernel's own USB, serviced by a thread, and the driver under test. Runs as root in the
// virtual bench only (docs/virtual-bench.md).
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "bench/teensy_backend.hpp"
#include "drivers/api/error.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/pressure/teensy.hpp"
#include "drivers/pressure/usb_stream.hpp"
#include "sim/wire/pressure/teensy_usbip.hpp"

namespace isorig::pressure {

using drivers::DeviceError;
using drivers::Fault;

inline double since_ms(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

/// An emulated processor enumerates a device in some 200 ms; the limit is for one that never does.
inline bool eventually(const std::function<bool()>& condition, double limit_s = 20.0) {
  const auto start = std::chrono::steady_clock::now();
  while (!condition()) {
    if (since_ms(start) > 1e3 * limit_s) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return true;
}

/// A Teensy that lives in a thread of its own.
class LiveTeensy {
 public:
  explicit LiveTeensy(const char* serial = "1234560", sim::TeensyUsbip::Port port = {}) : serial_(serial) {
    sim::TeensyUsbip::Options options;
    options.core.serial = serial_.c_str();
    options.start_us = static_cast<std::uint64_t>(clock_.now_ns() / 1000);  // device time is true time here
    usb_.emplace(options, backend_, clock_.now_ns(), std::move(port));
    thread_ = std::thread([this] { live(); });
  }
  ~LiveTeensy() {
    stop_ = true;
    thread_.join();
  }
  LiveTeensy(const LiveTeensy&) = delete;
  LiveTeensy& operator=(const LiveTeensy&) = delete;

  sim::TeensyUsbFaults& usb() { return usb_->usb_faults(); }
  sim::TeensyFaults& faults() { return usb_->faults(); }
  const sim::TeensyUsbip::Seen& seen() { return usb_->seen(); }

 private:
  void live() {
    while (!stop_) {
      usb_->service(clock_.now_ns());
      pollfd port{usb_->fd(), POLLIN, 0};
      (void)::poll(&port, 1, 1);
    }
  }

  std::string serial_;
  clock::RealClock clock_;
  bench::TeensyBackend backend_{clock_};
  std::optional<sim::TeensyUsbip> usb_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// The device that is on the bus; one without an identity between two.
inline UsbDevice present() {
  const auto devices = list_usb_devices();
  return devices.empty() ? UsbDevice{} : devices.front();
}

/// Enumerated, and its port with its driver.
inline bool is_ready(const std::string& serial = "1234560") {
  for (const auto& device : list_usb_devices()) {
    if (device.kind == UsbKind::kTeensy && device.serial == serial && !device.tty.empty() &&
        std::filesystem::exists(device.tty)) {
      return true;
    }
  }
  return false;
}

class UsbBench : public testing::Test {
 protected:
  void plug() {
    teensy = std::make_unique<LiveTeensy>();
    ASSERT_TRUE(eventually([] { return is_ready(); })) << "the kernel has not enumerated it";
  }
  void TearDown() override {
    device.reset();
    teensy.reset();
    EXPECT_TRUE(eventually([] { return list_usb_devices().empty(); })) << "still on the bus after unplugging";
  }
  void open(UsbStream::Options options = {.serial = "1234560"}) {
    auto owned = std::make_unique<UsbStream>(std::move(options));
    stream = owned.get();
    device = std::make_unique<Teensy>(Teensy::Options{.serial = "1234560"}, std::move(owned), clock_);
  }
  struct Log {
    std::vector<Sample> samples;
    std::vector<clock::Exchange> exchanges;
    std::uint64_t lost = 0, corrupt = 0;
  };
  Log run_for(int duration_ms) {
    Log log;
    const std::int64_t end_ns = clock_.now_ns() + std::int64_t{duration_ms} * 1'000'000;
    for (std::int64_t beat_ns = 0; clock_.now_ns() < end_ns;) {
      if (clock_.now_ns() >= beat_ns) {
        device->heartbeat();
        device->request_time_sync();
        beat_ns = clock_.now_ns() + 20'000'000;
      }
      const Poll poll = device->poll(samples_, exchanges_, 5'000'000);
      log.samples.insert(log.samples.end(), samples_.begin(), samples_.begin() + static_cast<long>(poll.samples));
      log.exchanges.insert(log.exchanges.end(), exchanges_.begin(),
                           exchanges_.begin() + static_cast<long>(poll.exchanges));
      log.lost += poll.lost;
      log.corrupt += poll.corrupt;
    }
    return log;
  }
  struct Failure {
    Fault fault{};
    std::string what;
    double after_ms = 0.0;
  };
  template <class Call>
  static Failure failure_of(Call&& call) {
    const auto start = std::chrono::steady_clock::now();
    try {
      call();
    } catch (const DeviceError& error) {
      return {error.fault(), error.what(), since_ms(start)};
    }
    ADD_FAILURE() << "no DeviceError";
    return {Fault::kProtocol, "", since_ms(start)};
  }

  clock::RealClock clock_;
  std::unique_ptr<LiveTeensy> teensy;
  UsbStream* stream = nullptr;
  std::unique_ptr<Teensy> device;
  std::array<Sample, 512> samples_{};
  std::array<clock::Exchange, 64> exchanges_{};
};

}  // namespace isorig::pressure
