#include "daemon/host/control.hpp"

#include <algorithm>
#include <utility>

#include "base/utc_text.hpp"

namespace isorig::daemon {
namespace {

/// A terminal of the holder's own user: whoever has typed that password is taken for him.
bool is_holder(const Seat& holder, const Seat& seat) {
  return holder.same_as(seat) || (seat.page.empty() && holder.uid == seat.uid && holder.is_surely_of_its_user());
}

}  // namespace

bool Seat::same_as(const Seat& other) const {
  return uid == other.uid && page == other.page && (page.empty() || relay == other.relay);
}

std::string where_text(const Seat& seat) {
  return seat.name + (seat.page.empty() ? " at a terminal" : " on the live page");
}

Control::Control(std::function<bool()> busy, std::function<void(const Holder&)> ended)
    : Control(std::move(busy), std::move(ended), Limits()) {}

Control::Control(std::function<bool()> busy, std::function<void(const Holder&)> ended, const Limits& limits)
    : busy_(std::move(busy)), ended_(std::move(ended)), limits_(limits) {}

/// Further on than any of a daemon that was here before: who remembers a term of that one does not have this one's.
std::uint64_t Control::next_term(std::int64_t unix_s) {
  constexpr std::uint64_t kTermsInASecond = 1000;
  return terms_ = std::max(terms_ + 1, static_cast<std::uint64_t>(std::max<std::int64_t>(unix_s, 0)) * kTermsInASecond);
}

void Control::end_what_is_over(Time now) {
  if (!holder_) return;
  const bool terminal = holder_->seat.page.empty();
  if (now - used_ <= (terminal ? limits_.terminal : limits_.page)) return;
  if (terminal && busy_()) return;
  const auto gone = *std::exchange(holder_, std::nullopt);
  if (ended_) ended_(gone);
}

std::string Control::held_text() const {
  const auto& seat = holder_->seat;
  return seat.name + " has control (" + (seat.page.empty() ? "at a terminal" : "on the live page") + ", since " +
         base::utc_text(holder_->since_unix_s, "%H:%M UTC") +
         "); take it over if that is agreed: isorig control --take-over, or Take over on the live page";
}

std::optional<Control::Holder> Control::holder(Time now) {
  const std::lock_guard lock(mutex_);
  end_what_is_over(now);
  return holder_;
}

Control::Answer Control::take(const Seat& seat, bool over, Time now, std::int64_t unix_s) {
  const std::lock_guard lock(mutex_);
  end_what_is_over(now);
  if (holder_ && is_holder(holder_->seat, seat)) {
    used_ = now;
    provisional_ = 0;
    return {true, "control is held already: " + where_text(holder_->seat), "", holder_->term};
  }
  // From one's own terminal to one's own page, too, is no taking over.
  const bool own_terminal =
      holder_ && holder_->seat.page.empty() && holder_->seat.uid == seat.uid && seat.is_surely_of_its_user();
  if (holder_ && !over && !own_terminal) return {false, held_text(), "", 0};
  const auto from = holder_ && !own_terminal ? holder_->seat.name : std::string();
  holder_ = Holder{seat, unix_s, next_term(unix_s)};
  used_ = now;
  provisional_ = 0;
  return {true, "control is held by " + where_text(seat) + (from.empty() ? "" : ", taken over from " + from), from,
          terms_};
}

Control::Answer Control::give_back(const Seat& seat, Time now) {
  const std::lock_guard lock(mutex_);
  end_what_is_over(now);
  if (!holder_) return {true, "nobody has control", "", 0};
  if (!is_holder(holder_->seat, seat)) return {false, held_text(), "", 0};
  holder_.reset();
  return {true, "control is free", "", 0};
}

bool Control::keep(const Seat& seat, Time now) {
  const std::lock_guard lock(mutex_);
  end_what_is_over(now);
  if (!holder_ || !holder_->seat.same_as(seat)) return false;
  used_ = now;
  return true;
}

Control::Use Control::use(const Seat& seat, Time now, std::int64_t unix_s, std::uint64_t before) {
  const std::lock_guard lock(mutex_);
  end_what_is_over(now);
  if (holder_ && !is_holder(holder_->seat, seat)) return {held_text(), 0};
  if (holder_) {
    used_ = now;
    if (before != 0 && before == provisional_) return {"", before};
    provisional_ = 0;
    return {};
  }
  if (!seat.page.empty()) return {"take control first", 0};
  holder_ = Holder{seat, unix_s, next_term(unix_s)};
  used_ = now;
  provisional_ = terms_;
  return {"", terms_};
}

void Control::undo(std::uint64_t newly) {
  const std::lock_guard lock(mutex_);
  if (newly == 0 || newly != provisional_) return;
  if (holder_ && holder_->term == newly) holder_.reset();
  provisional_ = 0;
}

}  // namespace isorig::daemon
