#include "drivers/pressure/usb_stream.hpp"

#include <libusb-1.0/libusb.h>
#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <future>
#include <mutex>
#include <thread>
#include <utility>

#include "drivers/api/error.hpp"
#include "drivers/clock/real_clock.hpp"

namespace isorig::pressure {
namespace {

using drivers::DeviceError;
using drivers::Fault;

constexpr int kVendor = 0x16c0;
constexpr std::int64_t kClose_ns = 500'000'000;
constexpr std::int64_t kLook_ns = 250'000'000;
/// Between the plug's pull and the kernel's last clean-up, poll() reports the device at once, again and again, with
/// nothing to collect. Without a pause this thread, above all that does I/O, kept a single processor for 1.6 s: from
/// the kernel's clean-up, from the service that would close the device, and from the service manager's watchdog. A few
/// turns are free: they were woken by us.
constexpr int kIdleTurns = 3;
constexpr std::int64_t kIdlePause_ns = 1'000'000;

}  // namespace

/// A libusb context and the thread that handles its events. Shared with that thread: should the kernel never give a
/// transfer back, the stream goes and thread and context stay, since freeing them under the kernel would be worse.
class UsbStream::Events {
 public:
  Events() {
    if (const int error = libusb_init(&context_); error != 0) {
      throw DeviceError(Fault::kRefused,
                        std::string("USB cannot be used: ") + libusb_error_name(error) + "; is /dev/bus/usb there?");
    }
    // What libusb itself asks libudev for; without the daemon its promise of callbacks is empty.
    if (::access("/run/udev/control", F_OK) == 0 && libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG) != 0) {
      has_hotplug_ = libusb_hotplug_register_callback(context_, LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED,
                                                      LIBUSB_HOTPLUG_NO_FLAGS, kVendor, LIBUSB_HOTPLUG_MATCH_ANY,
                                                      LIBUSB_HOTPLUG_MATCH_ANY, arrived, this, &hotplug_) == 0;
    }
  }
  ~Events() {
    if (has_hotplug_) libusb_hotplug_deregister_callback(context_, hotplug_);  // 1.0.26: before libusb_exit()
    libusb_exit(context_);
  }
  Events(const Events&) = delete;
  Events& operator=(const Events&) = delete;

  /// Throws when the thread is refused its priority.
  static void start(const std::shared_ptr<Events>& self, int priority) {
    std::promise<int> started;
    auto outcome = started.get_future();
    // Signals are for the threads that wait for them.
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    self->thread_ = std::thread([self, priority, started = std::move(started)]() mutable {
      pthread_setname_np(pthread_self(), "isorig-usb");
      const sched_param parameters{.sched_priority = priority};
      const int refused = pthread_setschedparam(pthread_self(), priority > 0 ? SCHED_FIFO : SCHED_OTHER, &parameters);
      started.set_value(refused);
      if (refused == 0) self->run();
    });
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
    if (const int error = outcome.get(); error != 0) {
      self->thread_.join();
      throw DeviceError(Fault::kRefused, "the USB thread is refused SCHED_FIFO priority " + std::to_string(priority) +
                                             " (" + std::strerror(error) +
                                             "); grant LimitRTPRIO, or run with --no-realtime");
    }
  }

  void stop() noexcept {
    stop_ = true;
    libusb_interrupt_event_handler(context_);
    if (!thread_.joinable()) return;
    if (session() == nullptr) {
      thread_.join();
    } else {
      thread_.detach();
    }
  }

  [[nodiscard]] std::shared_ptr<UsbSession> session() const noexcept {
    const std::lock_guard lock(session_mutex_);
    return session_;
  }
  void attend(std::shared_ptr<UsbSession> session) noexcept {
    {
      const std::lock_guard lock(session_mutex_);
      session_.swap(session);  // what was there is freed outside of the lock, with the argument
    }
    libusb_interrupt_event_handler(context_);
  }
  [[nodiscard]] libusb_context* context() const noexcept { return context_; }
  [[nodiscard]] bool has_hotplug() const noexcept { return has_hotplug_; }
  bool take_arrival() noexcept { return has_arrived_.exchange(false); }

  UsbCounters counters;

 private:
  /// Only notes it: from inside a callback libusb may not be asked for anything that waits.
  static int arrived(libusb_context*, libusb_device*, libusb_hotplug_event, void* self) noexcept {
    static_cast<Events*>(self)->has_arrived_ = true;
    return 0;
  }

