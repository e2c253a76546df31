#include "drivers/frame/modbus_frame.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "drivers/clock/real_clock.hpp"

namespace isorig::frame {
namespace {

using drivers::DeviceError;
using drivers::Fault;
using modbus::Quantity;

constexpr int kAttempts = 3;

std::uint32_t counter_mask(const modbus::RegisterMap& map) {
  return map.at(Quantity::kSampleCounter)->format.type == modbus::RegisterType::kUint16 ? 0xFFFFU : 0xFFFFFFFFU;
}

}  // namespace

ModbusFrame::ModbusFrame(modbus::ModbusConfig config, clock::Clock& clock)
    : config_(std::move(config)),
      clock_(clock),
      link_(config_),
      header_block_(config_.map.header_block()),
      state_blocks_(config_.map.state_blocks()) {
  slot_words_.reserve(static_cast<std::size_t>(config_.map.samples.slots) * config_.map.samples.stride_registers);
}

ModbusFrame::Statistics ModbusFrame::statistics() const noexcept {
  auto all = statistics_;
  all.resyncs = link_.resyncs();
  return all;
}

// ---- registers
// ------------------------------------------------------------------------------------------------

void ModbusFrame::take_words(const modbus::ReadBlock& block, std::span<const std::uint16_t> words) {
  for (const auto quantity : block.quantities) {
    const auto& reg = *config_.map.at(quantity);
    const auto from = static_cast<std::size_t>(reg.address - block.address);
    std::copy_n(words.begin() + static_cast<std::ptrdiff_t>(from), reg.format.registers(),
                words_[static_cast<std::size_t>(quantity)].begin());
  }
}

double ModbusFrame::value(Quantity quantity) const {
  return config_.map.at(quantity)->format.decode(words_[static_cast<std::size_t>(quantity)]);
}

std::uint16_t ModbusFrame::code(Quantity quantity) const {
  return config_.map.at(quantity) ? static_cast<std::uint16_t>(static_cast<std::uint32_t>(value(quantity))) : 0;
}

void ModbusFrame::read_state_blocks() {
  std::array<std::uint16_t, 125> words{};
  for (const auto& block : state_blocks_) {
    const auto part = std::span(words).first(block.registers);
    link_.read(block.function, block.address, part);
    take_words(block, part);
  }
}

State ModbusFrame::decode_state() const {
  State state;
  state.motion = config_.map.motion_of(code(Quantity::kState));
  if (state.motion == Motion::kMoving && code(Quantity::kTargetReached) != 0) state.motion = Motion::kReached;
  state.segment_id = code(Quantity::kSegmentId);
  state.target_mm = static_cast<float>(value(Quantity::kTarget_mm));
  state.velocity_mm_s = static_cast<float>(value(Quantity::kVelocity_mm_s));
  state.fault_bits = config_.map.fault_bits_of(code(Quantity::kFaultBits));
  state.heartbeat_echo = code(Quantity::kHeartbeatEcho);
  return state;
}

void ModbusFrame::limit_to(int response_timeouts) noexcept {
  const clock::RealClock line;  // the line lives in real time
  link_.limit(line.now_ns() + std::int64_t{config_.response_timeout_ms} * 1'000'000 * response_timeouts);
}

// ---- counter and clock
// ----------------------------------------------------------------------------------------

double ModbusFrame::turn_us(const modbus::NumberFormat& format) noexcept {
  return (format.type == modbus::RegisterType::kUint16 ? 0x1p16 : 0x1p32) * format.scale;
}

double ModbusFrame::unwrap_us(const modbus::NumberFormat& format, double raw_us, double expected_us) const noexcept {
  const double turn = turn_us(format);
  return raw_us + turn * std::round((expected_us - raw_us) / turn);
}

ModbusFrame::Header ModbusFrame::read_header() {
  std::array<std::uint16_t, 125> words{};
  const auto part = std::span(words).first(header_block_.registers);
  Header header;
  header.sent_ns = clock_.now_ns();
  link_.read(header_block_.function, header_block_.address, part);
  header.received_ns = clock_.now_ns();
  take_words(header_block_, part);

  header.counter = static_cast<std::uint32_t>(value(Quantity::kSampleCounter));
  if (config_.map.at(Quantity::kWriteIndex)) {
    header.index = static_cast<std::uint32_t>(value(Quantity::kWriteIndex));
  }
  const double expected_us = anchor_device_us_ + static_cast<double>(header.received_ns - anchor_ns_) / 1000.0;
  const double raw_us = value(Quantity::kDeviceTime_us);
  header.device_us =
      has_history_ ? unwrap_us(config_.map.at(Quantity::kDeviceTime_us)->format, raw_us, expected_us) : raw_us;
  header.newest_us = header.device_us;
  if (const auto& newest = config_.map.at(Quantity::kNewestSampleTime_us)) {
    header.newest_us = unwrap_us(newest->format, value(Quantity::kNewestSampleTime_us), header.device_us);
  }
  return header;
}

std::uint32_t ModbusFrame::newer_by(std::uint32_t counter, std::uint32_t than) const noexcept {
  return (counter - than) & counter_mask(config_.map);
}

bool ModbusFrame::explained(std::uint32_t advance, std::int64_t now_ns) const noexcept {
  const double elapsed_s = static_cast<double>(now_ns - advanced_ns_) * 1e-9;
  return static_cast<double>(advance) <= 2.0 * elapsed_s * rate_Hz_ + kAdvanceSlack;
}

void ModbusFrame::note_advance(const Header& header) noexcept {
  if (header.counter != newest_counter_) {
    newest_counter_ = header.counter;
    advanced_ns_ = header.received_ns;
  }
  // Back too: a clock that was set is another epoch of the mapping, not one that stands.
  if (header.device_us != last_device_us_) {
    last_device_us_ = anchor_device_us_ = header.device_us;
    anchor_ns_ = header.received_ns;
  }
}

// ---- samples
// --------------------------------------------------------------------------------------------------

Poll ModbusFrame::poll(std::span<Sample> out) {
  limit_to(kRequestsAtOnce);
  const std::uint32_t usable = config_.map.samples.slots - 1;  // the oldest slot may be in the frame's hands
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const Header before = read_header();
    const auto jump = [&] { ++statistics_.reread_headers; };
    if (!explained(newer_by(before.counter, newest_counter_), before.received_ns)) {
      jump();
      continue;
    }
    const std::uint32_t available = newer_by(before.counter, counter_);
    std::uint32_t skip = available > usable ? available - usable : 0;
    std::size_t count = std::min<std::size_t>(available - skip, out.size());
    Header after = before;
    if (count > 0) {
      count = read_slots(counter_ + skip + 1, count, before);
      after = read_header();
      const std::uint32_t meanwhile = newer_by(after.counter, before.counter);
      if (!explained(meanwhile, after.received_ns)) {
        jump();
        continue;
      }
      // The frame may be writing after.counter + 1, over the sample that is `slots` older.
      const std::uint32_t span = available + meanwhile + 1;
      const std::uint32_t unsafe = span > config_.map.samples.slots ? span - config_.map.samples.slots : 0;
      if (unsafe > skip) {
        const auto torn = std::min<std::size_t>(unsafe - skip, count);
        slot_words_.erase(slot_words_.begin(), slot_words_.begin() + static_cast<std::ptrdiff_t>(
                                                                         torn * config_.map.samples.stride_registers));
        skip += static_cast<std::uint32_t>(torn);
        count -= torn;
      }
    }
    read_state_blocks();

    Poll result;
    result.samples = decode_samples(counter_ + skip + 1, out.first(count), before);
    const auto misplaced = static_cast<std::uint32_t>(count - result.samples);
    result.lost = skip + misplaced;
    result.state = decode_state();
    // A clock that stands still dates nothing: the frame, or what is behind the gateway, hangs.
    const Header& best = after.received_ns - after.sent_ns < before.received_ns - before.sent_ns ? after : before;
    result.has_exchange = best.device_us != last_device_us_;
    result.exchange = {best.sent_ns, best.received_ns, best.device_us, best.device_us};

    note_advance(before);
    note_advance(after);
    const auto consumed = skip + static_cast<std::uint32_t>(count);
    counter_ = (counter_ + consumed) & counter_mask(config_.map);
    sequence_ += consumed;
    ++statistics_.polls;
    statistics_.lost_samples += result.lost;
    statistics_.misplaced_samples += misplaced;
    return result;
  }
  link_.close();
  throw DeviceError(Fault::kDisconnected,
                    at() + "the sample counter jumped from " + std::to_string(newest_counter_) + " by more than " +
                        "time explains: the frame was restarted; reconnect, and check the clock mapping starts anew");
}

