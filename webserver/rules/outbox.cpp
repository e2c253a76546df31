#include "webserver/rules/outbox.hpp"

#include <utility>

namespace isorig::web {

bool Outbox::put(const std::shared_ptr<const Message>& message) {
  const auto bytes = message->bytes.size();
  if (message->kind == Message::Kind::kSamples) {
    if (sample_bytes_ + bytes > sample_bytes_most_) {
      put_first(std::make_shared<const Message>(Message{
          "{\"kind\":\"left-out\",\"messages\":" + std::to_string(++left_out_) + "}", Message::Kind::kLeftOut}));
      return true;
    }
    sample_bytes_ += bytes;
    samples_.push_back(message);
    return true;
  }
  if (message->kind == Message::Kind::kEvents) {
    if (event_bytes_ + bytes > kEventBytes) return false;
    event_bytes_ += bytes;
  }
  if (message->kind ==
      Message::Kind::kAnotherClock) {  // samples of the old clock would be drawn at the new one's times
    samples_.clear();
    sample_bytes_ = 0;
  }
  put_first(message);
  return true;
}

void Outbox::put_first(const std::shared_ptr<const Message>& message) {
  if (message->kind != Message::Kind::kEvents) {
    // To the end, not in the old one's place: it must not pass events that were before it, and a plan of 10 MiB must
    // not wait for a status that is renewed five times a second.
    std::erase_if(first_, [&](const auto& waiting) { return waiting->kind == message->kind; });
  }
  first_.push_back(message);
}

std::shared_ptr<const Message> Outbox::take() {
  auto& from = first_.empty() ? samples_ : first_;
  if (from.empty()) return nullptr;
  auto out = std::move(from.front());
  from.pop_front();
  if (out->kind == Message::Kind::kSamples) sample_bytes_ -= out->bytes.size();
  if (out->kind == Message::Kind::kEvents) event_bytes_ -= out->bytes.size();
  return out;
}

}  // namespace isorig::web
