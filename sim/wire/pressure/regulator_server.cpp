#include "sim/wire/pressure/regulator_server.hpp"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "sim/wire/modbus_requests.hpp"
#include "sim/wire/wire_ends.hpp"

namespace isorig::sim {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr int kTurn_ms = 2;
constexpr double kAtmosphere_psi = 14.696, kKpaPerPsi = 6.894757293;
constexpr std::uint16_t kSetpoint = 1009, kStatus = 1200, kPressure = 1202, kCommand = 999, kBarometer = 1357;
constexpr std::uint32_t kHold = 1U << 8U, kExhaust = 1U << 10U;

}  // namespace

class RegulatorServer::Impl {
 public:
  Impl(const Options& options, Rig& rig, RegulatorFaults& faults)
      : options_(options),
        rig_(rig),
        faults_(faults),
        line_(options.tcp ? ClientLine(options.tcp_address, options.tcp_port) : ClientLine(options.pty_link)) {
    move_valves();
    thread_ = std::thread([this] { run(); });
  }
  ~Impl() {
    stop_.raise();
    thread_.join();
  }

  [[nodiscard]] const ClientLine& line() const noexcept { return line_; }
  std::atomic<double> setpoint_psi_{0.0};
  std::atomic<bool> exhausting_{false};

 private:
  void run() {
    for (;;) {
      std::array<pollfd, 3> fds{{{stop_.fd(), POLLIN, 0}, {line_.listener(), POLLIN, 0}, {line_.fd(), POLLIN, 0}}};
      ::poll(fds.data(), fds.size(), kTurn_ms);
      if (fds[0].revents != 0) return;
      move_valves();
      if (faults_.disconnect.load() && options_.tcp) drop_line();
      if (fds[1].revents != 0 && line_.accept(faults_.disconnect.load())) received_.clear();
      if (fds[2].revents != 0 && line_.fd() >= 0) receive();
    }
  }

  void drop_line() {
    line_.drop();
    received_.clear();
  }

  /// The regulator's own loop: proportional, through two valves.
  void move_valves() {
    const double setpoint = setpoint_psi_.load();
    auto visit = rig_.enter();
    auto& valves = rig_.regulator();
    valves.present = true;
    if (visit.lock.owns_lock()) visit.lock.unlock();
    pressure_psi_ = rig_.truth().pressure_psi + (faults_.sensor_off.load() ? 3.0 : 0.0);
    if (faults_.stuck.load()) return;
    const double error = setpoint - pressure_psi_;
    visit = rig_.enter();
    valves.fill = exhausting_.load() ? 0.0 : std::clamp(0.02 + 1.5 * error, 0.0, 1.0);
    valves.vent = exhausting_.load() ? 1.0 : std::clamp(-0.02 - 1.5 * error, 0.0, 1.0);
  }

  [[nodiscard]] std::array<std::uint16_t, 2> words_of(double psi) const {
    const auto value = static_cast<float>(faults_.in_kpa.load() ? psi * kKpaPerPsi : psi);
    const auto bits = std::bit_cast<std::uint32_t>(value);
    std::array<std::uint16_t, 2> words{static_cast<std::uint16_t>(bits >> 16U),
                                       static_cast<std::uint16_t>(bits & 0xFFFFU)};
    if (faults_.swap_words.load()) std::swap(words[0], words[1]);
    return words;
  }

  [[nodiscard]] std::uint16_t read_register(std::uint16_t address) const {
    const auto part = [&](std::uint16_t base, double psi) {
      return words_of(psi)[static_cast<std::size_t>(address - base)];
    };
    if (address == kSetpoint || address == kSetpoint + 1) return part(kSetpoint, setpoint_psi_.load());
    if (address == kPressure || address == kPressure + 1) return part(kPressure, pressure_psi_);
    if (address == kBarometer || address == kBarometer + 1) return part(kBarometer, kAtmosphere_psi);
    if (address == kStatus + 1 - (faults_.swap_words.load() ? 1 : 0)) {
      return static_cast<std::uint16_t>(exhausting_.load() ? kExhaust | kHold : 0U);
    }
    if (address == kCommand + 1) return result_;
    return 0;  // what is not defined reads 0
  }

  void write_registers(std::uint16_t address, const std::vector<std::uint16_t>& words) {
    if (address == kSetpoint && words.size() == 2) {
      auto [high, low] = std::pair{words[0], words[1]};
      if (faults_.swap_words.load()) std::swap(high, low);
      double psi = static_cast<double>(std::bit_cast<float>(std::uint32_t{high} << 16U | low));
      if (faults_.in_kpa.load()) psi /= kKpaPerPsi;
      if (faults_.clamp.load()) psi = std::min(psi, 2.0);
      setpoint_psi_ = std::clamp(psi, 0.0, options_.full_scale_psi);
    } else if (address == kCommand && words.size() == 2) {
      result_ = words[0] == 6 ? (words[1] <= 3 ? 0 : 32770) : 32769;
      if (result_ == 0) exhausting_ = words[1] == 3;
    }
  }

