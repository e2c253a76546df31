#include "sim/pressure/teensy_pty.hpp"

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <system_error>

#include "messages/elvh.hpp"

namespace isorig::sim {
namespace {

namespace wire = messages::teensy;

constexpr std::int64_t kValveRefresh_ns = 10'000'000;
constexpr std::size_t kMaxOnTheLine = 4096;  // chunks; only a huge delay fault gets there

[[noreturn]] void throw_errno(const char* what) {
  throw std::system_error(errno, std::generic_category(), what);
}

}  // namespace

TeensyPty::TeensyPty(const Options& options, pressure::Device& backend, std::int64_t now_ns)
    : options_(options), backend_(backend), now_ns_(now_ns), random_state_(options.seed) {
  backend_.connect();
  power_up(options_.start_us);
  open_port();
}

TeensyPty::~TeensyPty() {
  close_port();
}

void TeensyPty::power_up(std::uint64_t start_us) {
  start_ns_ = now_ns_;
  start_us_ = start_us;
  core_.emplace(options_.core, static_cast<Board&>(*this));
  core_->start();
  core_->set_link_up(false);
  last_word_.reset();
}

double TeensyPty::device_us(std::int64_t mono_ns) const noexcept {
  return static_cast<double>(start_us_) +
         1e-3 * static_cast<double>(mono_ns - start_ns_) * (1.0 + 1e-6 * options_.skew_ppm);
}

void TeensyPty::open_port() {
  const int fd = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) throw_errno("posix_openpt");
  master_fd_ = fd;
  std::array<char, 128> name{};
  if (grantpt(fd) != 0 || unlockpt(fd) != 0 || ptsname_r(fd, name.data(), name.size()) != 0)
    throw_errno("pty");
  slave_path_ = name.data();
  // A pty reports "other side closed" only after its slave was open once.
  const int slave = ::open(slave_path_.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (slave < 0) throw_errno("pty slave");
  ::close(slave);
  // Replaced in one step: a driver that tries at this moment finds the old or the new one.
  const std::string fresh = options_.link_path + ".new";
  ::unlink(fresh.c_str());
  if (symlink(slave_path_.c_str(), fresh.c_str()) != 0 ||
      rename(fresh.c_str(), options_.link_path.c_str()) != 0) {
    throw_errno(options_.link_path.c_str());
  }
}

void TeensyPty::close_port() noexcept {
  if (master_fd_ < 0) return;
  std::error_code error;
  if (std::filesystem::read_symlink(options_.link_path, error) == slave_path_)
    ::unlink(options_.link_path.c_str());
  ::close(master_fd_);
  master_fd_ = -1;
  is_open_ = false;
  to_host_.clear();
  to_device_.clear();
}

void TeensyPty::renew_port() {
  const int old = master_fd_;
  open_port();
  ::close(old);
  to_device_.clear();
}

void TeensyPty::follow_port_faults() {
  const bool is_unplugged = faults_.unplugged.load();
  if (is_unplugged || faults_.hung_up.load()) {
    close_port();
  } else if (master_fd_ < 0) {
    open_port();
  }
  // Without power the fill valve closes and the vent valve, normally open, vents.
  if (is_unplugged && !was_unplugged_) set_valves(0, 1000);
  if (!is_unplugged && was_unplugged_) power_up(0);
  was_unplugged_ = is_unplugged;
}

void TeensyPty::service(std::int64_t now_ns) {
  now_ns_ = now_ns;
  follow_port_faults();
  const bool is_running = !was_unplugged_ && !faults_.frozen.load();
  if (is_running) {
    if (master_fd_ >= 0) {
      pollfd port{master_fd_, 0, 0};
      (void)poll(&port, 1, 0);
      const bool was_open = is_open_;
      is_open_ = (port.revents & POLLHUP) == 0;
      if (was_open && !is_open_) renew_port();
      if (!is_open_) to_host_.clear();
    }
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

void TeensyPty::take_from_host() {
  if (!is_open_) return;
  std::array<std::uint8_t, 1024> buffer;
  while (to_device_.size() < kMaxOnTheLine) {
    const ssize_t size = ::read(master_fd_, buffer.data(), buffer.size());
    if (size <= 0) break;
    const std::int64_t due_ns = now_ns_ + std::int64_t{faults_.delay_to_device_us.load()} * 1000;
    to_device_.push_back({due_ns, {buffer.begin(), buffer.begin() + size}, 0});
  }
  while (!to_device_.empty() && to_device_.front().due_ns <= now_ns_) {
    core_->receive(to_device_.front().bytes.data(), to_device_.front().bytes.size());
    to_device_.pop_front();
  }
}

bool TeensyPty::send(const std::uint8_t* bytes, std::size_t size) noexcept {
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

void TeensyPty::give_to_host() noexcept {
  while (is_open_ && !to_host_.empty() && to_host_.front().due_ns <= now_ns_) {
    Chunk& chunk = to_host_.front();
    const ssize_t size =
        ::write(master_fd_, chunk.bytes.data() + chunk.written, chunk.bytes.size() - chunk.written);
    if (size <= 0) return;
    chunk.written += static_cast<std::size_t>(size);
    if (chunk.written < chunk.bytes.size()) return;
    to_host_.pop_front();
  }
}

void TeensyPty::sample(bool is_running) {
  for (;;) {
    const pressure::Poll polled = backend_.poll(samples_, {}, 0);
    if (is_running) core_->skip_samples(polled.lost);
    for (std::size_t i = 0; i < polled.samples; ++i) {
      const std::int64_t mono_ns = options_.backend_epoch_ns + samples_[i].device_us * 1000;
      if (!is_running || mono_ns < start_ns_) continue;
      core_->add_sample(static_cast<std::uint64_t>(device_us(mono_ns)),
                        with_sensor_faults(samples_[i].raw_word));
    }
    if (polled.samples < samples_.size()) return;
  }
}

std::uint32_t TeensyPty::with_sensor_faults(std::uint32_t raw_word) noexcept {
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

void TeensyPty::set_valves(std::uint16_t fill_permille, std::uint16_t vent_permille) noexcept {
  valves_.fill_permille = fill_permille;
  valves_.vent_permille = vent_permille;
  are_valves_new_ = true;
}

void TeensyPty::move_valves() {
  backend_.heartbeat();
  if (!are_valves_new_ && now_ns_ - valves_sent_ns_ < kValveRefresh_ns) return;
  backend_.command(valves_);
  are_valves_new_ = false;
  valves_sent_ns_ = now_ns_;
}

void TeensyPty::sync_edge(std::int64_t mono_ns, bool is_high) {
  core_->sync_edge(static_cast<std::uint64_t>(device_us(mono_ns)), is_high);
}

bool TeensyPty::strikes(const std::atomic<std::uint32_t>& permille) noexcept {
  const std::uint32_t chance = permille.load(std::memory_order_relaxed);
  return chance > 0 && random() % 1000 < chance;
}

std::uint32_t TeensyPty::random() noexcept {  // SplitMix64 (Steele, Lea, Flood 2014)
  std::uint64_t z = random_state_ += 0x9E3779B97F4A7C15U;
  z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
  z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
  return static_cast<std::uint32_t>((z ^ (z >> 31U)) >> 32U);
}

}  // namespace isorig::sim
