#include "drivers/pressure/teensy.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "drivers/api/error.hpp"
#include "messages/elvh.hpp"

namespace isorig::pressure {
namespace {

namespace wire = messages::teensy;
using drivers::DeviceError;
using drivers::Fault;

// A device that was reset mid-connection counts from zero; one that merely repeats is at most a few frames
// back.
constexpr std::int32_t kMaxRepeat = 4096;
constexpr std::int64_t kMaxRoundTrip_ns = 1'000'000'000;
constexpr std::size_t kMaxSyncEdges = 1024;

static_assert(static_cast<std::uint8_t>(VentCause::kSensorStuck) ==
                  static_cast<std::uint8_t>(wire::VentCause::kSensorStuck) &&
              wire::kVentCauses == 6);

}  // namespace

template <class T>
std::size_t Teensy::Pending<T>::take(std::span<T> out) noexcept {
  const std::size_t count = std::min(out.size(), items.size() - taken);
  std::copy_n(items.begin() + static_cast<std::ptrdiff_t>(taken), count, out.begin());
  taken += count;
  if (empty()) clear();
  return count;
}

Teensy::Teensy(Options options, std::unique_ptr<ByteStream> stream, const clock::Clock& clock)
    : options_(std::move(options)), stream_(std::move(stream)), clock_(clock) {
  samples_.items.reserve((buffer_.size() + wire::kMaxFrame) / wire::kSampleSize);
  exchanges_.items.reserve(outstanding_.size());
  sync_edges_.items.reserve(kMaxSyncEdges);
}

void Teensy::fail(Fault fault, const std::string& what) const {
  throw DeviceError(fault, stream_->name() + ": " + what);
}

Identity Teensy::connect() {
  disconnect();
  stream_->open();
  wire::Identity identity;
  try {
    const auto packets = decoder_.counters().packets;
    heard_bytes_ = 0;
    if (!await_identity(identity)) {
      const bool heard_frames = decoder_.counters().packets != packets;
      fail(Fault::kTimeout, heard_frames ? std::string("sends frames but does not answer who it is")
                            : heard_bytes_ > 0
                                ? std::to_string(heard_bytes_) +
                                      " bytes came and no frame of the isorig firmware among them; is "
                                      "another program on this device, or is it another device?"
                                : std::string("nobody answers; does the isorig firmware run on this device?"));
    }
    if (limits_.pressure_max_psi > 0.0) agree_on_limits();
  } catch (...) {
    disconnect();
    throw;
  }
  return {.model = identity.model,
          .serial = identity.serial,
          .firmware = identity.firmware,
          .protocol_version = wire::kProtocolVersion,
          .sample_rate_hz = 1e-3 * identity.sample_rate_mhz};
}

void Teensy::set_limits(const FillLimits& limits) {
  limits_ = limits;
  if (is_connected_) agree_on_limits();
}

bool Teensy::await_identity(wire::Identity& identity) {
  decoder_.resynchronise();
  samples_.clear();
  exchanges_.clear();
  sync_edges_.clear();
  outstanding_.fill({});
  std::int64_t now_ns = clock_.now_ns();
  // New in every connection and in every run, so that nothing left over from an earlier one is taken for an
  // answer.
  session_ = std::max(session_ + 1, static_cast<std::uint32_t>(now_ns / 1000));
  cookie_ = session_;
  has_partial_write_ = true;  // ends whatever half frame the device may hold

  const std::int64_t deadline_ns = now_ns + options_.connect_timeout_ns;
  std::int64_t next_request_ns = now_ns;
  while (now_ns < deadline_ns && !is_connected_) {
    if (now_ns >= next_request_ns) {
      send(wire::IdentityRequest{session_});
      next_request_ns = now_ns + options_.identity_retry_ns;
    }
    const std::size_t size = stream_->read_some(buffer_, std::min(deadline_ns, next_request_ns) - now_ns);
    now_ns = clock_.now_ns();
    heard_bytes_ += size;
    // Samples may follow the identity in the same bytes.
    decoder_.feed(buffer_.data(), size, [&](const wire::Packet& packet) {
      if (is_connected_) {
        handle(packet, now_ns);
      } else if (parse(packet, identity) && identity.session == session_) {
        check(packet, identity);
        start_from(identity);
        is_connected_ = true;
      }
    });
  }
  return is_connected_;
}

void Teensy::agree_on_limits() {
  wire::Limits wanted;
  const double counts = limits_.pressure_max_psi / messages::kElvhPsiPerCount + messages::kElvhOffsetCounts;
  wanted.pressure_max_raw =
      static_cast<std::uint16_t>(std::clamp(std::floor(counts), 0.0, double{messages::kElvhFullScaleCounts}));
  wanted.fill_allowance_permille = limits_.fill_allowance_permille;
  wanted.fill_max_ms = limits_.fill_max_ms;
  limits_reply_.reset();
  const std::int64_t deadline_ns = clock_.now_ns() + options_.connect_timeout_ns;
  std::int64_t next_request_ns = 0;
  for (std::int64_t now_ns = clock_.now_ns(); !limits_reply_; now_ns = clock_.now_ns()) {
    if (now_ns >= deadline_ns) fail(Fault::kTimeout, "does not confirm the limits of pressure and filling");
    if (now_ns >= next_request_ns) {
      send(wanted);
      next_request_ns = now_ns + options_.identity_retry_ns;
    }
    receive(std::min(deadline_ns, next_request_ns) - now_ns);
  }
  if (limits_reply_->accepted == 0 || limits_reply_->limits != wanted) {
    fail(Fault::kIdentity, "keeps other limits than it was given (greatest pressure " +
                               std::to_string(limits_reply_->limits.pressure_max_raw) + " counts, wanted " +
                               std::to_string(wanted.pressure_max_raw) + "; filling " +
                               std::to_string(limits_reply_->limits.fill_max_ms) + " ms, wanted " +
                               std::to_string(wanted.fill_max_ms) + "); see docs/wire-teensy.md for what it accepts");
  }
}

void Teensy::check(const wire::Packet& packet, const wire::Identity& identity) const {
  if (packet.version != wire::kProtocolVersion) {
    fail(Fault::kIdentity, "speaks protocol version " + std::to_string(packet.version) + ", this program version " +
                               std::to_string(wire::kProtocolVersion) + "; flash the firmware that came with it");
  }
  if (!options_.model.empty() && options_.model != identity.model) {
    fail(Fault::kIdentity,
         std::string("is a '") + identity.model + "', the configuration wants a '" + options_.model + "'");
  }
  if (!options_.serial.empty() && options_.serial != identity.serial) {
    fail(Fault::kIdentity,
         std::string("has serial number '") + identity.serial + "', the configuration wants '" + options_.serial + "'");
  }
}

void Teensy::start_from(const wire::Identity& identity) {
  const auto device_us = static_cast<std::int64_t>(identity.device_us);
  const bool went_on =
      is_known_ && device_us >= device_us_ && static_cast<std::int32_t>(identity.next_sequence - next_sequence_) >= 0;
  if (went_on) {
    lost_ += identity.next_sequence - next_sequence_;
  } else {
    self_vents_.reset();
    next_edge_ = 0;
  }
  next_sequence_ = identity.next_sequence;
  device_us_ = device_us;
  watchdog_ms_ = identity.watchdog_ms;
  state_ = {};
  is_known_ = true;
}

void Teensy::disconnect() noexcept {
  stream_->close();
  is_connected_ = false;
}

Poll Teensy::poll(std::span<Sample> samples_out, std::span<clock::Exchange> exchanges_out, std::int64_t timeout_ns) {
  if (!is_connected_) fail(Fault::kDisconnected, "not connected");
  // What did not fit last time comes first. Reading on while the caller has no room would only hide from the
  // device that its host stalls; it counts better than a growing queue here would.
  if (samples_.empty()) receive(exchanges_.empty() ? timeout_ns : 0);

  Poll result;
  result.samples = samples_.take(samples_out);
  result.exchanges = exchanges_.take(exchanges_out);
  result.lost = std::exchange(lost_, 0);
  const std::uint32_t corrupt = decoder_.counters().errors() + unexpected_;
  result.corrupt = corrupt - std::exchange(reported_corrupt_, corrupt);
  result.state = state_;
  result.state.vented_by_itself = std::exchange(has_vented_, false) || state_.vented_by_itself;
  return result;
}

void Teensy::receive(std::int64_t timeout_ns) {
  const std::size_t size = stream_->read_some(buffer_, timeout_ns);
  if (size == 0) return;
  const std::int64_t recv_ns = stream_->arrived_ns().value_or(clock_.now_ns());
  decoder_.feed(buffer_.data(), size, [&](const wire::Packet& packet) { handle(packet, recv_ns); });
}

void Teensy::handle(const wire::Packet& packet, std::int64_t recv_ns) {
  wire::Identity identity;
  if (wire::Samples samples; parse(packet, samples)) {
    handle(samples);
  } else if (wire::TimeSyncReply reply; parse(packet, reply)) {
    handle(reply, recv_ns);
  } else if (wire::Status status; parse(packet, status)) {
    handle(status);
  } else if (wire::LimitsReply limits; parse(packet, limits)) {
    limits_reply_ = limits;
  } else if (wire::SyncEdge edge; parse(packet, edge)) {
    const auto ahead = next_edge_ == 0 ? 0 : static_cast<std::int32_t>(edge.count - next_edge_);
    if (ahead < 0) return;  // repeated, or out of order
    counters_.sync_edges_lost += static_cast<std::uint32_t>(ahead);
    next_edge_ = edge.count + 1;
    if (sync_edges_.items.size() < kMaxSyncEdges) {
      sync_edges_.items.push_back(edge);
    } else {
      ++counters_.sync_edges_lost;
    }
  } else if (!parse(packet,
                    identity)) {  // a second answer to a repeated request is none of these and no fault
    ++unexpected_;
    ++counters_.unexpected;
  }
}

void Teensy::handle(const wire::Samples& samples) {
  for (std::size_t i = 0; i < samples.count; ++i) {
    const wire::Sample& item = samples.items[i];
    const auto ahead = static_cast<std::int32_t>(item.sequence - next_sequence_);
    if (ahead < 0 && ahead >= -kMaxRepeat) {
      ++counters_.duplicates;
      continue;
    }
    if (ahead < 0) fail(Fault::kDisconnected, "the device started anew (its sequence went back)");
    lost_ += static_cast<std::uint32_t>(ahead);
    next_sequence_ = item.sequence + 1;
    const std::int64_t device_us = wire::extend_us(item.device_us, device_us_);
    device_us_ = std::max(device_us_, device_us);
    samples_.items.push_back({item.sequence, device_us, item.raw_word});
  }
}

void Teensy::handle(const wire::Status& status) {
  see_device_time(status.device_us);
  state_.vented_by_itself = (status.flags & wire::kStatusSelfVented) != 0;
  state_.cause = static_cast<VentCause>(status.cause);
  // The counter also tells of a vent that was over before its flag was seen. Those before us are not news.
  if (status.self_vents != self_vents_.value_or(status.self_vents)) has_vented_ = true;
  self_vents_ = status.self_vents;
  state_.dropped = status.dropped;
  state_.fill_permille = status.fill_permille;
  state_.vent_permille = status.vent_permille;
}

void Teensy::handle(const wire::TimeSyncReply& reply, std::int64_t recv_ns) {
  see_device_time(reply.device_tx_us);
  Outstanding& request = outstanding_[reply.cookie % outstanding_.size()];
  const bool is_match = request.is_waiting && request.cookie == reply.cookie;
  if (is_match) request.is_waiting = false;
  if (!is_match || recv_ns - request.send_ns > kMaxRoundTrip_ns) {
    ++counters_.unmatched_replies;
    return;
  }
  // As stamped, rounded down to whole microseconds: clock::MapOptions::device_resolution_us accounts for that.
  exchanges_.items.push_back(
      {request.send_ns, recv_ns, static_cast<double>(reply.device_rx_us), static_cast<double>(reply.device_tx_us)});
}

void Teensy::see_device_time(std::uint64_t device_us) {
  // A sample may be younger than the message before it by the time it took to queue, never by a second.
  const auto now_us = static_cast<std::int64_t>(device_us);
  if (now_us < device_us_ - 1'000'000) fail(Fault::kDisconnected, "the device started anew (its clock went back)");
  device_us_ = std::max(device_us_, now_us);
}

void Teensy::command(const Command& command) {
  if (command.fill_permille > 1000 || command.vent_permille > 1000 ||
      (command.fill_permille > 0 && command.vent_permille > 0)) {
    fail(Fault::kRefused, "valve duties " + std::to_string(command.fill_permille) + " and " +
                              std::to_string(command.vent_permille) +
                              " permille: each is 0 to 1000, and one of them 0");
  }
  send(wire::ValveCommand{++command_sequence_, command.fill_permille, command.vent_permille,
                          options_.command_validity_ms});
}

void Teensy::heartbeat() {
  send(wire::Heartbeat{++heartbeats_});
}

void Teensy::request_time_sync() {
  const std::uint32_t cookie = ++cookie_;
  outstanding_[cookie % outstanding_.size()] = {cookie, clock_.now_ns(), true};
  send(wire::TimeSyncRequest{cookie});
}

template <class Message>
void Teensy::send(const Message& message) {
  const wire::Frame frame = encode(message);
  std::array<std::uint8_t, wire::kMaxFrame + 1> bytes{};
  const std::size_t lead = has_partial_write_ ? 1 : 0;
  std::copy_n(frame.bytes, frame.size, bytes.begin() + static_cast<std::ptrdiff_t>(lead));
  has_partial_write_ = true;
  stream_->write_all(std::span(bytes).first(lead + frame.size));
  has_partial_write_ = false;
}

std::optional<SyncEdge> Teensy::take_sync_edge() {
  wire::SyncEdge edge;
  if (sync_edges_.take(std::span(&edge, 1)) == 0) return std::nullopt;
  return SyncEdge{static_cast<std::int64_t>(edge.device_us), edge.level != 0};
}

}  // namespace isorig::pressure
