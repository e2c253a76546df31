#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <isorig_msgs/control_batch_t.hpp>
#include <isorig_msgs/event_t.hpp>
#include <isorig_msgs/exchange_batch_t.hpp>
#include <isorig_msgs/frame_average_batch_t.hpp>
#include <isorig_msgs/frame_batch_t.hpp>
#include <isorig_msgs/pressure_average_batch_t.hpp>
#include <isorig_msgs/pressure_batch_t.hpp>
#include <isorig_msgs/sync_check_t.hpp>
#include <vector>

#include "daemon/recording/segmented_log.hpp"
#include "messages/channels.hpp"

namespace isorig::daemon {

/// When what a message holds was over: the order of the log.
inline std::int64_t end_ns(const isorig_msgs::frame_batch_t& m) {
  return m.mono_ns + m.mono_offset_ns[m.count - 1];
}
inline std::int64_t end_ns(const isorig_msgs::pressure_batch_t& m) {
  return m.mono_ns + m.mono_offset_ns[m.count - 1];
}
inline std::int64_t end_ns(const isorig_msgs::frame_average_batch_t& m) {
  return m.last_mono_ns[m.count - 1];
}
inline std::int64_t end_ns(const isorig_msgs::pressure_average_batch_t& m) {
  return m.last_mono_ns[m.count - 1];
}
inline std::int64_t end_ns(const isorig_msgs::control_batch_t& m) {
  return m.samples[m.count - 1].mono_ns;
}
inline std::int64_t end_ns(const isorig_msgs::exchange_batch_t& m) {
  return m.host_recv_ns[m.count - 1];
}
inline std::int64_t end_ns(const isorig_msgs::sync_check_t& m) {
  return m.mono_ns;
}
inline std::int64_t end_ns(const isorig_msgs::event_t& m) {
  return m.mono_ns;
}

/// Encoded messages of one slice of time. They come queue by queue and go into the log in order of session and time.
/// Memory is kept from slice to slice.
class StagedMessages {
 public:
  /// Numbers the message within its channel and encodes it.
  template <typename Message>
  void write(messages::Channel channel, std::int32_t session, Message& message) {
    message.number = numbers_[static_cast<std::size_t>(channel)]++;
    const auto size = static_cast<std::size_t>(message.getEncodedSize());
    const auto offset = encoded_.size();
    encoded_.resize(offset + size);
    message.encode(encoded_.data() + offset, 0, static_cast<int>(size));
    staged_.push_back({session, end_ns(message), channel, offset, size});
  }

  /// Holds something of a session after this one.
  [[nodiscard]] bool goes_beyond(std::int32_t session) const noexcept;
  /// Everything, in order; then nothing is staged.
  void append_to(SegmentedLog& log);

 private:
  struct Staged {
    std::int32_t session;
    std::int64_t mono_ns;
    messages::Channel channel;
    std::size_t offset;
    std::size_t size;
  };

  std::vector<std::uint8_t> encoded_;
  std::vector<Staged> staged_;
  std::array<std::int64_t, messages::kChannels> numbers_{};
};

}  // namespace isorig::daemon
