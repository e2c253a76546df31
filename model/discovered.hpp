#pragma once
#include <string>
#include <string_view>
#include <vector>

namespace isorig::model {

/// What people call a product of element::discovered().
struct ProductWords {
  std::string_view carrier;                  ///< "elastic", "arm", "dashpot", "friction"
  std::string_view factor;                   ///< "position", "rate", ...; "alone" where the state pulls by itself
  std::string_view acts_on;                  ///< "arm", as the effects of the catalogue name it
  std::vector<std::string_view> depends_on;  ///< "arm state", "strain"
  std::string force;                         ///< "the arm's force"
  std::string by;                            ///< "the position"; "" of a state alone
  std::string symbol;                        ///< of the factor in Law::formula: "x"; "" of a state alone
};
/// Throws std::out_of_range for any other name.
[[nodiscard]] ProductWords product_words(std::string_view law);

}  // namespace isorig::model
