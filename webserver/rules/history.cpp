#include "webserver/rules/history.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

namespace isorig::web {
namespace {

constexpr std::int64_t kAnotherClock_ns = 1'000'000'000;
constexpr std::size_t kRaw1kHz = 660'000;
constexpr std::size_t kRaw100Hz = 66'000;
constexpr std::uint32_t kRestart = 60'000;  // a minute at 1 kHz

static_assert(std::endian::native == std::endian::little, "blocks are written as the machine has its numbers");

/// Towards minus infinity: stretches have the same width on both sides of zero.
std::int64_t index_of(std::int64_t mono_ns, std::int64_t width_ns) {
  const auto quotient = mono_ns / width_ns;
  return mono_ns % width_ns < 0 ? quotient - 1 : quotient;
}

template <typename Number>
void put(std::string& out, Number value) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.append(bytes, sizeof value);
}

}  // namespace

void Series::Growing::add(const std::array<float, 2>& value) {
  for (std::size_t c = 0; c < value.size(); ++c) {
    low[c] = count == 0 ? value[c] : std::min(low[c], value[c]);
    high[c] = count == 0 ? value[c] : std::max(high[c], value[c]);
    sum[c] = (count == 0 ? 0.0 : sum[c]) + double{value[c]};
  }
  ++count;
}

Stretch Series::Growing::closed() const {
  Stretch s{index, low, high, {}};
  for (std::size_t c = 0; c < sum.size(); ++c) s.mean[c] = static_cast<float>(sum[c] / static_cast<double>(count));
  return s;
}

Series::Series(const Limits& limits)
    : limits_(limits),
      raw_(std::max<std::size_t>(1, limits.raw_samples)),
      coarse_(std::max<std::size_t>(1, limits.coarse_stretches)) {}

void Series::forget() {
  count_ = coarse_count_ = open_.count = 0;
  ++restarts_;
}

void Series::push(std::int64_t mono_ns, double first, double second) {
  if (const auto last = newest_ns(); last && mono_ns < *last) {
    if (*last - mono_ns > kAnotherClock_ns) {
      forget();
    } else {
      mono_ns = *last;
    }
  }
  const Sample sample{mono_ns, {static_cast<float>(first), static_cast<float>(second)}};
  if (count_ == raw_.size()) {
    raw_[first_] = sample;
    first_ = (first_ + 1) % raw_.size();
  } else {
    raw_[(first_ + count_++) % raw_.size()] = sample;
  }
  const auto index = index_of(mono_ns, limits_.coarse_width_ns);
  if (open_.count > 0 && index != open_.index) {
    const auto done = open_.closed();
    if (coarse_count_ == coarse_.size()) {
      coarse_[coarse_first_] = done;
      coarse_first_ = (coarse_first_ + 1) % coarse_.size();
    } else {
      coarse_[(coarse_first_ + coarse_count_++) % coarse_.size()] = done;
    }
    open_.count = 0;
  }
  open_.index = index;
  open_.add(sample.value);
}

std::optional<std::int64_t> Series::oldest_ns() const {
  if (count_ == 0) return std::nullopt;
  return at(0).mono_ns;
}
std::optional<std::int64_t> Series::newest_ns() const {
  if (count_ == 0) return std::nullopt;
  return at(count_ - 1).mono_ns;
}

