#include "daemon/recording/publisher.hpp"

#include <array>
#include <cerrno>
#include <cstring>
#include <isorig_msgs/progress_t.hpp>
#include <lcm/lcm-cpp.hpp>
#include <limits>
#include <stdexcept>

#include "base/formatted.hpp"
#include "daemon/core/fixed_text.hpp"
#include "daemon/recording/batches.hpp"
#include "messages/channels.hpp"

namespace isorig::daemon {
namespace {

using messages::Channel;

constexpr std::int64_t kProgressPeriodNs = 500'000'000;
constexpr std::int32_t kNoSession = -1;  // sessions are the recording's; live messages say the step

}  // namespace

struct Publisher::Impl {
  Impl(const std::string& url, Publisher& p) : publisher(p), lcm(url) {
    if (!lcm.good()) {
      throw std::runtime_error("LCM cannot open \"" + url + "\"; multicast needs a route even on one machine: " +
                               kMulticastRoute + ", or switch publishing off in the rig's file");
    }
    for (std::size_t i = 0; i < names.size(); ++i) names[i] = std::string(messages::kChannelNames[i]);
  }

  template <typename Message>
  void write(Channel channel, std::int32_t, Message& message) {
    const auto i = static_cast<std::size_t>(channel);
    message.number = numbers[i]++;
    const int size = message.getEncodedSize();
    // Batches are smaller by construction and texts have a bound: kMaxMessageBytes is checked by the tests.
    if (size > static_cast<int>(buffer.size())) return failed(EMSGSIZE);
    message.encode(buffer.data(), 0, size);
    errno = 0;
    if (lcm.publish(names[i], buffer.data(), static_cast<unsigned>(size)) != 0) return failed(errno);
    publisher.published_.fetch_add(1, std::memory_order_relaxed);
  }

  void failed(int error) {
    publisher.failed_errno_.store(error, std::memory_order_relaxed);
    publisher.failed_.fetch_add(1, std::memory_order_relaxed);
  }

  void write_progress(std::int64_t now_ns) {
    isorig_msgs::progress_t m{};
    m.mono_ns = now_ns;
    m.session = kNoSession;
    m.step = static_cast<std::int32_t>(newest.step);
    m.state = static_cast<std::int8_t>(newest.state);
    m.progress = newest.progress;
    m.remaining_s = newest.remaining_s;
    m.dropped_records = static_cast<std::int64_t>(dropped);
    m.failed_publishes = static_cast<std::int64_t>(publisher.failed());
    write(Channel::kProgress, kNoSession, m);
  }

  void write_event(const EventRecord& r) {
    auto message = to_message(r, kNoSession);
    write(Channel::kEvent, kNoSession, message);
  }

  void report_dropped(std::size_t now_dropped, std::int64_t now_ns) {
    if (now_dropped == dropped) return;
    EventRecord r;
    r.mono_ns = now_ns;
    r.step = newest.step;
    r.severity = Severity::kWarning;
    r.from = r.to = newest.state;
    r.value = static_cast<double>(now_dropped - dropped);
    copy_text(r.code, "publisher.dropped");
    copy_text(r.text, base::formatted("%zu records were not published: the publisher was late; the recording has them",
                                      now_dropped - dropped));
    dropped = now_dropped;
    write_event(r);
  }

  Publisher& publisher;
  lcm::LCM lcm;
  std::array<std::string, messages::kChannels> names;
  std::array<std::int64_t, messages::kChannels> numbers{};
  std::array<std::uint8_t, messages::kMaxMessageBytes> buffer{};
  FrameBatch frame;
  PressureBatch pressure;
  ControlBatch control;
  ExchangeBatch exchanges;
  ControlRecord newest;
  std::size_t dropped = 0;
  std::int64_t next_progress_ns = std::numeric_limits<std::int64_t>::min();
};

Publisher::Publisher(const std::string& url) : impl_(std::make_unique<Impl>(url, *this)) {}

Publisher::~Publisher() = default;

void Publisher::on_event(const EventRecord& record) {
  impl_->write_event(record);
}
void Publisher::on_frame(const FrameRecord& record) {
  append(impl_->frame, record, kNoSession, *impl_);
}
void Publisher::on_pressure(const PressureRecord& record) {
  append(impl_->pressure, record, kNoSession, *impl_);
}
void Publisher::on_control(const ControlRecord& record) {
  impl_->newest = record;
  append(impl_->control, record, kNoSession, *impl_);
}
void Publisher::on_exchange(const ExchangeRecord& record) {
  append(impl_->exchanges, record, kNoSession, *impl_);
}
void Publisher::on_sync(const SyncRecord& record) {
  auto message = to_message(record, kNoSession);
  impl_->write(Channel::kSync, kNoSession, message);
}

void Publisher::end_of_turn(std::size_t dropped, std::int64_t now_ns) {
  auto& m = *impl_;
  flush(m.frame, m);
  flush(m.pressure, m);
  flush(m.control, m);
  flush(m.exchanges, m);
  m.report_dropped(dropped, now_ns);
  if (now_ns >= m.next_progress_ns) {
    m.next_progress_ns = now_ns + kProgressPeriodNs;
    m.write_progress(now_ns);
  }
}

std::string PublishWatch::look(std::uint64_t failed, int error) {
  const auto newly = failed - failed_;
  failed_ = failed;
  if (newly > 0) {
    const bool told = quiet_looks_ < kQuietLooks;
    quiet_looks_ = 0;
    if (told) return {};
    before_ = failed - newly;
    return std::string("LCM: the network takes no messages (") + std::strerror(error) +
           "): subscribers hear nothing, the recording misses nothing" +
           (error == ENETUNREACH ? std::string("; multicast needs a route: ") + kMulticastRoute : std::string());
  }
  if (quiet_looks_ >= kQuietLooks || ++quiet_looks_ < kQuietLooks) return {};
  return "LCM: the network takes messages again; " + std::to_string(failed - before_) + " were never sent";
}

}  // namespace isorig::daemon
