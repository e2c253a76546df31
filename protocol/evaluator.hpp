#pragma once
#include <initializer_list>
#include <set>
#include <string>
#include <string_view>
#include <tuple>

#include "base/toml_reader.hpp"
#include "protocol/expression.hpp"
#include "protocol/syntax.hpp"

namespace isorig::protocol {

/// Values of the tree's expressions in one turn of the repeats, and what is wrong with them, noted in the
/// document: each message once per place, however often a repeat comes by.
class Evaluator {
 public:
  explicit Evaluator(Bindings constants) : bindings_(std::move(constants)) {}

  [[nodiscard]] const Bindings& bindings() const noexcept { return bindings_; }
  /// Returns what unbind() needs.
  std::size_t bind(const Bindings& row);
  void unbind(std::size_t outer) { bindings_.resize(outer); }

  /// Another step: forgets which values of the last one were reported.
  void begin_step() { bad_.clear(); }
  /// The value of `key`; `fallback` where there is none or it is out of range, which is noted.
  double value(const syntax::Node& node, std::string_view key, base::Range range, double fallback);
  /// The same for a whole number; 1 is the fallback.
  double whole(const syntax::Node& node, std::string_view key, base::Range range);
  /// None of these keys has been reported for this step: comparing them makes sense.
  [[nodiscard]] bool all_well(const syntax::Node& node, std::initializer_list<std::string_view> keys) const;

  /// "`velocity_mm_s` = 12 with speed_mm_s = 12"
  [[nodiscard]] std::string said(const syntax::Node& node, std::string_view key, double value) const;
  void note(const base::TomlTable& table, std::string_view key, std::string message);

 private:
  Bindings bindings_;
  std::set<std::string, std::less<>> bad_;  ///< keys of the step at hand whose value was reported
  std::set<std::tuple<std::uint32_t, std::uint32_t, std::string>> noted_;
};

}  // namespace isorig::protocol