/// How many were read: the rest waits for the next poll when this one has taken a response time-out already.
std::size_t ModbusFrame::read_slots(std::uint32_t first_counter, std::size_t count, const Header& header) {
  const clock::RealClock line;
  const std::int64_t enough_ns = line.now_ns() + std::int64_t{config_.response_timeout_ms} * 1'000'000;
  const auto& map = config_.map;
  const auto& ring = map.samples;
  const std::size_t per_request = std::max<std::size_t>(1, map.max_read_registers / ring.stride_registers);
  slot_words_.resize(count * ring.stride_registers);
  for (std::size_t done = 0; done < count;) {
    const std::uint32_t counter = (first_counter + static_cast<std::uint32_t>(done)) & counter_mask(map);
    // Distance modulo the counter's width, so that a 16-bit counter wraps rightly too.
    const std::uint32_t age = newer_by(header.counter, counter);
    const std::uint32_t slot = map.slot_of(header.counter - age, header.counter, header.index);
    const std::size_t here = std::min({count - done, per_request, static_cast<std::size_t>(ring.slots - slot)});
    link_.read(ring.function, static_cast<std::uint16_t>(ring.address + slot * ring.stride_registers),
               std::span(slot_words_).subspan(done * ring.stride_registers, here * ring.stride_registers));
    done += here;
    if (line.now_ns() >= enough_ns) {
      slot_words_.resize(done * ring.stride_registers);
      return done;
    }
  }
  return count;
}

