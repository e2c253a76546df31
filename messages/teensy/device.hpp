#pragma once
#include <stddef.h>
#include <stdint.h>

#include "messages/teensy/decoder.hpp"
#include "messages/teensy/fill_guard.hpp"
#include "messages/teensy/wire.hpp"

namespace isorig::messages::teensy {

/// What DeviceCore needs of the hardware. Firmware, emulator and tests implement it.
class Board {
 public:
  /// The device clock, 64 bit: never wraps, never steps.
  [[nodiscard]] virtual uint64_t now_us() noexcept = 0;
  /// Hands over one whole frame to be sent at once (no waiting for a packet to fill). Never blocks: false,
  /// and nothing sent, when there is no room for all of it.
  [[nodiscard]] virtual bool send(const uint8_t* bytes, size_t size) noexcept = 0;
  virtual void set_valves(uint16_t fill_permille, uint16_t vent_permille) noexcept = 0;

 protected:
  ~Board() = default;
};

/// The device's half of the protocol: the same state machine in the firmware, the emulator and the tests.
///
/// Valves:
///  - At start: fill closed, vent open.
///  - They obey only while heartbeats arrive; without them nothing but a full vent is accepted.
///  - They fill only within the limits that the host has set in this session (Limits; fill_guard.hpp), and a breach
///    opens the vent and latches, whatever the host still says.
///  - Watchdog: once a heartbeat came, `watchdog_ms` without one opens the vent and latches, unless the vent is
///    fully open anyway: a host that vents and goes away leaves nothing to report.
///  - Latched, commands are refused. Only one for what the device already does (fill 0, vent 1000), while
///    heartbeats arrive, releases it: a host that never noticed and still asks for pressure does not get it.
///  - Validity: a command that is not renewed in time closes both valves (pressure is held), except that a
///    full vent stays: asking for the safe state needs no renewal.
///
/// Sending never waits. Samples that find no room are dropped and counted, and their sequence numbers are
/// gone, so the host sees both. One context calls all members, tick() at 1 kHz or more.
class DeviceCore {
 public:
  struct Options {
    const char* model = "isorig-teensy36";  ///< the texts outlive the core
    const char* serial = "";
    const char* firmware = "";
    uint32_t sample_rate_mhz = 1'000'000;
    /// Two hundred missed 1 kHz cycles: far beyond any jitter, well before a leak or fill matters.
    uint16_t watchdog_ms = 200;
    /// Samples per frame. One at 1 kHz, since a frame fills no USB packet anyway and waiting only adds age;
    /// four or more at 4 kHz.
    uint8_t batch_samples = 1;
    uint32_t batch_age_us = 1'000;  ///< a batch is sent when its first sample is this old
    uint32_t status_period_us = 100'000;
  };

  DeviceCore(const Options& options, Board& board) noexcept;

  /// Puts the valves into the safe state.
  void start() noexcept;
  /// Whether a host has the port open (DTR). Without one nothing is sent, nothing counts as dropped; sequence
  /// numbers and the watchdog go on.
  void set_link_up(bool is_up) noexcept;
  void receive(const uint8_t* bytes, size_t size) noexcept;
  /// `is_conversion`: not a mere report of what the sensor's line shows; such a word is sent and not believed.
  void add_sample(uint64_t device_us, uint32_t raw_word, bool is_conversion = true) noexcept;
  /// Conversions known to be missed: their sequence numbers are skipped.
  void skip_samples(uint32_t count) noexcept { next_sequence_ += count; }
  void sync_edge(uint64_t device_us, bool is_high) noexcept;
  /// Watchdog, command validity, batches that are due, periodic status.
  void tick() noexcept;

  [[nodiscard]] Status status() noexcept;
  /// Latched, for whatever cause.
  [[nodiscard]] bool has_vented_itself() const noexcept { return is_latched_; }
  void set_serial(const char* serial) noexcept { options_.serial = serial; }

 private:
  void handle(const Packet& packet) noexcept;
  void open_session(uint32_t session) noexcept;
  void handle(const ValveCommand& command, uint64_t now_us) noexcept;
  void handle(const Limits& limits) noexcept;
  void apply(uint16_t fill_permille, uint16_t vent_permille) noexcept;
  void send_batch() noexcept;
  bool send(const Frame& frame) noexcept;
  void vent_itself(VentCause cause) noexcept;
  [[nodiscard]] bool is_heartbeat_recent(uint64_t now_us) const noexcept {
    return now_us - last_heartbeat_us_ <= uint64_t{options_.watchdog_ms} * 1000U;
  }

  Options options_;
  Board& board_;
  Decoder decoder_;
  bool is_link_up_ = true;
  bool has_session_ = false;

  Samples batch_;
  uint64_t batch_first_us_ = 0;
  uint32_t next_sequence_ = 0;
  uint32_t dropped_ = 0;
  uint32_t edges_ = 0;

  uint32_t rejected_ = 0;
  uint32_t unexpected_ = 0;  // right CRC, but not a message for a device of this version

  bool is_armed_ = false;  // by the first heartbeat
  uint64_t last_heartbeat_us_ = 0;
  FillGuard guard_;
  bool has_limits_ = false;  // of this session; those of the one before stay in force until then
  bool is_latched_ = false;
  VentCause cause_ = VentCause::kNone;
  uint16_t self_vents_ = 0;

  bool has_command_ = false;
  bool is_command_running_ = false;
  bool is_command_expired_ = false;
  uint32_t command_sequence_ = 0;
  uint64_t command_until_us_ = 0;
  uint16_t fill_permille_ = 0;
  uint16_t vent_permille_ = 0;

  bool is_status_due_ = false;
  uint64_t last_status_us_ = 0;
};

}  // namespace isorig::messages::teensy
