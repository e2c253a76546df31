#include "messages/recording_id.hpp"

#include <algorithm>
#include <bit>
#include <iterator>

namespace isorig::messages {

std::uint64_t fingerprint(const Recording& recording) {
  std::uint64_t hash = 14695981039346656037ULL;
  for (const auto* column : {&recording.frame.t_s, &recording.frame.position_mm, &recording.frame.force_N})
    for (const double value : *column) hash = (hash ^ std::bit_cast<std::uint64_t>(value)) * 1099511628211ULL;
  return hash;
}

namespace {

/// splitmix64 (Steele, Lea & Flood 2014): every bit of a row in every bit of the hash.
std::uint64_t mixed(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15ULL;
  x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27U)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31U);
}

}  // namespace

std::vector<std::uint64_t> reading_marks(const Recording& recording) {
  constexpr std::size_t kRows = 32, kChanges = 16;
  constexpr std::uint64_t kOneOf = 64, kBase = 0x100000001B3ULL;
  const auto& frame = recording.frame;
  std::uint64_t leaving = 1;  // kBase^kRows
  for (std::size_t i = 0; i < kRows; ++i) leaving *= kBase;
  std::vector<std::uint64_t> out, rows(frame.size());
  std::uint64_t window = 0;
  std::size_t changes = 0;  // of the force, from row to row of the window
  const auto changed = [&](std::size_t k) { return k > 0 && frame.force_N[k] != frame.force_N[k - 1]; };
  for (std::size_t k = 0; k < frame.size(); ++k) {
    rows[k] = mixed(std::bit_cast<std::uint64_t>(frame.position_mm[k]) ^
                    mixed(std::bit_cast<std::uint64_t>(frame.force_N[k])));
    window = window * kBase + rows[k];
    changes += changed(k) ? 1U : 0U;
    if (k >= kRows) {
      window -= leaving * rows[k - kRows];
      changes -= changed(k - kRows) ? 1U : 0U;
    }
    if (k + 1 >= kRows && changes >= kChanges && mixed(window) % kOneOf == 0) out.push_back(window);
  }
  std::ranges::sort(out);
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

bool share_readings(std::span<const std::uint64_t> a, std::span<const std::uint64_t> b) {
  std::vector<std::uint64_t> both;
  std::ranges::set_intersection(a, b, std::back_inserter(both));
  return both.size() >= 4 && 2 * both.size() > std::min(a.size(), b.size());
}

double recording_id(const Recording& recording) {
  constexpr std::uint64_t kNumbers = (std::uint64_t{1} << 53U) - 2U;  // without 0 and 1, which say something else
  return static_cast<double>(2U + fingerprint(recording) % kNumbers);
}

}  // namespace isorig::messages
