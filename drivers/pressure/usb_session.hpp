#pragma once
#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "drivers/pressure/usb_devices.hpp"

struct libusb_context;
struct libusb_device_handle;
struct libusb_transfer;

namespace isorig::pressure {

/// Since construction of the stream.
struct UsbCounters {
  std::atomic<std::uint64_t> stalls{0};       ///< halts of an endpoint, cleared
  std::atomic<std::uint64_t> errors{0};       ///< failed bus transactions (EPROTO and its like), tried again
  std::atomic<std::uint64_t> lost_writes{0};  ///< writes that never reached the device
  std::atomic<std::uint64_t> overruns{0};     ///< packets thrown away because nobody read
};

/// One open Teensy: its two interfaces claimed, DTR raised, reads queued on the bulk IN endpoint.
///
/// Transfers complete in the event thread, which alone runs service(). Callbacks submit and cancel, never more: the
/// endpoint is cleared (a control transfer that the kernel waits for) between events, so no callback waits, and no
/// other thread waits for an endpoint 0 that does not answer.
class UsbSession {
 public:
  struct Options {
    /// Each of one packet: a longer one would wait for a packet to follow when the last is full (no zero-length
    /// packet ends a frame of 64 bytes). 32 are 4 kHz for 8 ms, or what the device holds itself, four times.
    std::size_t read_transfers = 32;
    std::size_t write_transfers = 16;
    std::int64_t write_timeout_ns = 50'000'000;
    std::int64_t error_pause_ns = 5'000'000;       ///< before a failed endpoint is tried again
    std::int64_t error_patience_ns = 500'000'000;  ///< nothing but failures for so long: the device is gone
    std::size_t queued_packets = 2048;             ///< read and not taken yet: 2 s at 1 kHz
  };

  /// Claims and starts it. Throws drivers::DeviceError.
  UsbSession(libusb_context* context, const UsbDevice& device, const Options& options, UsbCounters& counters);
  ~UsbSession();
  UsbSession(const UsbSession&) = delete;
  UsbSession& operator=(const UsbSession&) = delete;

  struct Received {
    std::size_t size = 0;
    std::int64_t mono_ns = 0;
  };
  /// As ByteStream::read_some(), one packet at a time.
  Received read(std::span<std::uint8_t> out, std::int64_t timeout_ns);
  void write(std::span<const std::uint8_t> bytes);
  /// Cancels what is under way; true once the device is given back. After false the event thread goes on with it.
  bool close(std::int64_t timeout_ns) noexcept;

  /// Event thread, between events: clears, resubmits, closes. Returns when it wants to be called again, at the latest.
  std::int64_t service() noexcept;
  [[nodiscard]] bool is_closed() const noexcept { return is_closed_.load(); }
  /// For the event thread only.
  [[nodiscard]] std::uint64_t completed_transfers() const noexcept { return completed_transfers_; }

 private:
  static constexpr std::size_t kPacket = 64;  // of a full-speed bulk endpoint
  struct Transfer;
  struct Pipe {
    std::uint8_t endpoint = 0;
    std::vector<std::unique_ptr<Transfer>> transfers;
    std::size_t in_flight = 0;
    bool needs_recovery = false;
    bool needs_clear = false;
    std::int64_t retry_ns = 0;
    std::int64_t failing_since_ns = 0;  // 0: the last transfer succeeded
    std::int64_t last_failure_ns = 0;
  };
  struct Packet {
    std::array<std::uint8_t, kPacket> bytes;
    std::size_t size = 0;
    std::int64_t mono_ns = 0;
  };
  using Lock = std::unique_lock<std::mutex>;

  void open(libusb_context* context, const UsbDevice& device);
  void find_endpoints();
  void make_transfers(const Options& options);
  static void completed(libusb_transfer* transfer) noexcept;
  void read_completed(Transfer& transfer, std::int64_t now_ns) noexcept;
  void write_completed(Transfer& transfer, std::int64_t now_ns) noexcept;
  /// What the outcome of a transfer means for its endpoint.
  void judge(Pipe& pipe, int status, std::int64_t now_ns) noexcept;
  bool submit(Pipe& pipe, Transfer& transfer) noexcept;
  bool set_line_state(bool has_terminal) noexcept;
  void cancel(Pipe& pipe) noexcept;
  void recover(Lock& lock, Pipe& pipe, std::int64_t now_ns) noexcept;
  void give_back() noexcept;
  void lose(const char* why) noexcept;
  [[noreturn]] void fail_lost() const;

  std::string name_;
  Options options_;
  UsbCounters& counters_;
  libusb_context* context_ = nullptr;
  int fd_ = -1;
  libusb_device_handle* handle_ = nullptr;
  int claimed_ = 0;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  Pipe in_, out_, control_;
  std::vector<Packet> packets_;  // a ring
  std::size_t first_packet_ = 0, packet_count_ = 0;
  int write_failure_ = 0;  // libusb_transfer_status of a write that the caller does not know of yet
  const char* loss_ = nullptr;
  bool is_closing_ = false, is_cancelled_ = false, is_line_dropped_ = false;
  std::atomic<bool> is_closed_{false};
  std::uint64_t completed_transfers_ = 0;
};

}  // namespace isorig::pressure
