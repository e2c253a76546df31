#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "messages/foreign/mapping.hpp"

/// What a column is by its name and its unit.
namespace isorig::foreign {

/// How sure a name is. What may mean something else too counts where no other column is meant.
/// kWholeSpecimen: a length, which of the whole specimen is no position before its rest length is taken off.
enum class Sure { kYes, kUnlessAnother, kWholeSpecimen };

/// A word that a column's name may have, in small letters.
struct Word {
  std::string_view text;
  Field field;
  Sure sure = Sure::kYes;
};

/// The word that a column's name has; nothing where it has none.
[[nodiscard]] std::optional<Word> named(const std::string& column);

/// What has the unit of a field and is none: a stress, a rate. "calibrated" has no rate in it, "Druckspannung" a
/// stress.
[[nodiscard]] bool is_other(const std::string& column);

/// What is told to a machine, or belongs to it, and not measured at the specimen: a command, a limit, a zero, a supply.
[[nodiscard]] bool is_not_measured(const std::string& column);

/// By the column's name or its unit: "Absolute pressure", "p_abs", "bar abs", "psia". A recording has gauge pressure.
[[nodiscard]] bool is_absolute(const Column& column);

/// "Compressive load": counts compression as positive.
[[nodiscard]] bool says_compressive(const std::string& column);

/// With ASCII's capitals made small; no other letter is.
[[nodiscard]] std::string small(std::string_view text);

}  // namespace isorig::foreign
