#include "firmware/elvh_reader.hpp"

#include "messages/elvh.hpp"

namespace isorig::firmware {
namespace {

// DS-0376 p. 14: SS low to first clock at least 2.5 us, SS high between reads at least 2 us. Half a
// microsecond is added to both, since a timer read is not the edge itself.
constexpr uint32_t kSelect_us_x2 = 6;
constexpr uint32_t kIdle_us_x2 = 5;

// Conversions whose span gives the period: stamps are within half a poll period, so this knows it to one in
// about a thousand and follows the sensor's temperature in a tenth of a second.
constexpr uint32_t kRunLength = 256;

bool is_line_stuck(uint32_t word) noexcept {
  const uint32_t head = word >> 16U;
  return head == 0x0000U || head == 0xFFFFU;
}

messages::ElvhStatus status_of(uint32_t word) noexcept {
  return messages::unpack_elvh(word).status;
}

}  // namespace

ElvhReader::ElvhReader(const Options& options, SensorBus& bus) noexcept
    : options_(options),
      bus_(bus),
      select_cycles_((kSelect_us_x2 * options.cycles_per_us + 1) / 2),
      idle_cycles_((kIdle_us_x2 * options.cycles_per_us + 1) / 2),
      poll_cycles_(options.poll_period_us * options.cycles_per_us),
      transfer_limit_(options.transfer_limit_us * options.cycles_per_us),
      period_(options.nominal_period_us * options.cycles_per_us) {}

void ElvhReader::begin_poll(uint64_t selected, uint64_t now) noexcept {
  selected_ = selected;
  state_ = State::kSelected;
  // On a fixed grid; but polls that a stall made late are not made up for.
  next_poll_ += poll_cycles_;
  if (next_poll_ <= now) next_poll_ = now + poll_cycles_;
}

bool ElvhReader::take(uint16_t half) noexcept {
  if (state_ == State::kTail) {
    word_ |= half;
    return true;
  }
  word_ = static_cast<uint32_t>(half) << 16U;
  const bool is_silent = selected_ - seen_ >= uint64_t{options_.silence_us} * options_.cycles_per_us;
  return status_of(word_) == messages::ElvhStatus::kStale && !(is_silent && is_report_due());
}

ElvhReader::Event ElvhReader::finish(uint64_t now) noexcept {
  const bool is_whole = state_ == State::kTail || word_ == kNothing;
  state_ = State::kIdle;
  if (next_poll_ < now + idle_cycles_) next_poll_ = now + idle_cycles_;

  Event event;
  const messages::ElvhStatus status = status_of(word_);
  if (status == messages::ElvhStatus::kCurrent && !is_line_stuck(word_)) {
    const bool is_on_time = has_previous_ && selected_ - previous_ < poll_cycles_ + poll_cycles_ / 4;
    current_run_ = is_on_time ? current_run_ + 1 : 1;
    if (current_run_ > options_.max_current_run) current_run_ = options_.max_current_run + 1;
    event = current_run_ <= options_.max_current_run ? conversion() : report();
  } else if (status != messages::ElvhStatus::kStale || is_whole) {
    event = report();
  }
  if (status == messages::ElvhStatus::kStale) current_run_ = 0;
  previous_ = selected_;
  has_previous_ = true;
  return event;
}

ElvhReader::Event ElvhReader::conversion() noexcept {
  Event event;
  event.kind = Kind::kConversion;
  event.raw_word = word_;
  // The sensor holds the latest of several: no older than one period.
  uint64_t window = has_previous_ ? selected_ - previous_ : period_;
  if (has_converted_ && window > period_) {
    const uint64_t conversions = (selected_ - converted_) / period_;
    event.missed = conversions > 1 ? static_cast<uint32_t>(conversions - 1) : 0;
  }
  measure_period(window);
  if (window > period_) window = period_;
  event.at_cycles = selected_ - window / 2;
  converted_ = event.at_cycles;
  seen_ = selected_;
  has_converted_ = true;
  is_healthy_ = true;
  return event;
}

void ElvhReader::measure_period(uint64_t window) noexcept {
  const uint64_t stamp = selected_ - window / 2;
  const uint64_t longest = uint64_t{options_.max_period_us} * options_.cycles_per_us;
  const bool is_disturbed = run_length_ > 0 && stamp - converted_ > longest;
  if (window >= period_ || is_disturbed || run_length_ == 0) {
    run_start_ = stamp;
    run_length_ = 1;
    return;
  }
  if (run_length_ < kRunLength) {
    ++run_length_;
    return;
  }
  const uint64_t measured = (stamp - run_start_) / kRunLength;
  if (measured >= uint64_t{options_.min_period_us} * options_.cycles_per_us && measured <= longest) {
    period_ = static_cast<uint32_t>(measured);
  }
  run_start_ = stamp;
  run_length_ = 1;
}

ElvhReader::Event ElvhReader::report() noexcept {
  is_healthy_ = false;
  run_length_ = 0;
  Event event;
  if (!is_report_due()) return event;
  // Half a poll early, or the jitter of the polls would decide which of two is the next.
  next_report_ = selected_ + uint64_t{options_.report_period_us} * options_.cycles_per_us - poll_cycles_ / 2;
  event.kind = Kind::kReport;
  event.at_cycles = selected_;
  event.raw_word = word_;
  return event;
}

}  // namespace isorig::firmware
