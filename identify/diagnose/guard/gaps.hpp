#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace isorig::identify {

/// Rows k and k + 1 between which readings are missing: longer apart than eight times the spacing of the five rows
/// before and of the five after. A recorder that writes less often while nothing moves makes no gaps.
[[nodiscard]] bool is_gap(std::span<const double> t_s, std::size_t k);

}  // namespace isorig::identify
