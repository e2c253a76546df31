#pragma once

namespace isorig::base {

/// A visitor of a std::variant from one lambda per alternative. Without a generic lambda among them an alternative that
/// is forgotten does not compile.
template <class... Ts>
struct Overloaded : Ts... {
  using Ts::operator()...;
};
/// C++20 deduces this by itself; clang 14, whose clang-tidy reads the tree, does not.
template <class... Ts>
Overloaded(Ts...) -> Overloaded<Ts...>;

}  // namespace isorig::base
