#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "drivers/api/clock.hpp"
#include "drivers/api/pressure.hpp"
#include "messages/teensy/device.hpp"

namespace isorig::sim {

/// What can go wrong with the emulated Teensy; set from any thread while it runs.
struct TeensyFaults {
  std::atomic<std::uint32_t> delay_to_host_us{0};
  std::atomic<std::uint32_t> delay_to_device_us{0};
  std::atomic<std::uint32_t> drop_permille{0};     ///< of the frames to the host
  std::atomic<std::uint32_t> repeat_permille{0};   ///< of the frames to the host: sent twice
  std::atomic<std::uint32_t> corrupt_permille{0};  ///< of the frames to the host: one bit flipped
  std::atomic<bool> hung_up{false};                ///< the port vanishes, the device goes on
  std::atomic<bool> unplugged{false};              ///< the port vanishes, the device loses its power and starts anew
  std::atomic<bool> frozen{false};                 ///< the firmware hangs: takes nothing, says nothing, valves stay
  std::atomic<bool> wrong_serial{false};           ///< another device of the same kind; seen at the next connect
  std::atomic<bool> stale_sensor{false};           ///< the ELVH converts no more
  std::atomic<bool> sensor_fault{false};           ///< the ELVH reports status 11
};

/// A Teensy without its port: the device's half of the protocol is the firmware's own
/// (messages/teensy/device.hpp), sensor and valves are any simulated pressure device. What carries the bytes is the
/// derived class: a pseudo-terminal (teensy_pty.hpp) or USB (teensy_usbip.hpp).
///
/// The backend stands for sensor, valves and air. Its stamps are taken as true time (`backend_epoch_ns`), on
/// which this device puts a clock of its own. It is fed with heartbeats always: the watchdog is here.
///
/// One thread calls service(); nothing in it blocks. Time is whatever that thread passes, or later by Options::clock.
class EmulatedTeensy : private messages::teensy::Board {
 public:
  struct Options {
    messages::teensy::DeviceCore::Options core{.serial = "1234560", .firmware = "emulator"};
    double skew_ppm = 0.0;              ///< device clock fast (+) or slow (-) against true time
    std::uint64_t start_us = 0;         ///< device clock at the first start
    std::int64_t backend_epoch_ns = 0;  ///< true time at the backend's device_us = 0
    std::size_t transmit_bytes = 512;   ///< 8 packets, as the USB stack of a Teensy holds
    std::uint32_t seed = 1;             ///< of the faults
    /// In real time: what came is stamped after it was taken. By the time that was passed to service(), a request that
    /// came while the thread waited its turn would have arrived before it was sent. Outlives the device.
    const clock::Clock* clock = nullptr;
  };

  virtual ~EmulatedTeensy() = default;
  EmulatedTeensy(const EmulatedTeensy&) = delete;
  EmulatedTeensy& operator=(const EmulatedTeensy&) = delete;

  /// Takes and answers what has come, samples the backend, moves its valves. At 1 kHz or more.
  void service(std::int64_t now_ns);

  /// To wait on for bytes of the host between two services; -1 while the port is gone.
  [[nodiscard]] virtual int fd() const noexcept = 0;
  /// Whether somebody has the port open, as of the last service.
  [[nodiscard]] bool is_open() const noexcept { return is_open_; }
  [[nodiscard]] TeensyFaults& faults() noexcept { return faults_; }
  [[nodiscard]] messages::teensy::Status status() noexcept { return core_->status(); }
  /// The device's clock at true time `mono_ns`, whole and fractional microseconds: the truth for tests.
  [[nodiscard]] double device_us(std::int64_t mono_ns) const noexcept;
  void sync_edge(std::int64_t mono_ns, bool is_high);

 protected:
  /// Connects the backend; the derived class then plugs itself in.
  EmulatedTeensy(const Options& options, pressure::Device& backend, std::int64_t now_ns);

  virtual void plug_in() = 0;  ///< may throw std::system_error
  virtual void pull_out() noexcept = 0;
  [[nodiscard]] virtual bool is_plugged_in() const noexcept = 0;
  /// Does what the port itself has to do, also while the firmware hangs; returns whether somebody has it open.
  virtual bool service_port() noexcept = 0;
  /// What the host sent; 0 when there is nothing.
  virtual std::size_t take(std::span<std::uint8_t> out) noexcept = 0;
  /// Takes as much of a frame as there is room for now.
  virtual std::size_t give(std::span<const std::uint8_t> bytes) noexcept = 0;
  void set_valves(std::uint16_t fill_permille, std::uint16_t vent_permille) noexcept override;
  void power_up(std::uint64_t start_us);
  /// Forgets what is under way; the port is gone.
  void clear_line() noexcept;
  [[nodiscard]] const Options& options() const noexcept { return options_; }
  [[nodiscard]] std::int64_t now_ns() const noexcept { return now_ns_; }

 private:
  struct Chunk {
    std::int64_t due_ns = 0;
    std::vector<std::uint8_t> bytes;
    std::size_t written = 0;
  };

  std::uint64_t now_us() noexcept override { return static_cast<std::uint64_t>(device_us(now_ns_)); }
  bool send(const std::uint8_t* bytes, std::size_t size) noexcept override;

  void follow_port_faults();
  void take_from_host();
  void give_to_host() noexcept;
  void sample(bool is_running);
  [[nodiscard]] std::uint32_t with_sensor_faults(std::uint32_t raw_word) noexcept;
  void move_valves();
  [[nodiscard]] bool strikes(const std::atomic<std::uint32_t>& permille) noexcept;
  std::uint32_t random() noexcept;

  Options options_;
  pressure::Device& backend_;
  TeensyFaults faults_;
  std::optional<messages::teensy::DeviceCore> core_;
  std::int64_t now_ns_;
  std::int64_t start_ns_ = 0;
  std::uint64_t start_us_ = 0;

  bool is_open_ = false;
  bool was_unplugged_ = false;
  std::deque<Chunk> to_host_;
  std::deque<Chunk> to_device_;

  std::array<pressure::Sample, 256> samples_{};
  std::optional<std::uint32_t> last_word_;
  pressure::Command valves_;
  std::int64_t valves_sent_ns_ = 0;
  bool are_valves_new_ = false;
  std::uint64_t random_state_;
};

}  // namespace isorig::sim
