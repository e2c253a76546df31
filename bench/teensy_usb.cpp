// tty against libusb on the same emulated Teensy behind the same kernel: when does the host know that a frame came?
// Runs in the virtual bench as root (docs/usb.md has the command and what its numbers mean):
//   bench_teensy_usb [seconds per case] [disturbing processes]
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "base/quantile.hpp"
#include "bench/teensy_backend.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/pressure/teensy.hpp"
#include "drivers/pressure/tty_stream.hpp"
#include "drivers/pressure/usb_stream.hpp"
#include "sim/wire/pressure/teensy_usbip.hpp"

namespace {

using namespace isorig;

constexpr int kIoPriority = 60;  // docs/threads.md
constexpr int kHostPriority = 95;
constexpr int kDevicePriority = 90;  // the device is no program of this machine: nothing here delays it

void make_realtime(int priority) {
  const sched_param parameters{.sched_priority = priority};
  if (sched_setscheduler(0, SCHED_FIFO, &parameters) != 0) std::perror("SCHED_FIFO");
}

/// The kernel threads of vhci-hcd do what interrupts do on a real host controller: nothing may keep them waiting.
void raise_host_controller() {
  for (const auto& process : std::filesystem::directory_iterator("/proc")) {
    std::string name;
    std::getline(std::ifstream(process.path() / "comm"), name);
    if (name != "vhci_rx" && name != "vhci_tx") continue;
    const sched_param parameters{.sched_priority = kHostPriority};
    if (sched_setscheduler(std::atoi(process.path().filename().c_str()), SCHED_FIFO, &parameters) != 0)
      std::perror("vhci");
  }
}

/// Remembers when a stream said that its bytes had come: what the driver stamps a time exchange with.
class StampedStream final : public pressure::ByteStream {
 public:
  StampedStream(std::unique_ptr<pressure::ByteStream> stream, const clock::Clock& clock)
      : stream_(std::move(stream)), clock_(clock) {}
  void open() override { stream_->open(); }
  void close() noexcept override { stream_->close(); }
  [[nodiscard]] bool is_open() const noexcept override { return stream_->is_open(); }
  std::size_t read_some(std::span<std::uint8_t> out, std::int64_t timeout_ns) override {
    const std::size_t size = stream_->read_some(out, timeout_ns);
    stamp_ns = stream_->arrived_ns().value_or(clock_.now_ns());
    return size;
  }
  void write_all(std::span<const std::uint8_t> bytes) override { stream_->write_all(bytes); }
  [[nodiscard]] std::optional<std::int64_t> arrived_ns() const noexcept override { return stream_->arrived_ns(); }
  [[nodiscard]] std::string name() const override { return stream_->name(); }

  std::int64_t stamp_ns = 0;

