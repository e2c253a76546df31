#pragma once
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/recording/sample_stream.hpp"

namespace isorig::daemon::testing {

/// A subscriber of the sample socket that keeps what it reads.
class Subscription {
 public:
  explicit Subscription(const std::string& path, int receive_buffer = 0) {
    fd_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (receive_buffer > 0) ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    const timeval patience{5, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strcpy(address.sun_path, path.c_str());
    EXPECT_EQ(::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  ~Subscription() { die(); }
  Subscription(const Subscription&) = delete;
  Subscription& operator=(const Subscription&) = delete;

  void die() {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
  }

  /// The next record; nothing when the stream has ended or none comes in 5 s.
  std::optional<samples::Record> next() {
    samples::Record record;
    while (!reader_.next(record)) {
      char bytes[4096];
      const auto n = ::read(fd_, bytes, sizeof bytes);
      if (n <= 0) return std::nullopt;
      reader_.feed({bytes, static_cast<std::size_t>(n)});
    }
    return record;
  }

  /// Reads up to an event of this code.
  void read_to(std::string_view code) {
    while (auto record = next()) {
      if (const auto* hello = std::get_if<samples::Hello>(&*record)) rig = hello->rig;
      if (const auto* frame = std::get_if<FrameRecord>(&*record)) frames.push_back(*frame);
      if (const auto* pressure = std::get_if<PressureRecord>(&*record)) pressures.push_back(*pressure);
      if (const auto* control = std::get_if<ControlRecord>(&*record)) controls.push_back(*control);
      if (const auto* told = std::get_if<samples::Lost>(&*record)) lost = *told;
      const auto* event = std::get_if<EventRecord>(&*record);
      if (event == nullptr) continue;
      events.push_back(*event);
      if (event->code == code) return;
    }
    ADD_FAILURE() << "no event " << code << " came";
  }

  std::string rig;
  std::vector<FrameRecord> frames;
  std::vector<PressureRecord> pressures;
  std::vector<ControlRecord> controls;
  std::vector<EventRecord> events;
  samples::Lost lost;

 private:
  int fd_ = -1;
  samples::Reader reader_;
};

}  // namespace isorig::daemon::testing
