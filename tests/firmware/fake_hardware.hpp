#pragma once
// A machine in virtual time: each look at the cycle counter lets a little time pass, as it does on the real
// one.
#include <cstdint>
#include <deque>
#include <variant>
#include <vector>

#include "firmware/application.hpp"
#include "firmware/model/simulated_elvh.hpp"
#include "messages/teensy/decoder.hpp"
#include "messages/teensy/wire.hpp"

namespace isorig::firmware {

using messages::teensy::Decoder;
using messages::teensy::Packet;

class FakeHardware final : public Hardware {
 public:
  static constexpr std::uint32_t kCyclesPerUs = 180;
  using Message = std::variant<messages::teensy::Identity, messages::teensy::TimeSyncReply, messages::teensy::Status,
                               messages::teensy::Samples, messages::teensy::SyncEdge>;

  [[nodiscard]] std::uint64_t now_ns() const { return (cycles - start_cycles) * 1000 / kCyclesPerUs; }

  void select(bool is_selected) noexcept override {
    if (is_selected) {
      sensor.select(now_ns());
      if (has_been_idle_ && cycles - deselected_cycles_ < 2 * kCyclesPerUs) ++bus_violations;
      selected_cycles_ = cycles;
      ++reads;
    } else {
      deselected_cycles_ = cycles;
      has_been_idle_ = true;
      if (is_shifting_) ++bus_violations;
    }
    is_selected_ = is_selected;
  }
  void start_word() noexcept override {
    if (!is_selected_ || is_shifting_ || 2 * (cycles - selected_cycles_) < 5 * kCyclesPerUs) ++bus_violations;
    word_cycles_ = cycles;
    is_shifting_ = true;
  }
  bool take_word(std::uint16_t& word) noexcept override {
    if (is_bus_dead || !is_shifting_ || cycles - word_cycles_ < word_us * kCyclesPerUs) return false;
    is_shifting_ = false;
    word = sensor.shift_word();
    return true;
  }

  std::uint32_t cycle_counter() noexcept override {
    cycles += pass_cycles;
    return static_cast<std::uint32_t>(cycles);
  }
  bool is_link_open() noexcept override { return is_open; }
  std::size_t receive(std::uint8_t* out, std::size_t size) noexcept override {
    std::size_t taken = 0;
    for (; taken < size && !to_device.empty(); ++taken) {
      out[taken] = to_device.front();
      to_device.pop_front();
    }
    return taken;
  }
  bool send(const std::uint8_t* bytes, std::size_t size) noexcept override {
    if (is_stalled) {
      if (room < size) return false;
      room -= size;
    }
    decoder_.feed(bytes, size, [this](const Packet& packet) { decode(packet); });
    return true;
  }
  void discard_output() noexcept override { ++discards; }
  void drive_coils(std::uint16_t fill, std::uint16_t vent_closing) noexcept override {
    fill_permille = fill;
    vent_closing_permille = vent_closing;
    sensor.set_valves(now_ns(), fill, static_cast<std::uint16_t>(1000 - vent_closing));
    driven_us = now_ns() / 1000;
  }
  void set_sync(bool is_high) noexcept override { sync_edges.push_back({is_high, cycles}); }
  void set_led(bool is_on) noexcept override { led_changes += is_on ? 1 : 0; }
  void feed_watchdog() noexcept override { ++feeds; }

  template <class T>
  void say(const T& message) {
    const messages::teensy::Frame frame = encode(message);
    to_device.insert(to_device.end(), frame.bytes, frame.bytes + frame.size);
  }
  template <class T>
  std::vector<T> take() {
    std::vector<T> out;
    for (const Message& message : sent)
      if (const T* value = std::get_if<T>(&message)) out.push_back(*value);
    std::erase_if(sent, [](const Message& message) { return std::holds_alternative<T>(message); });
    return out;
  }
  std::vector<messages::teensy::Sample> take_samples() {
    std::vector<messages::teensy::Sample> out;
    for (const auto& batch : take<messages::teensy::Samples>())
      out.insert(out.end(), batch.items, batch.items + batch.count);
    return out;
  }

  SimulatedElvh sensor;
  std::uint64_t cycles = 0;
  std::uint64_t start_cycles = 0;
  std::uint32_t pass_cycles = 90;  ///< half a microsecond per look at the clock
  std::uint32_t word_us = 22;
  bool is_open = true;
  bool is_stalled = false;
  std::size_t room = 0;  ///< bytes that a stalled host's buffers still take
  bool is_bus_dead = false;

  std::deque<std::uint8_t> to_device;
  std::vector<Message> sent;
  struct Edge {
    bool is_high;
    std::uint64_t cycles;
  };
  std::vector<Edge> sync_edges;
  int discards = 0;
  int led_changes = 0;
  std::uint64_t feeds = 0;
  std::uint64_t reads = 0;
  int bus_violations = 0;
  std::uint16_t fill_permille = 999;
  std::uint16_t vent_closing_permille = 999;
  std::uint64_t driven_us = 0;

 private:
  void decode(const Packet& packet) {
    messages::teensy::Identity identity;
    messages::teensy::TimeSyncReply reply;
    messages::teensy::Status status;
    messages::teensy::Samples samples;
    messages::teensy::SyncEdge edge;
    if (parse(packet, identity)) sent.emplace_back(identity);
    if (parse(packet, reply)) sent.emplace_back(reply);
    if (parse(packet, status)) sent.emplace_back(status);
    if (parse(packet, samples)) sent.emplace_back(samples);
    if (parse(packet, edge)) sent.emplace_back(edge);
  }

  Decoder decoder_;
  bool is_selected_ = false;
  bool is_shifting_ = false;
  bool has_been_idle_ = false;
  std::uint64_t selected_cycles_ = 0;
  std::uint64_t deselected_cycles_ = 0;
  std::uint64_t word_cycles_ = 0;
};

}  // namespace isorig::firmware