 private:
  std::unique_ptr<pressure::ByteStream> stream_;
  const clock::Clock& clock_;
};

void print(const char* what, std::vector<double>& values_us) {
  const double median = base::quantile_in_place(values_us, 0.5);
  double sum = 0.0, squares = 0.0;
  for (const double value : values_us) sum += value, squares += value * value;
  const auto count = static_cast<double>(values_us.size());
  std::printf("  %-12s %7.1f %7.1f %8.1f %8.1f %8.1f\n", what, median,
              std::sqrt(std::max(squares / count - sum / count * sum / count, 0.0)),
              base::quantile_in_place(values_us, 0.99), base::quantile_in_place(values_us, 0.999),
              base::quantile_in_place(values_us, 1.0));
}

std::string port_of_the_teensy() {
  for (int i = 0; i < 2000; ++i) {
    for (const auto& device : pressure::list_usb_devices()) {
      if (device.kind == pressure::UsbKind::kTeensy && !device.tty.empty() && ::access(device.tty.c_str(), F_OK) == 0)
        return device.tty;
    }
    ::usleep(10'000);
  }
  throw std::runtime_error("the kernel has not enumerated the emulated Teensy");
}

void run(const std::string& name, std::unique_ptr<pressure::ByteStream> inner, double seconds) {
  const clock::RealClock clock;
  auto owned = std::make_unique<StampedStream>(std::move(inner), clock);
  StampedStream& stream = *owned;
  pressure::Teensy device({.serial = "1234560"}, std::move(owned), clock);
  device.connect();
  std::array<pressure::Sample, 256> samples{};
  std::array<clock::Exchange, 16> exchanges{};
  std::vector<double> stamped_us, handed_us, trips_us;
  std::uint64_t lost = 0;
  const std::int64_t start_ns = clock.now_ns();
  const std::int64_t end_ns = start_ns + static_cast<std::int64_t>(seconds * 1e9);
  for (std::int64_t beat_ns = 0; clock.now_ns() < end_ns;) {
    if (clock.now_ns() >= beat_ns) {
      beat_ns = clock.now_ns() + 20'000'000;
      device.heartbeat();
      device.request_time_sync();
    }
    const pressure::Poll poll = device.poll(samples, exchanges, 5'000'000);
    const std::int64_t now_ns = clock.now_ns();
    if (now_ns - start_ns < 200'000'000) continue;  // what was queued before the first read
    lost += poll.lost;
    for (std::size_t i = 0; i < poll.samples; ++i) {
      // The device's clock is this machine's here; it sends a sample in the service after its conversion.
      const auto device_ns = static_cast<double>(samples[i].device_us) * 1e3;
      stamped_us.push_back(1e-3 * (static_cast<double>(stream.stamp_ns) - device_ns));
      handed_us.push_back(1e-3 * (static_cast<double>(now_ns) - device_ns));
    }
    for (std::size_t i = 0; i < poll.exchanges; ++i)
      trips_us.push_back(1e-3 * static_cast<double>(exchanges[i].host_recv_ns - exchanges[i].host_send_ns));
  }
  device.disconnect();
  std::printf("%s: %zu samples, %llu lost\n", name.c_str(), stamped_us.size(), static_cast<unsigned long long>(lost));
  print("stamped", stamped_us);
  print("handed over", handed_us);
  print("round trip", trips_us);
}

}  // namespace

int main(int argc, char** argv) try {
  const double seconds = argc > 1 ? std::atof(argv[1]) : 5.0;
  const int disturbers = argc > 2 ? std::atoi(argv[2]) : 0;
  std::vector<pid_t> children;
  for (int i = 0; i < disturbers; ++i) {
    const pid_t child = ::fork();
    if (child == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      for (volatile unsigned long n = 0;;) n = n + 1;
    }
    children.push_back(child);
  }
  const clock::RealClock clock;
  bench::TeensyBackend backend(clock);
  sim::TeensyUsbip::Options options;
  options.start_us = static_cast<std::uint64_t>(clock.now_ns() / 1000);
  sim::TeensyUsbip teensy(options, backend, clock.now_ns());
  std::atomic<bool> is_done{false};
  std::thread device_side([&] {
    make_realtime(kDevicePriority);
    const clock::RealClock own;
    for (std::int64_t next_ns = own.now_ns(); !is_done;) {
      teensy.service(own.now_ns());
      if (own.now_ns() >= next_ns) next_ns = own.now_ns() / 1'000'000 * 1'000'000 + 1'000'000;
      pollfd port{teensy.fd(), POLLIN, 0};
      const timespec wait{0, std::clamp<long>(next_ns - own.now_ns(), 0, 1'000'000)};
      (void)::ppoll(&port, 1, &wait, nullptr);
    }
  });
  std::printf("%.0f s each, %d disturbing processes; in us\n  %-12s %7s %7s %8s %8s %8s\n", seconds, disturbers, "",
              "median", "sigma", "99 %", "99.9 %", "max");
  const std::string tty = port_of_the_teensy();
  raise_host_controller();
  ::sleep(3);  // what udev starts for a new device is over
  make_realtime(kIoPriority);
  run("tty", std::make_unique<pressure::TtyStream>(pressure::TtyStream::Options{.path = tty}), seconds);
  run("usb",
      std::make_unique<pressure::UsbStream>(
          pressure::UsbStream::Options{.serial = "1234560", .event_priority = kIoPriority + 1}),
      seconds);
  is_done = true;
  device_side.join();
  for (const pid_t child : children) {
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
  }
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bench_teensy_usb: %s\n", error.what());
  return 1;
}
