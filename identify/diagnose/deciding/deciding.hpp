#pragma once
#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace isorig::identify {

/// Every number that decides a diagnosis, at its stated value (numbers.inc, where each has its derivation).
struct DecidingNumbers {
#define ISORIG_NUMBER(name, value, ...) double name = value;
#define ISORIG_COUNT(name, value, ...) std::size_t name = value;
#include "identify/diagnose/deciding/numbers.inc"
#undef ISORIG_COUNT
#undef ISORIG_NUMBER
};

namespace deciding_detail {
extern DecidingNumbers in_force;
}

/// The numbers in force: a plain read, for inner loops, too.
[[nodiscard]] inline const DecidingNumbers& deciding() noexcept {
  return deciding_detail::in_force;
}

/// A line of the table.
struct DecidingNumber {
  std::string_view name;
  double stated = 0.0;
  std::string_view unit;  ///< "1" of what has none
  double least = 0.0, most = 0.0;
  bool whole = false;
  std::string_view what;        ///< it decides
  std::string_view derivation;  ///< a law with its source, a command that measures it, or that nothing derives it
  double DecidingNumbers::*number = nullptr;
  std::size_t DecidingNumbers::*count = nullptr;  ///< of a whole one, in place of `number`

  [[nodiscard]] double in_force() const noexcept;
};

/// In the order of numbers.inc.
[[nodiscard]] std::span<const DecidingNumber> deciding_numbers() noexcept;

/// Takes "NAME=VALUE" into force. Throws std::invalid_argument, with what to do, for an unknown name and for a value
/// out of range. For a whole process and before its first diagnosis: no other thread may read meanwhile.
void decide(std::string_view assignment);
/// All at their stated values again.
void decide_as_stated() noexcept;

/// A number that is not at its stated value.
struct Decided {
  std::string_view name;
  double value = 0.0, stated = 0.0;
};
[[nodiscard]] std::vector<Decided> decided();
/// For people: what was decided otherwise; "" where nothing was.
[[nodiscard]] std::string decided_text(std::span<const Decided> changed);

}  // namespace isorig::identify
