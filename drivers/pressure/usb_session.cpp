#include "drivers/pressure/usb_session.hpp"

#include <fcntl.h>
#include <libusb-1.0/libusb.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <system_error>
#include <utility>

#include "drivers/api/error.hpp"
#include "drivers/clock/real_clock.hpp"

namespace isorig::pressure {
namespace {

using drivers::DeviceError;
using drivers::Fault;

constexpr int kControlInterface = 0;
constexpr int kDataInterface = 1;
constexpr std::uint8_t kClassInterfaceOut = 0x21;    // bmRequestType: class, interface, host to device
constexpr std::uint8_t kSetControlLineState = 0x22;  // USB CDC PSTN 1.2, 6.3.12
constexpr std::uint16_t kDtr = 1;
constexpr unsigned kControlTimeout_ms = 300;
constexpr std::int64_t kIdle_ns = 100'000'000;

}  // namespace

struct UsbSession::Transfer {
  explicit Transfer(UsbSession& session) : owner(session), usb(libusb_alloc_transfer(0)) {
    if (usb == nullptr) throw std::bad_alloc();
  }
  ~Transfer() { libusb_free_transfer(usb); }
  Transfer(const Transfer&) = delete;
  Transfer& operator=(const Transfer&) = delete;

  UsbSession& owner;
  libusb_transfer* usb;
  std::array<std::uint8_t, 256> data{};
  bool is_in_flight = false;
};

UsbSession::UsbSession(libusb_context* context, const UsbDevice& device, const Options& options, UsbCounters& counters)
    : name_(describe(device)), options_(options), counters_(counters), context_(context) {
  packets_.resize(options.queued_packets);
  try {
    open(context, device);
    find_endpoints();
    make_transfers(options);
    const Lock lock(mutex_);
    for (auto& transfer : in_.transfers) (void)submit(in_, *transfer);
    // The device says nothing before it sees DTR, so reads wait for it and not the other way round. The line coding
    // stays as it is: a Teensy has no baud rate, and 134 would send it into its boot loader.
    if (!set_line_state(true)) lose("takes no request (SET_CONTROL_LINE_STATE)");
  } catch (...) {
    give_back();  // nothing is under way yet: all that throws comes before the first transfer
    throw;
  }
}

UsbSession::~UsbSession() {
  if (!is_closed()) give_back();
}

void UsbSession::open(libusb_context* context, const UsbDevice& device) {
  const auto fail = [&](const std::string& what) { throw DeviceError(Fault::kDisconnected, name_ + ": " + what); };
  // Opened here and handed over, since libusb_open() finds only what its own list knows, and without a running udev
  // that list does not learn of new devices.
  fd_ = ::open(device.node.c_str(), O_RDWR | O_CLOEXEC);
  if (fd_ < 0) fail("cannot open " + device.node.string() + ": " + std::generic_category().message(errno));
  if (const int error = libusb_wrap_sys_device(context, fd_, &handle_); error != 0)
    fail(std::string("cannot be opened: ") + libusb_error_name(error));
  // Detach and claim in one step of the kernel, which refuses it while another program holds the interface.
  (void)libusb_set_auto_detach_kernel_driver(handle_, 1);
  for (const int interface : {kControlInterface, kDataInterface}) {
    const int error = libusb_claim_interface(handle_, interface);
    if (error == LIBUSB_ERROR_BUSY) {
      fail("another program holds it; stop it first (`fuser -v " + device.node.string() + "` names it)");
    }
    if (error != 0) fail(std::string("cannot be claimed: ") + libusb_error_name(error));
    ++claimed_;
  }
}

void UsbSession::find_endpoints() {
  libusb_config_descriptor* config = nullptr;
  if (libusb_get_active_config_descriptor(libusb_get_device(handle_), &config) == 0) {
    for (int i = 0; i < config->bNumInterfaces; ++i) {
      const auto& setting = config->interface[i].altsetting[0];
      if (setting.bInterfaceNumber != kDataInterface || setting.bInterfaceClass != LIBUSB_CLASS_DATA) continue;
      for (const auto& endpoint : std::span(setting.endpoint, setting.bNumEndpoints)) {
        if ((endpoint.bmAttributes & 3U) != LIBUSB_TRANSFER_TYPE_BULK) continue;
        const bool is_in = (endpoint.bEndpointAddress & LIBUSB_ENDPOINT_IN) != 0;
        (is_in ? in_ : out_).endpoint = endpoint.bEndpointAddress;  // 0x84 and 0x03 on a Teensy 3.6
      }
    }
    libusb_free_config_descriptor(config);
  }
  if (in_.endpoint == 0 || out_.endpoint == 0)
    throw DeviceError(Fault::kIdentity, name_ + ": has no serial port (CDC data interface 1); it is no Teensy");
}

void UsbSession::make_transfers(const Options& options) {
  for (std::size_t i = 0; i < options.read_transfers; ++i) {
    auto& t = in_.transfers.emplace_back(std::make_unique<Transfer>(*this));
    libusb_fill_bulk_transfer(t->usb, handle_, in_.endpoint, t->data.data(), kPacket, completed, t.get(), 0);
  }
  for (std::size_t i = 0; i < options.write_transfers; ++i) {
    auto& t = out_.transfers.emplace_back(std::make_unique<Transfer>(*this));
    libusb_fill_bulk_transfer(t->usb, handle_, out_.endpoint, t->data.data(), 0, completed, t.get(),
                              static_cast<unsigned>(options.write_timeout_ns / 1'000'000));
  }
  control_.transfers.emplace_back(std::make_unique<Transfer>(*this));
}

bool UsbSession::submit(Pipe& pipe, Transfer& transfer) noexcept {
  const int error = libusb_submit_transfer(transfer.usb);
  if (error == 0) {
    transfer.is_in_flight = true;
    ++pipe.in_flight;
  } else if (error == LIBUSB_ERROR_NO_DEVICE) {
    lose("the device is gone");
  } else {
    judge(pipe, LIBUSB_TRANSFER_ERROR, clock::RealClock{}.now_ns());
  }
  return error == 0;
}

bool UsbSession::set_line_state(bool has_terminal) noexcept {
  Transfer& t = *control_.transfers.front();
  libusb_fill_control_setup(t.data.data(), kClassInterfaceOut, kSetControlLineState, has_terminal ? kDtr : 0,
                            kControlInterface, 0);
  libusb_fill_control_transfer(t.usb, handle_, t.data.data(), completed, &t, kControlTimeout_ms);
  return submit(control_, t);
}

void UsbSession::completed(libusb_transfer* usb) noexcept {
  const std::int64_t now_ns = clock::RealClock{}.now_ns();
  auto& transfer = *static_cast<Transfer*>(usb->user_data);
  UsbSession& session = transfer.owner;
  const Lock lock(session.mutex_);
  ++session.completed_transfers_;
  transfer.is_in_flight = false;
  if (usb->endpoint == 0) {
    --session.control_.in_flight;
    if (usb->status != LIBUSB_TRANSFER_COMPLETED && !session.is_closing_)
      session.lose("does not answer (SET_CONTROL_LINE_STATE)");
  } else if ((usb->endpoint & LIBUSB_ENDPOINT_IN) != 0) {
    --session.in_.in_flight;
    session.read_completed(transfer, now_ns);
  } else {
    --session.out_.in_flight;
    session.write_completed(transfer, now_ns);
  }
  session.changed_.notify_all();
}

void UsbSession::read_completed(Transfer& transfer, std::int64_t now_ns) noexcept {
  const auto size = static_cast<std::size_t>(std::max(transfer.usb->actual_length, 0));
  if (size > 0 && packet_count_ < packets_.size()) {
    Packet& packet = packets_[(first_packet_ + packet_count_++) % packets_.size()];
    std::memcpy(packet.bytes.data(), transfer.data.data(), size);
    packet.size = size;
    packet.mono_ns = now_ns;
  } else if (size > 0) {
    ++counters_.overruns;
  }
  judge(in_, transfer.usb->status, now_ns);
  if (!is_closing_ && loss_ == nullptr && !in_.needs_recovery) (void)submit(in_, transfer);
}

void UsbSession::write_completed(Transfer& transfer, std::int64_t now_ns) noexcept {
  const int status = transfer.usb->status;
  if (status != LIBUSB_TRANSFER_COMPLETED) {
    ++counters_.lost_writes;
    write_failure_ = status;
  }
  // A device that takes nothing is no failure of the endpoint.
  if (status != LIBUSB_TRANSFER_TIMED_OUT) judge(out_, status, now_ns);
}

void UsbSession::judge(Pipe& pipe, int status, std::int64_t now_ns) noexcept {
  switch (status) {
    case LIBUSB_TRANSFER_COMPLETED:
      pipe.failing_since_ns = 0;
      return;
    case LIBUSB_TRANSFER_CANCELLED:
      return;
    case LIBUSB_TRANSFER_NO_DEVICE:
      lose("the device is gone (unplugged, or reset)");
      return;
    default:
      break;
  }
  const bool is_stall = status == LIBUSB_TRANSFER_STALL;
  // All that was queued fails with the first; that is one incident.
  if (!pipe.needs_recovery || (is_stall && !pipe.needs_clear)) ++(is_stall ? counters_.stalls : counters_.errors);
  const bool is_new = now_ns - pipe.last_failure_ns > options_.error_patience_ns;
  if (pipe.failing_since_ns == 0 || is_new) pipe.failing_since_ns = now_ns;
  pipe.last_failure_ns = now_ns;
  pipe.needs_clear = pipe.needs_clear || is_stall;
  if (pipe.needs_recovery) return;
  pipe.needs_recovery = true;
  pipe.retry_ns = is_stall ? now_ns : now_ns + options_.error_pause_ns;
  cancel(pipe);
}

void UsbSession::cancel(Pipe& pipe) noexcept {
  for (auto& transfer : pipe.transfers) {
    if (transfer->is_in_flight) (void)libusb_cancel_transfer(transfer->usb);
  }
}

void UsbSession::lose(const char* why) noexcept {
  if (loss_ == nullptr) loss_ = why;
  changed_.notify_all();
}

std::int64_t UsbSession::service() noexcept {
  Lock lock(mutex_);
  const std::int64_t now_ns = clock::RealClock{}.now_ns();
  if (!is_closing_) {
    std::int64_t next_ns = now_ns + kIdle_ns;
    for (Pipe* pipe : {&in_, &out_}) {
      if (!pipe->needs_recovery || loss_ != nullptr) continue;
      if (pipe->in_flight == 0 && now_ns >= pipe->retry_ns) recover(lock, *pipe, now_ns);
      if (pipe->needs_recovery) next_ns = std::min(next_ns, std::max(pipe->retry_ns, now_ns + 1'000'000));
    }
    return next_ns;
  }
  if (!is_cancelled_) {
    is_cancelled_ = true;
    // What was written last may be the order to vent: it goes, or ends by its own time-out.
    for (Pipe* pipe : {&in_, &control_}) cancel(*pipe);
  }
  if (in_.in_flight + out_.in_flight + control_.in_flight > 0) return now_ns + kIdle_ns;
  if (!is_line_dropped_) {
    is_line_dropped_ = true;  // as a terminal does that hangs up; the device need not take it
    if (loss_ == nullptr && set_line_state(false)) return now_ns + kIdle_ns;
  }
  lock.unlock();
  give_back();
  lock.lock();
  is_closed_ = true;
  changed_.notify_all();
  return now_ns + kIdle_ns;
}

void UsbSession::recover(Lock& lock, Pipe& pipe, std::int64_t now_ns) noexcept {
  if (pipe.failing_since_ns != 0 && now_ns - pipe.failing_since_ns > options_.error_patience_ns) {
    lose("every transfer fails; check cable and hub");
    return;
  }
  if (pipe.needs_clear) {
    lock.unlock();
    const int error = libusb_clear_halt(handle_, pipe.endpoint);
    lock.lock();
    if (error == LIBUSB_ERROR_NO_DEVICE) return lose("the device is gone (unplugged, or reset)");
    if (error != 0) {
      pipe.retry_ns = clock::RealClock{}.now_ns() + options_.error_pause_ns;
      return;
    }
  }
  pipe.needs_recovery = pipe.needs_clear = false;
  if (&pipe == &in_ && !is_closing_) {
    for (auto& transfer : in_.transfers) {
      if (!transfer->is_in_flight && !in_.needs_recovery) (void)submit(in_, *transfer);
    }
  }
  changed_.notify_all();
}

void UsbSession::give_back() noexcept {
  if (handle_ != nullptr) {
    // Data first: cdc_acm takes its port back with the control interface and needs both for it.
    while (claimed_ > 0) (void)libusb_release_interface(handle_, --claimed_);
    libusb_close(std::exchange(handle_, nullptr));
  }
  if (fd_ >= 0) ::close(std::exchange(fd_, -1));
}

void UsbSession::fail_lost() const {
  throw DeviceError(Fault::kDisconnected, name_ + ": " + loss_);
}

UsbSession::Received UsbSession::read(std::span<std::uint8_t> out, std::int64_t timeout_ns) {
  Lock lock(mutex_);
  changed_.wait_for(lock, std::chrono::nanoseconds(std::max<std::int64_t>(timeout_ns, 0)),
                    [&] { return packet_count_ > 0 || loss_ != nullptr; });
  if (packet_count_ == 0) {
    if (loss_ != nullptr) fail_lost();
    return {};
  }
  Packet& packet = packets_[first_packet_];
  const std::size_t size = std::min(out.size(), packet.size);
  std::memcpy(out.data(), packet.bytes.data(), size);
  const Received received{size, packet.mono_ns};
  if (size < packet.size) {
    std::memmove(packet.bytes.data(), packet.bytes.data() + size, packet.size -= size);
  } else {
    first_packet_ = (first_packet_ + 1) % packets_.size();
    --packet_count_;
  }
  return received;
}

void UsbSession::write(std::span<const std::uint8_t> bytes) {
  Lock lock(mutex_);
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::nanoseconds(options_.write_timeout_ns);
  while (!bytes.empty()) {
    const auto is_free = [](const auto& transfer) { return !transfer->is_in_flight; };
    auto slot = out_.transfers.end();
    const bool has_room = changed_.wait_until(lock, deadline, [&] {
      if (loss_ != nullptr || write_failure_ != 0) return true;
      slot = out_.needs_recovery ? out_.transfers.end() : std::ranges::find_if(out_.transfers, is_free);
      return slot != out_.transfers.end();
    });
    if (loss_ != nullptr) fail_lost();
    if (!has_room || write_failure_ != 0) {
      const int failure = std::exchange(write_failure_, 0);
      throw DeviceError(Fault::kTimeout, name_ + (failure == 0 || failure == LIBUSB_TRANSFER_TIMED_OUT
                                                      ? ": the device takes no data; its program hangs"
                                                      : ": an earlier write failed on the bus; it was cleared"));
    }
    Transfer& transfer = **slot;
    const std::size_t size = std::min(bytes.size(), transfer.data.size());
    std::memcpy(transfer.data.data(), bytes.data(), size);
    transfer.usb->length = static_cast<int>(size);
    if (!submit(out_, transfer)) {
      ++counters_.lost_writes;
      if (loss_ != nullptr) fail_lost();
      throw DeviceError(Fault::kTimeout, name_ + ": the bus takes no write; it is cleared");
    }
    bytes = bytes.subspan(size);
  }
}

bool UsbSession::close(std::int64_t timeout_ns) noexcept {
  Lock lock(mutex_);
  is_closing_ = true;
  libusb_interrupt_event_handler(context_);
  return changed_.wait_for(lock, std::chrono::nanoseconds(timeout_ns), [&] { return is_closed(); });
}

}  // namespace isorig::pressure
