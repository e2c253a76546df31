#include "proof/foreign_laws/kinds.hpp"

#include <stdexcept>

#include "proof/foreign_laws/kind_lists.hpp"

namespace isorig::proof::foreign {

std::span<const Kind> kinds() {
  static const std::vector<Kind> all = [] {
    std::vector<Kind> list;
    for (const auto& part : {specimen_kinds(), flow_kinds(), rig_kinds(), unknown_kinds()})
      list.insert(list.end(), part.begin(), part.end());
    return list;
  }();
  return all;
}

const Kind& kind_of_law(std::string_view law) {
  const auto found = std::ranges::find(kinds(), law, &Kind::law);
  if (found == kinds().end()) throw std::invalid_argument("no law is called " + std::string(law));
  return *found;
}

}  // namespace isorig::proof::foreign
