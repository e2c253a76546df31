#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/api/clock.hpp"
#include "drivers/api/frame.hpp"
#include "drivers/config/modbus_config.hpp"
#include "drivers/modbus/modbus_link.hpp"

namespace isorig::frame {

/// A frame behind a Modbus gateway, TCP or RTU, with any register map (docs/wire-frame.md).
///
/// Samples: the frame writes each into a ring and counts it. A poll reads the header (counter, times), the
/// slots that are new, and the header again. What the frame may have overwritten between the two headers is
/// dropped and counted in Poll::lost; so is what was overwritten before the poll, and, where the frame dates each
/// sample, a slot whose stamp is not that of its place. A sample is given once or counted lost, never neither. After a
/// lost connection the next poll goes on where the last one ended, if the ring still has it.
///
/// Counter and clock are checked against elapsed host time: a jump that time does not explain is read again
/// (a 32-bit number may be torn between its registers), and if it stays the frame was restarted:
/// kDisconnected, and connect() starts a new count and a new device time.
///
/// Blocking; one thread only. In response time-outs, with a line that is not in doubt (the link says what getting back
/// in step adds, once): poll() 4, start_segment() 5 and start_confirm_ms, stop() and heartbeat() 1.
class ModbusFrame final : public Device {
 public:
  ModbusFrame(modbus::ModbusConfig config, clock::Clock& clock);

  Identity connect() override;
  void disconnect() noexcept override;
  Poll poll(std::span<Sample> out) override;
  /// Set-points are written and read back before the command, so that nothing starts towards a clamped
  /// target; then the frame's state has to show the segment within start_confirm_ms, or it is stopped again.
  void start_segment(const Segment& segment) override;
  /// Goes out at once, whatever is in doubt. No answer is kTimeout: give it again, which a stop may be.
  void stop() override;
  void heartbeat(std::uint16_t counter) override;

  struct Statistics {
    std::uint64_t polls = 0;
    std::uint64_t lost_samples = 0;
    std::uint64_t misplaced_samples = 0;  ///< of those: counted by the frame, and not in their slots
    std::uint64_t reread_headers = 0;     ///< jumps that a second look took back
    std::uint64_t resyncs = 0;            ///< times the line was in doubt
  };
  [[nodiscard]] Statistics statistics() const noexcept;

 private:
  /// Of a poll or of a start: a gateway that is just fast enough for each takes no longer for all of them.
  static constexpr int kRequestsAtOnce = 4;
  /// What one request says about "now".
  struct Header {
    std::uint32_t counter = 0;  // as counted by the frame, of its own width
    std::uint32_t index = 0;
    double device_us = 0.0;  // extended over the clock's wraps
    double newest_us = 0.0;  // likewise; equal to device_us when not mapped
    std::int64_t sent_ns = 0;
    std::int64_t received_ns = 0;
  };

  /// Samples. Beyond twice what time explains and this a counter has jumped: it covers a frame that hands samples on in
  /// bursts; a torn word is 65536 off.
  static constexpr double kAdvanceSlack = 256.0;

  Header read_header();
  [[nodiscard]] std::uint32_t newer_by(std::uint32_t counter, std::uint32_t than) const noexcept;
  [[nodiscard]] bool explained(std::uint32_t advance, std::int64_t now_ns) const noexcept;
  void note_advance(const Header& header) noexcept;
  void take_words(const modbus::ReadBlock& block, std::span<const std::uint16_t> words);
  [[nodiscard]] double value(modbus::Quantity quantity) const;
  [[nodiscard]] std::uint16_t code(modbus::Quantity quantity) const;
  void read_state_blocks();
  [[nodiscard]] State decode_state() const;
  std::size_t read_slots(std::uint32_t first_counter, std::size_t count, const Header& header);
  /// How many of them were in their slots, by their stamps; those come first in `out`.
  std::size_t decode_samples(std::uint32_t first_counter, std::span<Sample> out, const Header& header);
  [[nodiscard]] static double turn_us(const modbus::NumberFormat& format) noexcept;
  [[nodiscard]] double unwrap_us(const modbus::NumberFormat& format, double raw_us, double expected_us) const noexcept;
  void resume_or_restart(const Identity& identity);
  /// Clock and counter have gone on as those of a frame that never stopped, and are wide enough to tell.
  [[nodiscard]] bool went_on(const Header& header) const noexcept;
  [[nodiscard]] std::string read_text(const std::optional<modbus::TextRegisters>& text);
  void check_identity(const Identity& identity) const;
  void write_setpoints(const Segment& segment);
  void write_command(std::uint16_t command);
  /// All requests from now on together take no longer than so many response time-outs.
  void limit_to(int response_timeouts) noexcept;
  void confirm(const Segment& segment);
  [[nodiscard]] std::string at() const { return "frame at " + config_.where() + ": "; }

  modbus::ModbusConfig config_;
  clock::Clock& clock_;
  modbus::ModbusLink link_;
  modbus::ReadBlock header_block_;
  std::vector<modbus::ReadBlock> state_blocks_;
  std::array<std::array<std::uint16_t, 2>, modbus::kQuantities> words_{};  // newest registers of each quantity
  std::vector<std::uint16_t> slot_words_;

  double rate_Hz_ = 0.0;
  std::string serial_;
  bool has_history_ = false;
  std::uint32_t reference_epoch_ = 0;
  std::uint32_t sequence_ = 0;        // of the last sample given (or counted lost), extended to 32 bit
  std::uint32_t counter_ = 0;         // the same as the frame counts it
  std::uint32_t newest_counter_ = 0;  // newest the frame ever showed
  std::int64_t advanced_ns_ = 0;      // when that was
  double anchor_device_us_ = 0.0;     // device time at anchor_ns_, for unwrapping
  std::int64_t anchor_ns_ = 0;
  double last_device_us_ = 0.0;  // of the newest header read
  double last_sample_us_ = 0.0;  // of the last sample given
  Statistics statistics_;
};

}  // namespace isorig::frame
