#include "firmware/application.hpp"

namespace isorig::firmware {
namespace {

constexpr uint16_t kFullDuty = 1000;

messages::teensy::DeviceCore::Options core_options(const Application::Options& options) noexcept {
  messages::teensy::DeviceCore::Options core;
  core.serial = options.serial;
  core.firmware = options.firmware;
  // Every conversion is sent: 1 / 0.46 ms. Two to a frame, so that the host wakes up about once a
  // millisecond.
  core.sample_rate_mhz = 2'174'000;
  core.batch_samples = 2;
  core.batch_age_us = 1'000;
  return core;
}

ElvhReader::Options reader_options(const Application::Options& options) noexcept {
  ElvhReader::Options reader;
  reader.cycles_per_us = options.cycles_per_us;
  return reader;
}

}  // namespace

Application::Application(const Options& options, Hardware& hardware) noexcept
    : hardware_(hardware),
      clock_(options.cycles_per_us),
      core_(core_options(options), *this),
      reader_(reader_options(options), hardware) {}

void Application::start() noexcept {
  hardware_.select(false);
  hardware_.set_sync(false);
  core_.start();
  core_.set_link_up(false);
  last_pass_ = now_cycles();
  next_sync_ = clock_.cycles((clock_.us(last_pass_) / kSyncHalfPeriod_us + 1) * kSyncHalfPeriod_us);
}

void Application::step() noexcept {
  const uint64_t now = now_cycles();
  const uint64_t pass = now - last_pass_;
  last_pass_ = now;
  if (pass > longest_pass_) longest_pass_ = pass > UINT32_MAX ? UINT32_MAX : static_cast<uint32_t>(pass);

  serve_link();
  read_sensor();
  drive_sync();
  core_.tick();
  drive_led(clock_.us(now));
  hardware_.feed_watchdog();
}

void Application::serve_link() noexcept {
  const bool is_open = hardware_.is_link_open();
  if (is_open != is_link_open_) {
    is_link_open_ = is_open;
    // What is left over from one host would be the first that the next one reads.
    hardware_.discard_output();
    core_.set_link_up(is_open);
  }
  uint8_t bytes[64];
  // One packet a pass: a host that talks without end does not keep the loop from its other duties.
  if (const size_t size = hardware_.receive(bytes, sizeof bytes); size > 0) core_.receive(bytes, size);
}

void Application::read_sensor() noexcept {
  const ElvhReader::Event event = reader_.step([this] { return now_cycles(); });
  if (event.kind == ElvhReader::Kind::kNone) return;
  if (event.missed > 0) core_.skip_samples(event.missed);
  core_.add_sample(clock_.us(event.at_cycles), event.raw_word, event.kind == ElvhReader::Kind::kConversion);
}

void Application::drive_sync() noexcept {
  if (now_cycles() < next_sync_) return;
  const uint64_t due_us = clock_.us(next_sync_);
  const bool is_high = due_us / kSyncHalfPeriod_us % 2 == 0;
  next_sync_ += clock_.cycles(kSyncHalfPeriod_us);
  if (is_high == is_sync_high_) return;  // the first one, half a second after the start
  is_sync_high_ = is_high;
  // Stamped, not predicted: the pin has just changed, whenever that was due.
  hardware_.set_sync(is_high);
  core_.sync_edge(now_us(), is_high);
}

void Application::set_valves(uint16_t fill_permille, uint16_t vent_permille) noexcept {
  hardware_.drive_coils(fill_permille, static_cast<uint16_t>(kFullDuty - vent_permille));
}

// The order is that of urgency: see docs/firmware.md.
void Application::drive_led(uint64_t now_us) noexcept {
  const auto phase_ms = static_cast<uint32_t>(now_us / 1000 % 1000);
  bool is_on = false;
  if (core_.has_vented_itself()) {
    is_on = phase_ms % 100 < 50;
  } else if (!reader_.is_healthy()) {
    is_on = phase_ms % 500 < 250;
  } else if (is_link_open_) {
    is_on = phase_ms < 900;
  } else {
    is_on = phase_ms < 50;
  }
  if (is_on == is_led_on_) return;
  is_led_on_ = is_on;
  hardware_.set_led(is_on);
}

}  // namespace isorig::firmware
