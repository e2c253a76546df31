#pragma once
#include <cstdint>
#include <isorig_msgs/control_batch_t.hpp>
#include <isorig_msgs/event_t.hpp>
#include <isorig_msgs/exchange_batch_t.hpp>
#include <isorig_msgs/frame_average_batch_t.hpp>
#include <isorig_msgs/frame_batch_t.hpp>
#include <isorig_msgs/pressure_average_batch_t.hpp>
#include <isorig_msgs/pressure_batch_t.hpp>
#include <isorig_msgs/sync_check_t.hpp>

#include "daemon/core/records.hpp"
#include "daemon/recording/averages.hpp"
#include "messages/channels.hpp"

/// Records into LCM messages, for the recorder and the publisher alike. A batch is filled until the next
/// record does not fit (number, step, session, or a span that its offsets cannot express); storage is
/// allocated once.
namespace isorig::daemon {

class FrameBatch {
 public:
  static constexpr auto kChannel = messages::Channel::kFrame;
  FrameBatch();
  [[nodiscard]] bool fits(const FrameRecord& r, std::int32_t session) const noexcept;
  void add(const FrameRecord& r, std::int32_t session) noexcept;
  isorig_msgs::frame_batch_t message;
};

class PressureBatch {
 public:
  static constexpr auto kChannel = messages::Channel::kPressure;
  PressureBatch();
  [[nodiscard]] bool fits(const PressureRecord& r, std::int32_t session) const noexcept;
  void add(const PressureRecord& r, std::int32_t session) noexcept;
  isorig_msgs::pressure_batch_t message;
};

class FrameAverageBatch {
 public:
  static constexpr auto kChannel = messages::Channel::kFrameAverage;
  FrameAverageBatch();
  [[nodiscard]] bool fits(const FrameAverage& a, std::int32_t session) const noexcept;
  void add(const FrameAverage& a, std::int32_t session) noexcept;
  isorig_msgs::frame_average_batch_t message;
};

class PressureAverageBatch {
 public:
  static constexpr auto kChannel = messages::Channel::kPressureAverage;
  PressureAverageBatch();
  [[nodiscard]] bool fits(const PressureAverage& a, std::int32_t session) const noexcept;
  void add(const PressureAverage& a, std::int32_t session) noexcept;
  isorig_msgs::pressure_average_batch_t message;
};

class ControlBatch {
 public:
  static constexpr auto kChannel = messages::Channel::kState;
  ControlBatch();
  [[nodiscard]] bool fits(const ControlRecord& r, std::int32_t session) const noexcept;
  void add(const ControlRecord& r, std::int32_t session) noexcept;
  isorig_msgs::control_batch_t message;
};

class ExchangeBatch {
 public:
  static constexpr auto kChannel = messages::Channel::kClock;
  ExchangeBatch();
  [[nodiscard]] bool fits(const ExchangeRecord& r, std::int32_t session) const noexcept;
  void add(const ExchangeRecord& r, std::int32_t session) noexcept;
  isorig_msgs::exchange_batch_t message;
};

isorig_msgs::sync_check_t to_message(const SyncRecord& r, std::int32_t session);
isorig_msgs::event_t to_message(const EventRecord& r, std::int32_t session);

/// `Sink` is called as write(channel, session, message) and sets message.number.
template <typename Batch, typename Sink>
void flush(Batch& batch, Sink& sink) {
  if (batch.message.count == 0) return;
  sink.write(Batch::kChannel, batch.message.session, batch.message);
  batch.message.count = 0;
}

template <typename Batch, typename Item, typename Sink>
void append(Batch& batch, const Item& item, std::int32_t session, Sink& sink) {
  if (batch.message.count != 0 && !batch.fits(item, session)) flush(batch, sink);
  batch.add(item, session);
}

}  // namespace isorig::daemon