  /// A request without its framing; the answer likewise.
  Bytes execute(const std::uint8_t* pdu, std::size_t size) {
    const auto word = [&](std::size_t at) { return static_cast<std::uint16_t>(pdu[at] << 8U | pdu[at + 1]); };
    const auto exception = [&](std::uint8_t code) { return Bytes{static_cast<std::uint8_t>(pdu[0] | 0x80U), code}; };
    const std::uint16_t address = word(1);
    if (pdu[0] == 3 && size == 5) {
      const std::uint16_t count = word(3);
      if (count < 1 || count > 125) return exception(3);
      Bytes answer{3, static_cast<std::uint8_t>(2 * count)};
      for (std::uint16_t i = 0; i < count; ++i) {
        const auto value = read_register(static_cast<std::uint16_t>(address + i));
        answer.push_back(static_cast<std::uint8_t>(value >> 8U));
        answer.push_back(static_cast<std::uint8_t>(value & 0xFFU));
      }
      return answer;
    }
    if (pdu[0] == 16 && size >= 8 && size == 6U + pdu[5] && pdu[5] == 2 * word(3)) {
      std::vector<std::uint16_t> words;
      for (std::size_t i = 6; i + 1 < size; i += 2) words.push_back(word(i));
      write_registers(address, words);
      return Bytes(pdu, pdu + 5);
    }
    return exception(1);
  }

  void receive() {
    std::array<std::uint8_t, 512> bytes{};
    const ssize_t size = ::read(line_.fd(), bytes.data(), bytes.size());
    if (size <= 0) {
      if (options_.tcp && (size == 0 || (errno != EAGAIN && errno != EINTR))) drop_line();
      return;
    }
    received_.insert(received_.end(), bytes.begin(), bytes.begin() + size);
    while (take_request()) {
    }
  }

  /// False when no whole request is there.
  bool take_request() {
    const std::size_t head = options_.tcp ? 7 : 1, tail = options_.tcp ? 0 : 2;
    if (received_.size() < head + 5) return false;
    const std::uint8_t function = received_[head];
    if (function == 16 && received_.size() < head + 6) return false;
    const std::size_t body = function == 16 ? 6U + received_[head + 5] : 5U;
    const std::size_t whole = head + body + tail;
    if (received_.size() < whole) return false;
    const Bytes request(received_.begin(), received_.begin() + static_cast<std::ptrdiff_t>(whole));
    if (!options_.tcp) {
      const auto crc = rtu_crc(std::span(request).first(whole - 2));
      if (request[whole - 2] != (crc & 0xFFU) || request[whole - 1] != crc >> 8U) {
        received_.clear();  // out of step: the line falls silent, and the next request starts afresh
        return false;
      }
    }
    received_.erase(received_.begin(), received_.begin() + static_cast<std::ptrdiff_t>(whole));
    if (request[head - 1] != options_.unit_id || faults_.disconnect.load()) return true;
    reply(request, execute(request.data() + head, body));
    return true;
  }

  void reply(const Bytes& request, const Bytes& pdu) {
    if (take_one(faults_.drop)) return;
    const auto until = std::chrono::steady_clock::now() + std::chrono::milliseconds(faults_.late_ms.exchange(0));
    while (std::chrono::steady_clock::now() < until) {
      std::this_thread::sleep_for(std::chrono::milliseconds(kTurn_ms));
      move_valves();
    }
    Bytes answer;
    if (options_.tcp) {
      const auto length = static_cast<std::uint16_t>(pdu.size() + 1);
      answer = {request[0],
                request[1],
                0,
                0,
                static_cast<std::uint8_t>(length >> 8U),
                static_cast<std::uint8_t>(length & 0xFFU)};
    }
    answer.push_back(options_.unit_id);
    answer.insert(answer.end(), pdu.begin(), pdu.end());
    if (!options_.tcp) {
      const auto crc = rtu_crc(answer);
      answer.push_back(static_cast<std::uint8_t>(crc & 0xFFU));
      answer.push_back(static_cast<std::uint8_t>(crc >> 8U));
    }
    if (line_.send(answer.data(), answer.size()) < 0 && options_.tcp) drop_line();
  }

  const Options options_;
  Rig& rig_;
  RegulatorFaults& faults_;
  double pressure_psi_ = 0.0;
  std::uint16_t result_ = 0;
  StopEvent stop_;
  ClientLine line_;
  Bytes received_;
  std::thread thread_;
};

RegulatorServer::RegulatorServer(const Options& options, Rig& rig, RegulatorFaults& faults)
    : impl_(std::make_unique<Impl>(options, rig, faults)) {}
RegulatorServer::~RegulatorServer() = default;
std::uint16_t RegulatorServer::port() const noexcept {
  return impl_->line().port();
}
double RegulatorServer::setpoint_psi() const noexcept {
  return impl_->setpoint_psi_.load();
}
bool RegulatorServer::exhausting() const noexcept {
  return impl_->exhausting_.load();
}

}  // namespace isorig::sim