std::vector<Stretch> Series::stretches(std::int64_t width_ns, std::int64_t from, std::int64_t to) const {
  std::vector<Stretch> out;
  std::size_t low = 0, high = count_;
  while (low < high) {
    const auto middle = low + (high - low) / 2;
    if (index_of(at(middle).mono_ns, width_ns) < from) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  Growing now;
  for (std::size_t i = low; i < count_; ++i) {
    const auto& sample = at(i);
    const auto index = index_of(sample.mono_ns, width_ns);
    if (index >= to) break;
    if (now.count > 0 && index != now.index) {
      out.push_back(now.closed());
      now.count = 0;
    }
    now.index = index;
    now.add(sample.value);
  }
  if (now.count > 0) out.push_back(now.closed());
  return out;
}

std::vector<Stretch> Series::coarse(std::int64_t from) const {
  std::vector<Stretch> out;
  for (std::size_t i = 0; i < coarse_count_; ++i) {
    const auto& s = coarse_[(coarse_first_ + i) % coarse_.size()];
    if (s.index >= from) out.push_back(s);
  }
  return out;
}

std::size_t Series::bytes() const {
  return raw_.capacity() * sizeof(Sample) + coarse_.capacity() * sizeof(Stretch);
}

void Lateness::add(std::int64_t mono_ns, std::uint32_t worst_wakeup_ns) {
  const auto second = index_of(mono_ns, 1'000'000'000);
  if (second + 1 < newest_) slots_.fill({});  // another clock
  newest_ = second;
  auto& slot = slots_[static_cast<std::size_t>(((second % kSlots) + kSlots) % kSlots)];
  if (slot.second != second) slot = {second, {}};
  const auto us = worst_wakeup_ns / 1000;
  ++slot.counts[std::min<std::size_t>(kBins - 1, static_cast<std::size_t>(std::bit_width(us)))];
}

Lateness::Counts Lateness::counts() const {
  Counts sum{};
  for (const auto& slot : slots_) {
    if (slot.second == INT64_MIN || slot.second <= newest_ - kSlots) continue;
    for (std::size_t i = 0; i < kBins; ++i) sum[i] += slot.counts[i];
  }
  return sum;
}

std::uint64_t History::Sequence::skipped(std::uint32_t sequence) {
  const std::uint32_t step = last ? sequence - *last : 1;  // wraps with the number itself
  last = sequence;
  return step > 1 && step < kRestart ? step - 1 : 0;
}

History::History()
    : series_{Series({kRaw1kHz}), Series({kRaw1kHz}), Series({kRaw100Hz}), Series({kRaw1kHz}), Series({kRaw1kHz})} {}

void History::add(const daemon::FrameRecord& record) {
  gaps_ += sequences_[0].skipped(record.sequence);
  series_[static_cast<std::size_t>(Stream::kFrame)].push(record.mono_ns, record.position_mm, record.force_N);
}
void History::add(const daemon::PressureRecord& record) {
  gaps_ += sequences_[1].skipped(record.sequence);
  series_[static_cast<std::size_t>(Stream::kPressure)].push(record.mono_ns, record.pressure_psi);
}
void History::add(const daemon::ControlRecord& record) {
  series_[static_cast<std::size_t>(Stream::kControl)].push(record.mono_ns, double{record.target_mm},
                                                           double{record.setpoint_psi});
  lateness_.add(record.mono_ns, record.worst_wakeup_ns);
}

void History::add_twin(std::int64_t mono_ns, double predicted_N, double half_N, double residual) {
  series_[static_cast<std::size_t>(Stream::kBand)].push(mono_ns, predicted_N - half_N, predicted_N + half_N);
  series_[static_cast<std::size_t>(Stream::kTwin)].push(mono_ns, predicted_N, residual);
}

std::size_t History::bytes() const {
  std::size_t sum = 0;
  for (const auto& s : series_) sum += s.bytes();
  return sum;
}

std::string block(Stream stream, std::uint8_t tier, std::int64_t width_ns, const std::vector<Stretch>& stretches) {
  const std::size_t channels = stream == Stream::kPressure ? 1 : 2;
  const std::int64_t origin = stretches.empty() ? 0 : stretches.front().index;
  std::string out;
  out.reserve(24 + stretches.size() * 4 * (1 + 3 * channels));
  put(out, static_cast<std::uint8_t>(stream));
  put(out, tier);
  put(out, static_cast<std::uint16_t>(3 * channels));
  put(out, static_cast<std::uint32_t>(stretches.size()));
  put(out, static_cast<double>(origin));
  put(out, static_cast<double>(width_ns));
  for (const auto& s : stretches) put(out, static_cast<std::uint32_t>(s.index - origin));
  for (std::size_t c = 0; c < channels; ++c) {
    for (const auto& s : stretches) put(out, s.low[c]);
    for (const auto& s : stretches) put(out, s.high[c]);
    for (const auto& s : stretches) put(out, s.mean[c]);
  }
  return out;
}

}  // namespace isorig::web