  void run() noexcept {
    for (int idle_turns = 0;;) {
      std::int64_t wait_ns = 1'000'000'000;
      const auto attended = session();
      if (attended) {
        wait_ns = attended->service() - clock::RealClock{}.now_ns();
        if (attended->is_closed()) forget_session();
      }
      if (stop_ && session() == nullptr) return;
      const std::int64_t wait_us = wait_ns > 0 ? wait_ns / 1000 + 1 : 0;
      timeval timeout{static_cast<time_t>(wait_us / 1'000'000), static_cast<suseconds_t>(wait_us % 1'000'000)};
      const std::int64_t begin_ns = clock::RealClock{}.now_ns();
      const std::uint64_t completed = attended ? attended->completed_transfers() : 0;
      const int error = libusb_handle_events_timeout_completed(context_, &timeout, nullptr);
      const bool was_idle = error != 0 || ((!attended || attended->completed_transfers() == completed) &&
                                           clock::RealClock{}.now_ns() - begin_ns < kIdlePause_ns);
      idle_turns = was_idle ? idle_turns + 1 : 0;
      if (idle_turns > kIdleTurns) std::this_thread::sleep_for(std::chrono::nanoseconds(kIdlePause_ns));
    }
  }

  /// The caller holds a copy: nothing is freed under the lock.
  void forget_session() noexcept {
    const std::lock_guard lock(session_mutex_);
    session_ = nullptr;
  }

  libusb_context* context_ = nullptr;
  libusb_hotplug_callback_handle hotplug_ = 0;
  bool has_hotplug_ = false;
  std::thread thread_;
  std::atomic<bool> stop_{false}, has_arrived_{false};
  // Not std::atomic<std::shared_ptr>: libstdc++ spins in it, and spins for ever when a thread of higher SCHED_FIFO
  // priority preempts the holder on the same processor.
  mutable std::mutex session_mutex_;
  std::shared_ptr<UsbSession> session_;
};

UsbStream::UsbStream(Options options) : options_(std::move(options)) {}

UsbStream::~UsbStream() {
  close();
  if (events_) events_->stop();
}

void UsbStream::open() {
  close();
  if (!events_) {
    auto events = std::make_shared<Events>();
    Events::start(events, options_.event_priority);
    events_ = std::move(events);
  }
  (void)events_->take_arrival();  // whatever came until now is found now
  const auto devices = list_usb_devices();
  last_node_.clear();
  for (const auto& device : devices) {
    if (device.kind == UsbKind::kTeensy && (options_.serial.empty() || device.serial == options_.serial))
      last_node_ = device.node;
  }
  const UsbDevice device = find_teensy(options_.serial, devices);
  if (events_->session())
    throw DeviceError(Fault::kDisconnected, name() + ": the kernel has not given the last connection back yet");
  session_ = std::make_shared<UsbSession>(events_->context(), device, options_.session, events_->counters);
  events_->attend(session_);
}

void UsbStream::close() noexcept {
  if (!session_) return;
  (void)session_->close(kClose_ns);
  session_ = nullptr;
}

bool UsbStream::has_reappeared() noexcept {
  if (is_open()) return false;
  if (events_ && events_->has_hotplug()) return events_->take_arrival();
  try {
    if (clock::RealClock{}.now_ns() < next_look_ns_) return false;
    next_look_ns_ = clock::RealClock{}.now_ns() + kLook_ns;
    for (const auto& device : list_usb_devices()) {
      if (device.kind != UsbKind::kTeensy || (!options_.serial.empty() && device.serial != options_.serial)) continue;
      return std::exchange(last_node_, device.node.string()) != device.node.string();
    }
    last_node_.clear();
  } catch (const std::exception&) {  // out of memory: the back-off will do
  }
  return false;
}

std::size_t UsbStream::read_some(std::span<std::uint8_t> out, std::int64_t timeout_ns) {
  if (!session_) throw DeviceError(Fault::kDisconnected, name() + ": not open");
  const auto received = session_->read(out, timeout_ns);
  arrived_ns_ = received.mono_ns;
  return received.size;
}

void UsbStream::write_all(std::span<const std::uint8_t> bytes) {
  if (!session_) throw DeviceError(Fault::kDisconnected, name() + ": not open");
  session_->write(bytes);
}

std::string UsbStream::name() const {
  return options_.serial.empty() ? "Teensy on USB" : "Teensy " + options_.serial + " on USB";
}

const UsbCounters& UsbStream::counters() const noexcept {
  static const UsbCounters kNone;
  return events_ ? events_->counters : kNone;
}

bool UsbStream::has_hotplug() const noexcept {
  return events_ && events_->has_hotplug();
}

}  // namespace isorig::pressure
