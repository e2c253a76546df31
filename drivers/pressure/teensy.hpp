#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/api/pressure.hpp"
#include "drivers/pressure/byte_stream.hpp"
#include "messages/teensy/decoder.hpp"
#include "messages/teensy/wire.hpp"

namespace isorig::pressure {

/// The Teensy that reads the ELVH and drives the valves (docs/wire-teensy.md). Owned by one I/O thread, which
/// after any DeviceError but kTimeout calls disconnect() and, as drivers::Backoff says, connect().
///
/// Device times come out extended to 64 bit over the 71.6 min wrap. Duplicates are dropped; what is missing
/// in the sequence counts as lost, also across a reconnect to a device that went on counting.
class Teensy final : public Device {
 public:
  struct Options {
    std::string serial;  ///< the only device that will do; empty takes any
    std::string model = "isorig-teensy36";
    std::int64_t connect_timeout_ns = 2'000'000'000;  ///< it answers at once, but may just be starting
    std::int64_t identity_retry_ns = 200'000'000;
    /// Both valves close when no command follows by then. Ten periods of a 100 Hz pressure loop.
    std::uint16_t command_validity_ms = 100;
  };

  /// Since construction, beyond what Poll says.
  struct Counters {
    std::uint64_t duplicates = 0;
    std::uint64_t unexpected = 0;         ///< intact frames of a type, version or length that has no place here
    std::uint64_t unmatched_replies = 0;  ///< time-sync replies whose request is unknown or too old
    std::uint64_t sync_edges_lost = 0;
  };

  Teensy(Options options, std::unique_ptr<ByteStream> stream, const clock::Clock& clock);
  ~Teensy() override { disconnect(); }
  Teensy(const Teensy&) = delete;
  Teensy& operator=(const Teensy&) = delete;

  void set_limits(const FillLimits& limits) override;
  /// Throws kTimeout when nothing answers, kIdentity for another model, serial number or protocol version, or for a
  /// device that does not keep the limits.
  Identity connect() override;
  void disconnect() noexcept override;
  [[nodiscard]] bool has_reappeared() noexcept override { return stream_->has_reappeared(); }
  Poll poll(std::span<Sample> samples_out, std::span<clock::Exchange> exchanges_out, std::int64_t timeout_ns) override;
  /// Throws kRefused for duties outside 0..1000 or both above 0. Ignores `regulator_psi`.
  void command(const Command& command) override;
  void heartbeat() override;
  void request_time_sync() override;

  std::optional<SyncEdge> take_sync_edge() override;
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }
  /// After how long without heartbeat() the connected device vents.
  [[nodiscard]] std::uint16_t watchdog_ms() const noexcept { return watchdog_ms_; }

 private:
  struct Outstanding {
    std::uint32_t cookie = 0;
    std::int64_t send_ns = 0;
    bool is_waiting = false;
  };

  /// First in, first out, without allocation once it has grown.
  template <class T>
  struct Pending {
    std::vector<T> items;
    std::size_t taken = 0;
    std::size_t take(std::span<T> out) noexcept;
    void clear() noexcept { items.clear(), taken = 0; }
    [[nodiscard]] bool empty() const noexcept { return taken == items.size(); }
  };

  bool await_identity(messages::teensy::Identity& identity);
  void agree_on_limits();
  void check(const messages::teensy::Packet& packet, const messages::teensy::Identity& identity) const;
  void start_from(const messages::teensy::Identity& identity);
  void receive(std::int64_t timeout_ns);
  void handle(const messages::teensy::Packet& packet, std::int64_t recv_ns);
  void handle(const messages::teensy::Samples& samples);
  void handle(const messages::teensy::Status& status);
  void handle(const messages::teensy::TimeSyncReply& reply, std::int64_t recv_ns);
  void see_device_time(std::uint64_t device_us);
  template <class Message>
  void send(const Message& message);
  [[noreturn]] void fail(drivers::Fault fault, const std::string& what) const;

  Options options_;
  std::unique_ptr<ByteStream> stream_;
  const clock::Clock& clock_;
  messages::teensy::Decoder decoder_;
  std::array<std::uint8_t, 4096> buffer_{};  // what a tty gives at most at once

  std::uint32_t session_ = 0;
  std::uint64_t heard_bytes_ = 0;  // while it was asked who it is
  std::uint16_t watchdog_ms_ = 0;
  bool is_connected_ = false;
  bool is_known_ = false;  // connected before: sequence and time go on unless the device started anew
  bool has_partial_write_ = false;

  std::int64_t device_us_ = 0;  // last 64-bit time seen
  std::uint32_t next_sequence_ = 0;
  std::uint32_t command_sequence_ = 0;
  std::uint32_t heartbeats_ = 0;
  FillLimits limits_;
  std::optional<messages::teensy::LimitsReply> limits_reply_;
  std::optional<std::uint16_t> self_vents_;
  bool has_vented_ = false;  // since the last poll
  std::uint32_t lost_ = 0;   // since the last poll
  std::uint32_t unexpected_ = 0;
  std::uint32_t reported_corrupt_ = 0;
  State state_;

  std::uint32_t cookie_ = 0;
  std::array<Outstanding, 64> outstanding_{};
  Pending<Sample> samples_;
  Pending<clock::Exchange> exchanges_;
  Pending<messages::teensy::SyncEdge> sync_edges_;
  std::uint32_t next_edge_ = 0;
  Counters counters_;
};

}  // namespace isorig::pressure
