#pragma once
#include <string>

namespace isorig::base {

/// For people: `digits` significant digits without trailing zeros, as printf's %.*g, in any locale with a decimal
/// point.
[[nodiscard]] std::string number_text(double value, int digits = 6);

/// For files and comparisons: the fewest digits that read back as the same double.
[[nodiscard]] std::string exact_number_text(double value);

}  // namespace isorig::base
