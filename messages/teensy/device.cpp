#include "messages/teensy/device.hpp"

namespace isorig::messages::teensy {
namespace {

constexpr uint16_t kFull = 1000;
constexpr uint16_t kMaxValidity_ms = 10'000;

void copy_text(const char* from, char (&to)[kTextSize]) noexcept {
  for (size_t i = 0; i + 1 < kTextSize && from[i] != '\0'; ++i) to[i] = from[i];
}

}  // namespace

DeviceCore::DeviceCore(const Options& options, Board& board) noexcept : options_(options), board_(board) {
  if (options_.batch_samples < 1) options_.batch_samples = 1;
  if (options_.batch_samples > kMaxSamples) options_.batch_samples = static_cast<uint8_t>(kMaxSamples);
}

void DeviceCore::start() noexcept {
  apply(0, kFull);
  last_status_us_ = board_.now_us();
}

void DeviceCore::set_link_up(bool is_up) noexcept {
  if (is_up == is_link_up_) return;
  is_link_up_ = is_up;
  decoder_.resynchronise();
  batch_.count = 0;
}

void DeviceCore::receive(const uint8_t* bytes, size_t size) noexcept {
  decoder_.feed(bytes, size, [this](const Packet& packet) noexcept { handle(packet); });
}

void DeviceCore::handle(const Packet& packet) noexcept {
  const uint64_t now_us = board_.now_us();
  if (TimeSyncRequest sync; parse(packet, sync)) {
    TimeSyncReply reply;
    reply.cookie = sync.cookie;
    reply.device_rx_us = now_us;
    reply.device_tx_us = board_.now_us();
    (void)send(encode(reply));
  } else if (Heartbeat heartbeat; parse(packet, heartbeat)) {
    last_heartbeat_us_ = now_us;
    is_armed_ = true;
  } else if (ValveCommand command; parse(packet, command)) {
    handle(command, now_us);
  } else if (Limits limits; parse(packet, limits)) {
    handle(limits);
  } else if (IdentityRequest request; parse(packet, request)) {
    open_session(request.session);
  } else {
    ++unexpected_;
  }
}

void DeviceCore::open_session(uint32_t session) noexcept {
  has_session_ = true;
  has_command_ = false;
  has_limits_ = false;
  Identity identity;
  identity.session = session;
  identity.sample_rate_mhz = options_.sample_rate_mhz;
  identity.watchdog_ms = options_.watchdog_ms;
  identity.device_us = board_.now_us();
  // Samples that still wait in the batch follow the identity.
  identity.next_sequence = batch_.count > 0 ? batch_.items[0].sequence : next_sequence_;
  copy_text(options_.model, identity.model);
  copy_text(options_.serial, identity.serial);
  copy_text(options_.firmware, identity.firmware);
  (void)send(encode(identity));
  is_status_due_ = true;
}

void DeviceCore::handle(const Limits& limits) noexcept {
  LimitsReply reply;
  reply.accepted = has_session_ && guard_.set_limits(limits) ? 1 : 0;
  has_limits_ = has_limits_ || reply.accepted == 1;
  if (reply.accepted == 0) ++rejected_;
  reply.limits = guard_.limits();
  (void)send(encode(reply));  // a host that hears nothing asks again
  is_status_due_ = true;
}

void DeviceCore::handle(const ValveCommand& command, uint64_t now_us) noexcept {
  // Serial arithmetic (RFC 1982): an old command that was held up somewhere never overtakes a newer one.
  if (has_command_ && static_cast<int32_t>(command.sequence - command_sequence_) <= 0) return;
  const bool is_in_range = command.fill_permille <= kFull && command.vent_permille <= kFull &&
                           (command.fill_permille == 0 || command.vent_permille == 0) && command.validity_ms >= 1 &&
                           command.validity_ms <= kMaxValidity_ms;
  const bool asks_full_vent = command.fill_permille == 0 && command.vent_permille == kFull;
  const bool is_alive = is_armed_ && is_heartbeat_recent(now_us);
  const bool is_refused = !has_session_ || (!asks_full_vent && (!is_alive || is_latched_)) ||
                          (is_latched_ && !is_alive) || (command.fill_permille > 0 && !has_limits_);
  if (!is_in_range || is_refused) {
    ++rejected_;
    return;
  }
  if (is_latched_ || is_command_expired_) is_status_due_ = true;
  is_latched_ = false;
  is_command_expired_ = false;
  has_command_ = true;
  is_command_running_ = !asks_full_vent;
  command_sequence_ = command.sequence;
  command_until_us_ = now_us + uint64_t{command.validity_ms} * 1000U;
  apply(command.fill_permille, command.vent_permille);
}

void DeviceCore::apply(uint16_t fill_permille, uint16_t vent_permille) noexcept {
  fill_permille_ = fill_permille;
  vent_permille_ = vent_permille;
  guard_.apply(fill_permille, vent_permille, board_.now_us());
  board_.set_valves(fill_permille, vent_permille);
}

void DeviceCore::add_sample(uint64_t device_us, uint32_t raw_word, bool is_conversion) noexcept {
  const VentCause cause = guard_.sample(raw_word, board_.now_us(), is_conversion);
  if (cause != VentCause::kNone) vent_itself(cause);
  const uint32_t sequence = next_sequence_++;
  if (!is_link_up_) return;
  if (batch_.count == 0) batch_first_us_ = device_us;
  batch_.items[batch_.count++] = {sequence, static_cast<uint32_t>(device_us), raw_word};
  if (batch_.count >= options_.batch_samples) send_batch();
}

void DeviceCore::send_batch() noexcept {
  if (!send(encode(batch_))) dropped_ += batch_.count;
  batch_.count = 0;
}

void DeviceCore::sync_edge(uint64_t device_us, bool is_high) noexcept {
  SyncEdge edge;
  edge.device_us = device_us;
  edge.count = ++edges_;
  edge.level = is_high ? 1 : 0;
  (void)send(encode(edge));  // the host sees a lost one by its count
}

void DeviceCore::tick() noexcept {
  const uint64_t now_us = board_.now_us();
  if (is_armed_ && !is_heartbeat_recent(now_us)) {
    is_armed_ = false;
    vent_itself(VentCause::kHeartbeat);
  }
  const VentCause cause = guard_.tick(now_us);
  if (cause != VentCause::kNone) vent_itself(cause);
  if (is_command_running_ && now_us > command_until_us_) {
    apply(0, 0);
    is_command_running_ = false;
    is_command_expired_ = true;
    is_status_due_ = true;
  }
  if (batch_.count > 0 && now_us >= batch_first_us_ + options_.batch_age_us) send_batch();
  if (is_status_due_ || now_us - last_status_us_ >= options_.status_period_us) {
    is_status_due_ = !send(encode(status()));
    last_status_us_ = now_us;
  }
}

void DeviceCore::vent_itself(VentCause cause) noexcept {
  if (fill_permille_ == 0 && vent_permille_ == kFull) return;
  apply(0, kFull);
  is_latched_ = true;
  cause_ = cause;
  is_command_running_ = false;
  is_command_expired_ = false;
  ++self_vents_;
  is_status_due_ = true;
}

Status DeviceCore::status() noexcept {
  Status status;
  status.device_us = board_.now_us();
  status.dropped = dropped_;
  status.rejected = rejected_;
  status.corrupt = decoder_.counters().errors() + unexpected_;
  status.command_sequence = command_sequence_;
  status.self_vents = self_vents_;
  status.fill_permille = fill_permille_;
  status.vent_permille = vent_permille_;
  if (is_latched_) status.flags |= kStatusSelfVented;
  if (is_command_expired_) status.flags |= kStatusCommandExpired;
  if (has_limits_) status.flags |= kStatusHasLimits;
  status.cause = cause_;
  status.fill_used_ms = guard_.fill_used_ms();
  return status;
}

bool DeviceCore::send(const Frame& frame) noexcept {
  return is_link_up_ && board_.send(frame.bytes, frame.size);
}

}  // namespace isorig::messages::teensy
