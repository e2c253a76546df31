#include "identify/diagnose/fit/moves.hpp"

namespace isorig::identify {

MoveNumbers number_moves(std::span<const Series> series) {
  MoveNumbers out;
  for (const Series& each : series) {
    for (std::size_t k = 0; k < each.nodes.size(); ++k) {
      if (k == 0 || begins_move(each, k)) ++out.count;
      out.of_bin.push_back(out.count - 1);
    }
  }
  return out;
}

}  // namespace isorig::identify
