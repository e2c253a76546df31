// The Teensy's bytes: through the driver, from the first answer on, and a host's bytes through the device's half.
#include "drivers/pressure/teensy.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>

#include "drivers/api/error.hpp"
#include "messages/teensy/cobs.hpp"
#include "messages/teensy/device.hpp"
#include "target.hpp"

namespace isorig::fuzz {
namespace {

namespace wire = messages::teensy;

/// A frame with the right CRC round any version, type and body: damage that no CRC finds, and a device that lies.
wire::Frame sealed(Bytes packet) {
  std::array<std::uint8_t, wire::kMaxPayload> payload{};
  const auto size = std::min(packet.size(), payload.size() - wire::kCrcSize);
  std::copy_n(packet.begin(), size, payload.begin());
  const auto crc = wire::crc32c(payload.data(), size);
  for (std::size_t i = 0; i < wire::kCrcSize; ++i) payload[size + i] = static_cast<std::uint8_t>(crc >> (8U * i));
  wire::Frame frame;
  frame.size = wire::cobs_encode(payload.data(), size + wire::kCrcSize, frame.bytes) + 1;
  frame.bytes[frame.size - 1] = 0;
  return frame;
}

/// The next bytes of the input as a device, or a host, sends them.
std::vector<std::uint8_t> chunk(Input& in) {
  const auto how = in.byte();
  const auto bytes = in.take(in.byte());
  if ((how & 1U) == 0) return {bytes.begin(), bytes.end()};
  const auto frame = sealed(bytes);
  return {frame.bytes, frame.bytes + frame.size};
}

/// Its device answers who it is as a Teensy does, unless the input has another answer for that.
class Stream final : public pressure::ByteStream {
 public:
  Stream(Input& in, clock::VirtualClock& clock, bool honest) : in_(in), clock_(clock), honest_(honest) {}
  void open() override { is_open_ = true; }
  void close() noexcept override { is_open_ = false; }
  [[nodiscard]] bool is_open() const noexcept override { return is_open_; }
  std::size_t read_some(std::span<std::uint8_t> out, std::int64_t timeout_ns) override {
    if (coming_.empty() && !in_.empty()) coming_ = chunk(in_);
    if (coming_.empty()) {
      clock_.sleep_until_ns(clock_.now_ns() + std::max<std::int64_t>(timeout_ns, 0));
      return 0;
    }
    clock_.sleep_until_ns(clock_.now_ns() + 1000);
    const auto size = std::min(out.size(), coming_.size());
    std::copy_n(coming_.begin(), size, out.begin());
    coming_.erase(coming_.begin(), coming_.begin() + static_cast<std::ptrdiff_t>(size));
    return size;
  }
  void write_all(std::span<const std::uint8_t> bytes) override {
    decoder_.feed(bytes.data(), bytes.size(), [this](const wire::Packet& packet) {
      if (!honest_) return;
      if (wire::IdentityRequest request; parse(packet, request)) {
        wire::Identity identity;
        identity.session = request.session;
        identity.sample_rate_mhz = 1'000'000;
        identity.watchdog_ms = 200;
        identity.device_us = 10'000'000;
        identity.next_sequence = 100;
        std::strcpy(identity.model, "isorig-teensy36");
        std::strcpy(identity.serial, "1234560");
        push(encode(identity));
      }
      if (wire::Limits limits; parse(packet, limits)) push(encode(wire::LimitsReply{limits, 1}));
    });
  }
  [[nodiscard]] std::string name() const override { return "fuzzed"; }

 private:
  void push(const wire::Frame& frame) { coming_.insert(coming_.end(), frame.bytes, frame.bytes + frame.size); }

  Input& in_;
  clock::VirtualClock& clock_;
  bool honest_;
  bool is_open_ = false;
  std::vector<std::uint8_t> coming_;
  wire::Decoder decoder_;
};

void run_driver(Input in, bool honest) {
  clock::VirtualClock clock{5'000'000'000};
  pressure::Teensy device({.serial = "1234560"}, std::make_unique<Stream>(in, clock, honest), clock);
  device.set_limits({30.0, 100, 20'000});
  std::array<pressure::Sample, 64> samples{};
  std::array<clock::Exchange, 64> exchanges{};
  for (int turn = 0; turn < 64 && !(turn > 0 && in.empty()); ++turn) {
    try {
      (void)device.connect();
      for (int polls = 0; polls < 256 && !in.empty(); ++polls) {
        const auto poll = device.poll(samples, exchanges, 1'000'000);
        require(poll.samples <= samples.size() && poll.exchanges <= exchanges.size(), "more samples than room");
        while (device.take_sync_edge()) {
        }
        if (polls % 4 == 0) device.request_time_sync();
        if (polls % 4 == 1) device.heartbeat();
        if (polls % 4 == 2) device.command({static_cast<std::uint16_t>(polls), 0});
      }
    } catch (const drivers::DeviceError& error) {
      refused(error.what());
    }
    device.disconnect();
  }
}

class Valves final : public wire::Board {
 public:
  [[nodiscard]] std::uint64_t now_us() noexcept override { return now_us_ += 250; }
  [[nodiscard]] bool send(const std::uint8_t*, std::size_t size) noexcept override {
    require(size <= wire::kMaxFrame, "a frame longer than the longest");
    return ++sent_ % 8 != 0;
  }
  void set_valves(std::uint16_t fill_permille, std::uint16_t vent_permille) noexcept override {
    require(fill_permille <= 1000 && vent_permille <= 1000 && (fill_permille == 0 || vent_permille == 0),
            "both valves open, or a duty beyond 1000");
  }
  std::uint64_t now_us_ = 0;
  unsigned sent_ = 0;
};

void run_device(Input in) {
  Valves valves;
  wire::DeviceCore device({.model = "isorig-teensy36", .serial = "1", .firmware = "0"}, valves);
  device.start();
  while (!in.empty()) {
    const auto bytes = chunk(in);
    device.receive(bytes.data(), bytes.size());
    const auto what = in.byte();
    if ((what & 1U) != 0) device.add_sample(valves.now_us_, static_cast<std::uint32_t>(in.word()) << 16U);
    if ((what & 2U) != 0) valves.now_us_ += in.word();
    device.tick();
  }
}

}  // namespace
}  // namespace isorig::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isorig::fuzz;
  Input in(data, size);
  const auto mode = in.byte();
  if (mode % 4 == 3) {
    run_device(in);
  } else {
    run_driver(in, mode % 4 != 2);
  }
  return 0;
}
