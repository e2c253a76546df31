#include "messages/recording_id.hpp"

#include <bit>

namespace isorig::messages {

std::uint64_t fingerprint(const Recording& recording) {
  std::uint64_t hash = 14695981039346656037ULL;
  for (const auto* column : {&recording.frame.t_s, &recording.frame.position_mm, &recording.frame.force_N})
    for (const double value : *column) hash = (hash ^ std::bit_cast<std::uint64_t>(value)) * 1099511628211ULL;
  return hash;
}

double recording_id(const Recording& recording) {
  constexpr std::uint64_t kNumbers = (std::uint64_t{1} << 53U) - 2U;  // without 0 and 1, which say something else
  return static_cast<double>(2U + fingerprint(recording) % kNumbers);
}

}  // namespace isorig::messages
