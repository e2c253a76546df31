#pragma once

namespace isorig::base {

/// A visitor of a std::variant from one lambda per alternative. Without a generic lambda among them an alternative that
/// is forgotten does not compile.
template <class... Ts>
struct Overloaded : Ts... {
  using Ts::operator()...;
};

}  // namespace isorig::base
