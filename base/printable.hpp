#pragma once
#include <string>
#include <string_view>

namespace isorig::base {

/// Text from outside (a file, a device, a client) as it may go to a terminal, a log or a message: on one line, and
/// showing everything that is in it. Control characters, marks that reverse or hide text (bidirectional controls, zero
/// widths, tags, line and paragraph separators) become `\n`, `\t`, `\u202e` ...; bytes that are not UTF-8 become
/// `\xff`. All else, letters of any script included, stays as it is. Not reversible: a backslash stays a backslash.
[[nodiscard]] std::string printable(std::string_view text);

/// The same with line ends and tabs kept: for text of our own making that has lines.
[[nodiscard]] std::string printable_lines(std::string_view text);

/// Why the arguments of a command are not taken: one of them is not printable as it is, and would do to a terminal, or
/// to a stored text, what nobody sees. Shown printably; empty when there is none.
[[nodiscard]] std::string why_not_arguments(int argc, const char* const* argv);

/// A name that becomes part of a path and of listings: 1 to 64 of the letters A-Z a-z, digits and - _ . and not
/// beginning with a point or a dash (a hidden file, an option). Empty when `name` is one; else what is wrong with it.
[[nodiscard]] std::string why_not_a_name(std::string_view name);

}  // namespace isorig::base