std::size_t ModbusFrame::decode_samples(std::uint32_t first_counter, std::span<Sample> out, const Header& header) {
  const auto& ring = config_.map.samples;
  const auto stride = static_cast<std::size_t>(ring.stride_registers);
  const double half_turn_us = 0.5e6 * ring.slots / rate_Hz_;
  // A clock that was set back dates the samples of before later than those that follow.
  if (header.newest_us < last_sample_us_) last_sample_us_ = -std::numeric_limits<double>::infinity();
  std::size_t given = 0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const auto slot = std::span<const std::uint16_t>(slot_words_).subspan(i * stride, stride);
    const std::uint32_t ahead = first_counter + static_cast<std::uint32_t>(i) - counter_;
    double time_us = 0.0;
    if (ring.time_us) {
      time_us = unwrap_us(ring.time_us->format, ring.time_us->format.decode(slot.subspan(ring.time_us->at)),
                          header.newest_us);
      // Counted, but not written into its slot: what lies there is of another turn of the ring, or nothing at all.
      if (!(time_us >= last_sample_us_ && time_us <= header.newest_us + half_turn_us)) continue;
      last_sample_us_ = time_us;
    } else {
      const std::uint32_t age = newer_by(header.counter, counter_ + ahead);
      time_us = header.newest_us - static_cast<double>(age) * 1e6 / rate_Hz_;
    }
    auto& sample = out[given++];
    sample.sequence = sequence_ + ahead;
    sample.position_mm = static_cast<float>(ring.position_mm.format.decode(slot.subspan(ring.position_mm.at)));
    sample.force_N = static_cast<float>(ring.force_N.format.decode(slot.subspan(ring.force_N.at)));
    sample.device_us = std::llround(time_us);
  }
  return given;
}

}  // namespace isorig::frame
