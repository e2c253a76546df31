#include "sim/wire/frame/instron8800_server.hpp"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <deque>
#include <string_view>
#include <thread>
#include <utility>

#include "sim/wire/frame/instron8800_controller.hpp"
#include "sim/wire/wire_ends.hpp"

namespace isorig::sim {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kIdle_ns = 5 * kMs;

std::int64_t now() {
  timespec t{};
  ::clock_gettime(CLOCK_MONOTONIC, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

/// "C1,0", however its numbers are written.
bool is_stop(std::string_view line) {
  return line.starts_with("C1,") && std::atof(std::string(line.substr(3)).c_str()) == 0.0;
}

}  // namespace

class Instron8800Server::Impl {
 public:
  Impl(const Options& options, frame::Device& backend, Instron8800Faults& faults)
      : options_(options),
        faults_(faults),
        controller_(options, backend, faults),
        line_(options.tcp ? ClientLine(options.tcp_address, options.tcp_port) : ClientLine(options.pty_link)) {
    thread_ = std::thread([this] { run(); });
  }

  ~Impl() {
    stop_.raise();
    thread_.join();
  }

  [[nodiscard]] const ClientLine& line() const noexcept { return line_; }
  std::atomic<std::uint64_t> lines_{0}, watchdog_trips_{0};

 private:
  void run() {
    while (!stopping_) {
      const std::int64_t time_ns = now();
      if (const int hang_ms = faults_.hang_ms.exchange(0); hang_ms > 0) hang_until_ns_ = time_ns + hang_ms * kMs;
      const bool hanging = time_ns < hang_until_ns_;
      controller_.advance(time_ns);  // its watchdog is hardware: it goes on
      watchdog_trips_ = controller_.watchdog_trips();
      if (faults_.disconnect.load() && options_.tcp) drop_line();
      if (faults_.restart.exchange(false)) {
        controller_.restart();
        drop_line();
      }
      if (!hanging) {
        take_lines();
        if (faults_.at_code.load() == 0) send_extra();
        send_due();
      }
      wait(hanging);
    }
  }

  void wait(bool hanging) {
    std::int64_t wait_ns = kIdle_ns;
    if (!answers_.empty()) wait_ns = std::clamp<std::int64_t>(answers_.front().due_ns - now(), 0, kIdle_ns);
    std::array<pollfd, 3> fds{
        {{stop_.fd(), POLLIN, 0}, {line_.listener(), POLLIN, 0}, {hanging ? -1 : line_.fd(), POLLIN, 0}}};
    const timespec timeout{0, static_cast<long>(hanging ? kIdle_ns : wait_ns)};
    ::ppoll(fds.data(), fds.size(), &timeout, nullptr);
    if (fds[0].revents != 0) stopping_ = true;
    if (fds[1].revents != 0 && line_.accept(faults_.disconnect.load())) forget();
    if (fds[2].revents != 0) receive();
  }

  void drop_line() {
    if (!options_.tcp || line_.fd() < 0) return;
    line_.drop();
    forget();
  }

  /// What belonged to the client before.
  void forget() {
    received_.clear();
    answers_.clear();
  }

  void receive() {
    std::array<char, 512> bytes{};
    const ssize_t size = ::read(line_.fd(), bytes.data(), bytes.size());
    if (size > 0) {
      received_.append(bytes.data(), static_cast<std::size_t>(size));
    } else if (options_.tcp && (size == 0 || (errno != EAGAIN && errno != EINTR))) {
      drop_line();
    }
  }

  void take_lines() {
    for (auto end = received_.find("\r\n"); end != std::string::npos; end = received_.find("\r\n")) {
      const std::string line = received_.substr(0, end);
      received_.erase(0, end + 2);
      if (faults_.disconnect.load() || now() < silent_until_ns_) continue;  // the serial cable is out
      ++lines_;
      const int code = line.size() > 1 ? std::atoi(line.c_str() + 1) : 0;
      const bool hit = faults_.at_code.load() == 0 || faults_.at_code.load() == code;
      if (hit && !line.empty() && line.front() != 'Q' && take_one(faults_.lose)) continue;
      if (is_stop(line) && spoil_stop()) continue;
      auto answer = controller_.execute(line, now());
      if (answer && hit && faults_.at_code.load() != 0) send_extra();
      if (!answer || (hit && take_one(faults_.drop))) continue;
      if (hit && take_one(faults_.garbage)) (*answer)[answer->size() / 2] = '#';
      const std::int64_t wait_ns =
          (faults_.delay_ms.load() + (hit ? faults_.late_ms.exchange(0) : 0) + std::exchange(answer_late_ms_, 0)) *
              kMs +
          std::int64_t{options_.answer_us} * 1000;
      answers_.push_back({now() + wait_ns, std::move(*answer)});
    }
  }

  /// True when a stop is not carried out.
  bool spoil_stop() {
    if (const int silent_ms = faults_.stop.silent_ms.exchange(0); silent_ms > 0) {
      silent_until_ns_ = now() + silent_ms * kMs;
      return true;
    }
    if (take_one(faults_.stop.cut)) {
      drop_line();
      return true;
    }
    if (take_one(faults_.stop.busy)) {
      answers_.push_back({now(), "Busy."});
      return true;
    }
    answer_late_ms_ = faults_.stop.late_ms.exchange(0);
    return take_one(faults_.stop.lost);
  }

  void send_extra() {
    if (faults_.extra.load() > 0 && take_one(faults_.extra)) answers_.push_back({now(), "0.12345678"});
  }

  /// In order: one that is held back holds back those behind it.
  void send_due() {
    while (!answers_.empty() && answers_.front().due_ns <= now()) {
      const std::string line = answers_.front().text + "\r\n";
      answers_.pop_front();
      if (line_.fd() < 0) continue;
      if (line_.send(line.data(), line.size()) != static_cast<std::ptrdiff_t>(line.size())) drop_line();
    }
  }

  struct Due {
    std::int64_t due_ns;
    std::string text;
  };

  const Options options_;
  Instron8800Faults& faults_;
  Instron8800Controller controller_;
  StopEvent stop_;
  ClientLine line_;
  std::string received_;
  std::deque<Due> answers_;
  std::int64_t hang_until_ns_ = 0, silent_until_ns_ = 0;
  int answer_late_ms_ = 0;  // of the next answer
  bool stopping_ = false;
  std::thread thread_;
};

Instron8800Server::Instron8800Server(const Options& options, frame::Device& backend, Instron8800Faults& faults)
    : impl_(std::make_unique<Impl>(options, backend, faults)) {}
Instron8800Server::~Instron8800Server() = default;
std::uint16_t Instron8800Server::port() const noexcept {
  return impl_->line().port();
}
std::string Instron8800Server::tty() const {
  return impl_->line().tty();
}
std::uint64_t Instron8800Server::lines() const noexcept {
  return impl_->lines_.load();
}
std::uint64_t Instron8800Server::watchdog_trips() const noexcept {
  return impl_->watchdog_trips_.load();
}

}  // namespace isorig::sim
