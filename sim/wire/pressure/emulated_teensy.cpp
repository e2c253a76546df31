#include "sim/wire/pressure/emulated_teensy.hpp"

#include <algorithm>

#include "messages/elvh.hpp"

namespace isorig::sim {
namespace {

constexpr std::int64_t kValveRefresh_ns = 10'000'000;
constexpr std::size_t kMaxOnTheLine = 4096;  // chunks; only a huge delay fault gets there

}  // namespace

EmulatedTeensy::EmulatedTeensy(const Options& options, pressure::Device& backend, std::int64_t now_ns)
    : options_(options), backend_(backend), now_ns_(now_ns), random_state_(options.seed) {
  backend_.connect();
  power_up(options_.start_us);
}

void EmulatedTeensy::power_up(std::uint64_t start_us) {
  start_ns_ = now_ns_;
  start_us_ = start_us;
  core_.emplace(options_.core, static_cast<Board&>(*this));
  core_->start();
  core_->set_link_up(false);
  last_word_.reset();
}

double EmulatedTeensy::device_us(std::int64_t mono_ns) const noexcept {
  return static_cast<double>(start_us_) +
         1e-3 * static_cast<double>(mono_ns - start_ns_) * (1.0 + 1e-6 * options_.skew_ppm);
}

void EmulatedTeensy::clear_line() noexcept {
  is_open_ = false;
  to_host_.clear();
  to_device_.clear();
}

void EmulatedTeensy::follow_port_faults() {
  const bool is_unplugged = faults_.unplugged.load();
  if (is_unplugged || faults_.hung_up.load()) {
    if (is_plugged_in()) pull_out();
    clear_line();
  } else if (!is_plugged_in()) {
    plug_in();
  }
  // Without power the fill valve closes and the vent valve, normally open, vents.
  if (is_unplugged && !was_unplugged_) set_valves(0, 1000);
  if (!is_unplugged && was_unplugged_) power_up(0);
  was_unplugged_ = is_unplugged;
}

void EmulatedTeensy::service(std::int64_t now_ns) {
  now_ns_ = now_ns;
  follow_port_faults();
  const bool is_running = !was_unplugged_ && !faults_.frozen.load();
  const bool is_open = is_plugged_in() && service_port();  // by interrupt: also of a firmware that hangs
  if (is_running) {
    if (is_open_ && !is_open) to_device_.clear();
    is_open_ = is_open;
    if (!is_open_) to_host_.clear();
    core_->set_serial(faults_.wrong_serial.load() ? "9999990" : options_.core.serial);
    core_->set_link_up(is_open_);
    take_from_host();
  }
  sample(is_running);
  if (is_running) {
    core_->tick();
    give_to_host();
  }
  move_valves();
}

void EmulatedTeensy::take_from_host() {
  if (!is_open_) return;
  std::array<std::uint8_t, 1024> buffer;
  while (to_device_.size() < kMaxOnTheLine) {
    const std::size_t size = take(buffer);
    if (size == 0) break;
    if (options_.clock != nullptr) now_ns_ = std::max(now_ns_, options_.clock->now_ns());
    const std::int64_t due_ns = now_ns_ + std::int64_t{faults_.delay_to_device_us.load()} * 1000;
    to_device_.push_back({due_ns, {buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(size)}, 0});
  }
  while (!to_device_.empty() && to_device_.front().due_ns <= now_ns_) {
    core_->receive(to_device_.front().bytes.data(), to_device_.front().bytes.size());
    to_device_.pop_front();
  }
}

bool EmulatedTeensy::send(const std::uint8_t* bytes, std::size_t size) noexcept {
  give_to_host();
  // What is under way on a slow line has left the device; only what the host has not taken fills its buffers.
  std::size_t waiting = 0;
  for (const Chunk& chunk : to_host_) {
    if (chunk.due_ns <= now_ns_) waiting += chunk.bytes.size() - chunk.written;
  }
  if (waiting + size > options_.transmit_bytes || to_host_.size() >= kMaxOnTheLine) return false;
  if (strikes(faults_.drop_permille)) return true;
  const std::int64_t due_ns = now_ns_ + std::int64_t{faults_.delay_to_host_us.load()} * 1000;
  Chunk chunk{due_ns, {bytes, bytes + size}, 0};
  if (strikes(faults_.corrupt_permille)) {
    chunk.bytes[random() % size] ^= static_cast<std::uint8_t>(1U << (random() % 8));
  }
  if (strikes(faults_.repeat_permille)) to_host_.push_back(chunk);
  to_host_.push_back(std::move(chunk));
  return true;
}

void EmulatedTeensy::give_to_host() noexcept {
  while (is_open_ && !to_host_.empty() && to_host_.front().due_ns <= now_ns_) {
    Chunk& chunk = to_host_.front();
    chunk.written += give(std::span(chunk.bytes).subspan(chunk.written));
    if (chunk.written < chunk.bytes.size()) return;
    to_host_.pop_front();
  }
}

void EmulatedTeensy::sample(bool is_running) {
  for (;;) {
    const pressure::Poll polled = backend_.poll(samples_, {}, 0);
    if (is_running) core_->skip_samples(polled.lost);
    for (std::size_t i = 0; i < polled.samples; ++i) {
      const std::int64_t mono_ns = options_.backend_epoch_ns + samples_[i].device_us * 1000;
      if (!is_running || mono_ns < start_ns_) continue;
      core_->add_sample(static_cast<std::uint64_t>(device_us(mono_ns)), with_sensor_faults(samples_[i].raw_word));
    }
    if (polled.samples < samples_.size()) return;
  }
}

std::uint32_t EmulatedTeensy::with_sensor_faults(std::uint32_t raw_word) noexcept {
  if (faults_.stale_sensor.load()) {
    messages::ElvhWord held = messages::unpack_elvh(last_word_.value_or(raw_word));
    held.status = messages::ElvhStatus::kStale;
    return messages::pack_elvh(held);
  }
  last_word_ = raw_word;
  if (!faults_.sensor_fault.load()) return raw_word;
  messages::ElvhWord failed = messages::unpack_elvh(raw_word);
  failed.status = messages::ElvhStatus::kFault;
  return messages::pack_elvh(failed);
}

void EmulatedTeensy::set_valves(std::uint16_t fill_permille, std::uint16_t vent_permille) noexcept {
  valves_.fill_permille = fill_permille;
  valves_.vent_permille = vent_permille;
  are_valves_new_ = true;
}

void EmulatedTeensy::move_valves() {
  backend_.heartbeat();
  if (!are_valves_new_ && now_ns_ - valves_sent_ns_ < kValveRefresh_ns) return;
  backend_.command(valves_);
  are_valves_new_ = false;
  valves_sent_ns_ = now_ns_;
}

void EmulatedTeensy::sync_edge(std::int64_t mono_ns, bool is_high) {
  core_->sync_edge(static_cast<std::uint64_t>(device_us(mono_ns)), is_high);
}

bool EmulatedTeensy::strikes(const std::atomic<std::uint32_t>& permille) noexcept {
  const std::uint32_t chance = permille.load(std::memory_order_relaxed);
  return chance > 0 && random() % 1000 < chance;
}

std::uint32_t EmulatedTeensy::random() noexcept {  // SplitMix64 (Steele, Lea, Flood 2014)
  std::uint64_t z = random_state_ += 0x9E3779B97F4A7C15U;
  z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
  z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
  return static_cast<std::uint32_t>((z ^ (z >> 31U)) >> 32U);
}

}  // namespace isorig::sim
