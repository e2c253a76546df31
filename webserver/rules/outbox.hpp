#pragma once
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>

namespace isorig::web {

/// What is sent over a WebSocket; shared by all who get it.
struct Message {
  enum class Kind : std::uint8_t { kHello, kLease, kStatus, kPlan, kLeftOut, kAnotherClock, kEvents, kSamples };

  std::string bytes;
  Kind kind = Kind::kSamples;

  [[nodiscard]] bool binary() const { return kind == Kind::kSamples; }
};

/// What waits to be sent to one page. Samples wait behind all else, since a page with a slow link needs minutes for its
/// history and the state it shows has to be of now. Of messages that say how things stand the newest alone waits.
/// Samples alone are ever left out. Does no I/O.
class Outbox {
 public:
  /// `sample_bytes`: samples that would make more of them wait are left out and counted.
  explicit Outbox(std::size_t sample_bytes) : sample_bytes_most_(sample_bytes) {}

  /// Events follow each other and cannot stand for each other: so many bytes of them are thousands, more than a page
  /// shows, and a page that comes back gets the newest 1000.
  static constexpr std::size_t kEventBytes = std::size_t{4} << 20U;

  /// False: more events wait than are kept, and the page has to be cut off.
  [[nodiscard]] bool put(const std::shared_ptr<const Message>& message);
  /// The next to be sent, which waits no more; null when nothing does.
  [[nodiscard]] std::shared_ptr<const Message> take();
  [[nodiscard]] bool empty() const { return first_.empty() && samples_.empty(); }

 private:
  using Queue = std::deque<std::shared_ptr<const Message>>;
  void put_first(const std::shared_ptr<const Message>& message);

  std::size_t sample_bytes_most_;
  Queue first_, samples_;
  std::size_t sample_bytes_ = 0, event_bytes_ = 0;
  std::uint64_t left_out_ = 0;
};

}  // namespace isorig::web
